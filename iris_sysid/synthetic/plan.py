"""Plan a clip: its stage, camera, frame times, and all that is true of it, before a pixel is drawn."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from fractions import Fraction
from types import MappingProxyType
from typing import TypeVar

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from iris_sysid.errors import DataError, UnknownNameError
from iris_sysid.synthetic.camera import Camera, camera_for
from iris_sysid.synthetic.effects import check_effects, effect_within
from iris_sysid.synthetic.look import Look
from iris_sysid.synthetic.scene import SCENES, Scene, SceneBody, Setup, Stage
from iris_sysid.synthetic.sensor import kept_frames, shake
from iris_sysid.synthetic.truth import Truth
from iris_sysid.types import Array

Choice = TypeVar("Choice")

NOTHING: Mapping[str, float] = MappingProxyType({})
MAX_SIDE_PX, MIN_SIDE_PX = 7680, 32
MAX_FRAMES = 1_000_000
EXPOSURE_NODES = 8  # Gauss-Legendre nodes for the mean position over the exposure
SHAKE_WIDTH = 1280  # px at which shake and drift are stated
FORMER_NAMES: Mapping[str, str] = MappingProxyType({"one-static-pendulum": "two-moving-pendulum-one-static"})


@dataclass(frozen=True, eq=False, slots=True)
class Timing:
    """When frames are exposed and what the file says: ``true_s`` and ``ticks`` (n,), ``rate`` ticks per second."""

    true_s: Array
    ticks: NDArray[np.int64]
    rate: Fraction

    @property
    def file_s(self) -> Array:
        """The times that the file gives, s. Shape (n,)."""
        return np.asarray(self.ticks * float(1 / self.rate))


@dataclass(frozen=True, eq=False, slots=True)
class ClipPlan:
    """A clip before it is drawn: the stage, the camera, the times of its frames, and all that is true of it."""

    stage: Stage
    camera: Camera
    look: Look
    timing: Timing
    shift_px: Array
    readout_s: float
    seed: int
    truth: Truth


def plan_clip(
    phenomenon: str,
    *,
    effects: Mapping[str, float] = NOTHING,
    size: tuple[int, int] = (1280, 720),
    fps: float = 60.0,
    duration_s: float | None = None,
    seed: int = 0,
    setting: str | None = None,
    overrides: Mapping[str, float] = NOTHING,
    look: Look | None = None,
) -> ClipPlan:
    """Everything about a clip except its pixels: for tests and studies that need trajectories, not video.

    Parameters
    ----------
    phenomenon, effects, size, fps, duration_s, seed, setting, overrides, look
        As for :func:`render_clip`; the truth is the same.
    """
    look, scene = look or Look(), scene_named(phenomenon)
    length = scene.duration_s if duration_s is None else duration_s
    check_clip(size, fps, length, seed)
    hidden = check_effects(effects, scene.effects, scene.name)
    scene_rng, time_rng = (np.random.default_rng([seed, k]) for k in range(2))
    stage = stage_of(scene, setting, overrides, hidden, length, look, scene_rng)
    camera = _camera(stage, size, look, hidden)
    timing = _timing(length, fps, look, hidden, time_rng)
    shift = _shift(timing, size, fps, look, hidden, time_rng)
    readout = effect_within(hidden, "rolling-shutter", -0.1, 0.1)
    truth = Truth(
        phenomenon=scene.name,
        setting=setting,
        size=size,
        fps=float(timing.rate),
        duration_s=length,
        seed=seed,
        parameters=stage.stated,
        camera=_camera(stage, size, look, NOTHING).description(),
        look=asdict(look),
        events=stage.happened,
        effects=hidden,
        hidden=stage.hidden,
        true_camera=camera.description(),
        table=_table(stage, camera, timing, shift, look.exposure_s, readout),
    )
    return ClipPlan(stage, camera, look, timing, shift, readout, seed, truth)


def scene_named(phenomenon: str) -> Scene:
    """The scene of that name; underscores may stand for hyphens. UnknownNameError lists the names there are."""
    name = str(phenomenon).replace("_", "-")
    return SCENES[FORMER_NAMES.get(name, name)]


def stage_of(
    scene: Scene,
    setting: str | None = None,
    overrides: Mapping[str, float] = NOTHING,
    effects: Mapping[str, float] = NOTHING,
    duration_s: float = 10.0,
    look: Look | None = None,
    rng: np.random.Generator | None = None,
) -> Stage:
    """Make a scene ready, without drawing it: its trajectories and its truth.

    Parameters
    ----------
    scene
        What is filmed.
    setting
        One of its settings, or None.
    overrides
        Parameters that differ from the setting's.
    effects
        Hidden effects.
    duration_s
        How long the motion must last.
    look
        Which props are there.
    rng
        Source of chance for scenes that use any.

    Raises
    ------
    UnknownNameError
        When the scene has no such setting or parameter; lists the names.
    DataError
        When a value is not a finite number.
    """
    values = {parameter.name: float(parameter.default or 0.0) for parameter in scene.parameters}
    if setting is not None:
        values |= _chosen(scene.settings, setting, f"{scene.name} has no setting")
    for name, value in overrides.items():
        _chosen(values, name, f"{scene.name} has no parameter")
        if not isinstance(value, int | float) or not math.isfinite(value):
            raise DataError(f"{name} must be a finite number, not {value!r}")
        values[name] = float(value)
    for parameter in scene.parameters:
        if not parameter.lower <= values[parameter.name] <= parameter.upper:
            bounds = f"{parameter.lower:g} to {parameter.upper:g} {parameter.unit}"
            raise DataError(
                f"{parameter.name} of {scene.name} must lie within {bounds}, not {values[parameter.name]:g}"
            )
    return scene.stage(Setup(values, effects, duration_s, look or Look(), rng or np.random.default_rng(0)))


def _chosen(choices: Mapping[str, Choice], name: str, complaint: str) -> Choice:
    if name not in choices:
        raise UnknownNameError(f"{complaint} {name!r}; there are: {', '.join(choices)}")
    return choices[name]


def check_clip(size: tuple[int, int], fps: float, duration_s: float, seed: int) -> None:
    """Raise DataError, saying what is allowed, when these numbers make no clip.

    Parameters
    ----------
    size
        Width and height, px.
    fps
        Frames per second.
    duration_s
        Length.
    seed
        Of its chance.
    """
    if not isinstance(seed, int) or seed < 0:
        raise DataError(f"seed must be a whole number of at least 0, not {seed!r}")
    sides = [side for side in size if isinstance(side, int) and MIN_SIDE_PX <= side <= MAX_SIDE_PX and side % 2 == 0]
    if not len(size) == len(sides) == 2:
        raise DataError(f"size must be two even numbers from {MIN_SIDE_PX} to {MAX_SIDE_PX}, not {size}")
    if not (isinstance(fps, int | float) and 0.1 <= fps <= 1000):
        raise DataError(f"fps must lie between 0.1 and 1000, not {fps!r}")
    if not (isinstance(duration_s, int | float) and duration_s * fps >= 2):
        raise DataError(f"the clip must last at least two frames, not {duration_s!r} s at {fps:g} frames per second")
    if duration_s * fps > MAX_FRAMES:
        raise DataError(f"{duration_s:g} s at {fps:g} frames per second is more than {MAX_FRAMES} frames")


def _camera(stage: Stage, size: tuple[int, int], look: Look, effects: Mapping[str, float]) -> Camera:
    tilt_x, tilt_y = (math.radians(angle) for angle in look.tilt_deg)
    first, second = look.distortion
    yaw = effect_within(effects, "camera-tilt", -0.7, 0.7)
    radial = effect_within(effects, "radial-distortion", -0.5, 0.5)
    return camera_for(
        stage.view,
        size,
        tilt_rad=(tilt_x, tilt_y + yaw),
        roll_rad=math.radians(look.roll_deg),
        distortion=(first + radial, second),
        aspect=1.0 + effect_within(effects, "anisotropic-scale", -0.5, 1.0),
    )


def _timing(
    duration_s: float, fps: float, look: Look, effects: Mapping[str, float], rng: np.random.Generator
) -> Timing:
    rate = Fraction(fps).limit_denominator(1001)
    frames = kept_frames(max(2, round(duration_s * fps)), look.dropped, rng)
    ticks = frames.copy()
    if "dropped-frame" in effects:
        lost = round(effects["dropped-frame"])
        if not 0 < lost < frames[-1]:
            raise DataError(f"dropped-frame must be a frame number from 1 to {frames[-1] - 1}, not {lost}")
        frames = frames[frames != lost]
        ticks = frames - (frames > lost)
    stretch = Fraction(1 + effect_within(effects, "time-scale", -0.9, 10.0)).limit_denominator(100_000)
    return Timing(np.asarray(frames * float(1 / rate)), ticks, rate / stretch)


def _shift(
    timing: Timing,
    size: tuple[int, int],
    fps: float,
    look: Look,
    effects: Mapping[str, float],
    rng: np.random.Generator,
) -> Array:
    """Offset (n, 2) px of the whole image in each frame."""
    scale = size[0] / SHAKE_WIDTH
    every = shake(round(timing.true_s[-1] * fps) + 1, fps, look.shake_px * scale, rng)
    offset = every[np.round(timing.true_s * fps).astype(int)]
    offset[:, 0] += effects.get("camera-drift", 0.0) * scale * timing.true_s
    return offset


def _table(
    stage: Stage, camera: Camera, timing: Timing, shift: Array, exposure_s: float, readout_s: float
) -> pd.DataFrame:
    """One row per frame and body, sorted by frame."""
    phase = stage.phase(timing.true_s)
    frame = np.arange(len(timing.ticks))
    tables = []
    for body in stage.bodies:
        middle, mean = _seen(body, camera, timing.true_s, exposure_s, readout_s)
        metres = body.centre(timing.true_s)
        columns = {
            "frame": frame,
            "t_s": timing.file_s,
            "body": body.name,
            "x_px": middle[:, 0] + shift[:, 0],
            "y_px": middle[:, 1] + shift[:, 1],
            "x_mean_px": mean[:, 0] + shift[:, 0],
            "y_mean_px": mean[:, 1] + shift[:, 1],
            "radius_px": body.radius(timing.true_s) * camera.pixels_per_metre,
            "x_m": metres[:, 0],
            "z_m": metres[:, 1],
            "phase": phase,
            "inside": _inside(middle + shift, camera.size),
            "shift_x_px": shift[:, 0],
            "shift_y_px": shift[:, 1],
        }
        columns |= {name: curve(timing.true_s) for name, curve in body.observed.items()}
        tables.append(pd.DataFrame(columns))
    return pd.concat(tables).sort_values(["frame", "body"], kind="stable", ignore_index=True)


def _inside(xy_px: Array, size: tuple[int, int]) -> NDArray[np.bool_]:
    """Whether a point lies in the image."""
    return np.all((xy_px > -0.5) & (xy_px < np.array(size) - 0.5), axis=1)


def _seen(body: SceneBody, camera: Camera, t_s: Array, exposure_s: float, readout_s: float) -> tuple[Array, Array]:
    """Centre (n, 2) px at the middle of the exposure, and its mean over the exposure."""
    nodes, weights = np.polynomial.legendre.leggauss(EXPOSURE_NODES)

    def pixels(delay: Array | float) -> Array:
        at = t_s + delay
        xy = camera.project(body.centre(at))
        for _ in range(4 if readout_s else 0):  # the row decides the time, the time decides the row
            rolled = at + readout_s * (xy[:, 1] / (camera.size[1] - 1) - 0.5)
            xy = camera.project(body.centre(rolled))
        return xy

    middle = pixels(0.0)
    if exposure_s == 0:
        return middle, middle
    mean = sum(weight / 2 * pixels(exposure_s / 2 * node) for node, weight in zip(nodes, weights, strict=True))
    return middle, np.asarray(mean)

"""Render one clip: a scene, its hidden effects, a camera and a sensor; its truth is written to files beside it."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path

import numpy as np

from iris_sysid.errors import OutputError
from iris_sysid.io.files import atomic_path, check_writable
from iris_sysid.synthetic.encoder import FORMATS, Encoder
from iris_sysid.synthetic.look import Look
from iris_sysid.synthetic.picture import Picture
from iris_sysid.synthetic.plan import NOTHING, ClipPlan, plan_clip
from iris_sysid.synthetic.sensor import Sensor
from iris_sysid.synthetic.truth import Truth, truth_paths, write_truth
from iris_sysid.types import Progress, with_progress


def render_clip(
    phenomenon: str,
    path: str | Path,
    *,
    effects: Mapping[str, float] = NOTHING,
    size: tuple[int, int] = (1280, 720),
    fps: float = 60.0,
    duration_s: float | None = None,
    seed: int = 0,
    setting: str | None = None,
    overrides: Mapping[str, float] = NOTHING,
    look: Look | None = None,
    progress: Progress | None = None,
    overwrite: bool = False,
) -> Truth:
    """Render a clip of a phenomenon and write its truth beside it.

    The same arguments give the same bytes. The file appears under its name only when it is complete.

    Parameters
    ----------
    phenomenon
        Name of the scene, e.g. ``pendulum``; underscores may stand for hyphens.
    path
        The clip, .mp4, .mov or .mkv. Beside it go .truth.json, .truth.csv and .hidden.json.
    effects
        Size of each hidden effect by name, e.g. ``{"quadratic-drag": 0.08}``; only .hidden.json names them.
    size
        Width and height, px; both even.
    fps
        Frames per second, at most 1000.
    duration_s
        Length of the clip; None: as long as the benchmark's clips of the phenomenon.
    seed
        Decides texture, noise, shaking and dropped frames.
    setting
        One of the benchmark's settings, e.g. ``pendulum_45``.
    overrides
        Parameters of the scene that differ from the setting's, in SI units.
    look
        Appearance of the clip; None is a phone's camera on a tripod.
    progress
        Called with (frames done, frames in all).
    overwrite
        Replace a clip that is there.

    Returns
    -------
    Truth
        The truth that was written beside the clip.

    Raises
    ------
    UnknownNameError
        For a phenomenon, setting, parameter or effect of that name does not exist; lists the names.
    DataError
        For a size, rate, length or number that makes no clip.
    OutputError
        When the clip cannot be written, or exists.

    Examples
    --------
    >>> from iris_sysid import render_clip
    >>> truth = render_clip("pendulum", "clip.mp4", size=(320, 180), duration_s=0.5)
    >>> truth.parameters["length"].unit
    'm'
    """
    clip = check_paths(path, overwrite=overwrite)
    plan = plan_clip(
        phenomenon,
        effects=effects,
        size=size,
        fps=fps,
        duration_s=duration_s,
        seed=seed,
        setting=setting,
        overrides=overrides,
        look=look,
    )
    with film(clip, plan, progress, overwrite=overwrite):
        write_truth(plan.truth, clip, overwrite=True)
    return plan.truth


def check_paths(path: str | Path, *, overwrite: bool) -> Path:
    """The path of a clip, after checking that it and its truth can be written; ``overwrite`` allows existing files."""
    clip = Path(path)
    if clip.suffix.lower() not in FORMATS:
        raise OutputError(f"cannot tell the video format of {clip.name!r}; use one of {', '.join(FORMATS)}")
    for truth_path in (clip, *truth_paths(clip)):
        check_writable(truth_path, overwrite=overwrite)
    return clip


@contextmanager
def film(clip: Path, plan: ClipPlan, progress: Progress | None, *, overwrite: bool) -> Iterator[None]:
    """Render a planned clip; within the block its truth is written; the clip appears when the block ends.

    So a clip exists only when it and its truth are complete.

    Parameters
    ----------
    clip
        Path of the clip.
    plan
        The plan to render.
    progress
        Called with (frames done, frames in all).
    overwrite
        Replace a clip that is there.
    """
    with atomic_path(clip, overwrite=overwrite) as temporary:
        _expose(temporary, plan, progress)
        yield


def _expose(temporary: Path, plan: ClipPlan, progress: Progress | None) -> None:
    """Draw, read out and encode frame after frame."""
    wall_rng, sensor_rng = (np.random.default_rng([plan.seed, k]) for k in (2, 3))
    painter = Picture(plan.stage, plan.camera, plan.look, wall_rng)
    painter.readout_s = plan.readout_s
    sensor = Sensor(plan.camera.size, plan.look, sensor_rng)
    count = len(plan.timing.ticks)
    with Encoder(temporary, plan.camera.size, plan.timing.rate, plan.look) as encoder:
        for k in with_progress(range(count), progress, count):
            frame, arrays = encoder.blank()
            sensor.read(painter.at(float(plan.timing.true_s[k]), plan.shift_px[k]), arrays)
            encoder.write(frame, int(plan.timing.ticks[k]))

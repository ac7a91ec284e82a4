"""Every effect of a camera from pixels to its name: clips whose geometry OpenCV's camera model bends.

``python -m validation.camera_effects`` draws clips of a pendulum and of a throw, each through a camera with one fault:
tilted, with a lens that distorts, with a rolling shutter, with pixels that are not square, moving slowly, or with lost
frames. A pixel is looked up on the plane of motion by ``cv2.undistortPoints`` and a homography, row by row at its own
time; the motion is SciPy's. No formula of the library takes part. The clips are then tracked, observed, fitted and
diagnosed as a user's would be; the pivot is that of the arc. Seeds below 1,000 may be looked at, those of the table are
from 1,000 on.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, field

import cv2
import numpy as np
import pandas as pd
from scipy.interpolate import CubicSpline

from iris_sysid import MODELS, PHENOMENA, Estimate, IrisError, Trajectory, diagnose, observe, scale, track
from iris_sysid.types import Diagnosis, Frame
from validation import pages
from validation.independent.motions import MOTIONS, Array, integrate

SIZE_PX = (320, 240)
RADIUS_PX = 7.0
WALL, BALL, NOISE = 100.0, 160.0, 6.0  # grey levels: a position is known to about 0.02 px
PX_PER_M = 300.0
SEALED = 1_000
SIGMAS = 3.0  # within which a parameter counts as right


@dataclass(frozen=True, slots=True)
class Fault:
    """One fault of a camera: its name in the library, and the range of its size, whose sign is random."""

    name: str
    sizes: tuple[float, float]
    scenes: tuple[str, ...] = ("pendulum", "projectile")
    signed: bool = True


# tilt in rad; k1 of the lens, radius in focal lengths; s from the first row to the last; width over height less 1;
# px/s; frames lost at once. A drift of a throw is a velocity, and so is another scale across: nothing can show them.
FAULTS: tuple[Fault, ...] = (
    Fault("camera-tilt", (0.1, 0.35)),
    Fault("radial-distortion", (0.1, 0.4)),
    Fault("rolling-shutter", (0.01, 0.04)),
    Fault("anisotropic-scale", (0.02, 0.08), ("pendulum",)),
    Fault("camera-drift", (2.0, 8.0), ("pendulum",)),
    Fault("dropped-frame", (1.0, 4.0), signed=False),
)
NO_FAULT = Fault("nothing", (0.0, 0.0))


@dataclass(frozen=True, slots=True)
class Scene:
    """A motion in front of the camera: ``truth`` is the parameter to compare, ``aim_m`` is seen at the centre."""

    phenomenon: str
    truth: str
    free: tuple[str, ...]
    frames: int
    fps: float
    ranges: Mapping[str, tuple[float, float]]
    aim_m: tuple[float, float]


SCENES: Mapping[str, Scene] = {
    "pendulum": Scene(
        "pendulum",
        "length",
        ("vertical",),
        200,
        60.0,
        {"length": (0.45, 0.55), "damping": (0.02, 0.08), "x0": (0.5, 0.8), "v0": (-0.3, 0.3)},
        (0.0, -0.33),
    ),
    "projectile": Scene(
        "projectile",
        "gravity",
        ("gravity",),
        110,
        180.0,
        {"x0": (-0.4, -0.35), "x1": (-0.2, -0.1), "v0": (1.2, 1.4), "v1": (2.4, 2.7)},
        (0.0, 0.05),
    ),
}


@dataclass(frozen=True, eq=False, slots=True)
class Film:
    """Frames in memory: grey images (h, w) at even times of ``fps``."""

    images: Sequence[np.ndarray]
    fps: float
    width: int = field(default=SIZE_PX[0])
    height: int = field(default=SIZE_PX[1])

    @property
    def n_expected(self) -> int:
        """Number of frames."""
        return len(self.images)

    def frames(self) -> Iterator[Frame]:
        """Every frame in order."""
        return (self._frame(index) for index in range(len(self.images)))

    def sample(self, count: int) -> list[Frame]:
        """About ``count`` frames spread evenly."""
        return [self._frame(int(k)) for k in np.unique(np.linspace(0, len(self.images) - 1, count).astype(int))]

    def _frame(self, index: int) -> Frame:
        image = self.images[index]
        return Frame(index, index / self.fps, image, lambda: np.repeat(image[..., None], 3, axis=2))


@dataclass(frozen=True, slots=True)
class Outcome:
    """What became of one clip.

    ``classes`` are the names added, each with those indistinguishable from it; ``incomplete`` is what the result says
    of the model; ``excess`` the residual over the noise; ``off`` the error of the parameter over its standard error;
    ``refused`` why there is no result.
    """

    scene: str
    fault: str
    seed: int
    size: float
    added: tuple[str, ...] = ()
    classes: tuple[tuple[str, ...], ...] = ()
    incomplete: bool = False
    excess: float = float("nan")
    off: float = float("nan")
    relative: float = float("nan")
    refused: str = ""

    @property
    def exact(self) -> bool:
        """Whether the fault's own name is given."""
        return self.fault in self.added

    @property
    def in_class(self) -> bool:
        """Whether it is in the class of one that is given."""
        return any(self.fault in names for names in self.classes)

    @property
    def undetermined(self) -> bool:
        """Whether the result says that it does not know: no fit, or no name for a model that is incomplete."""
        return bool(self.refused) or (not self.added and self.incomplete)

    @property
    def wrong(self) -> bool:
        """Whether a name is given, and none of its class is right."""
        return any(self.fault not in names for names in self.classes)


def plane_seen(fault: str, size: float, focal_px: float) -> Array:
    """Where on the plane of motion (h, w, 2) m, right and down from the axis, each pixel looks.

    Parameters
    ----------
    fault, size
        Of the camera.
    focal_px
        Focal length, px.
    """
    width, height = SIZE_PX
    aspect = 1.0 + (size if fault == "anisotropic-scale" else 0.0)
    matrix = np.array([[focal_px * aspect, 0, (width - 1) / 2], [0, focal_px, (height - 1) / 2], [0, 0, 1.0]])
    lens = np.array([size if fault == "radial-distortion" else 0.0, 0.0, 0.0, 0.0])
    columns, rows = np.meshgrid(np.arange(width, dtype=float), np.arange(height, dtype=float))
    pixels = np.stack([columns, rows], axis=-1).reshape(-1, 1, 2)
    enough = (cv2.TERM_CRITERIA_COUNT | cv2.TERM_CRITERIA_EPS, 100, 1e-12)
    rays = cv2.undistortPoints(pixels, matrix, lens, criteria=enough)
    turn = cv2.Rodrigues(np.array([0.0, size if fault == "camera-tilt" else 0.0, 0.0]))[0]
    to_image = np.column_stack([turn[:, 0], turn[:, 1], [0.0, 0.0, focal_px / PX_PER_M]])
    plane = cv2.perspectiveTransform(rays, np.linalg.inv(to_image))
    return np.asarray(plane.reshape(height, width, 2))


def filmed(scene: Scene, fault: str, size: float, rng: np.random.Generator) -> tuple[Film, float]:
    """A clip of a motion through a camera with a fault, and the true value of the scene's parameter.

    Parameters
    ----------
    scene
        What is filmed.
    fault, size
        Of the camera.
    rng
        Of the motion, of the focal length and of the noise.
    """
    motion = MOTIONS[scene.phenomenon]
    values = {name: float(rng.uniform(*ends)) for name, ends in scene.ranges.items()}
    true_s = np.arange(scene.frames) / scene.fps
    if fault == "dropped-frame":
        true_s[round(rng.uniform(0.2, 0.6) * scene.frames) :] += round(size) / scene.fps
    dense = np.linspace(-0.05, true_s[-1] + 0.05, 8 * scene.frames)
    course = CubicSpline(dense, _places(scene, values, integrate(motion, values, dense)[:, : motion.size]))
    plane = plane_seen(fault, size, focal_px=float(rng.uniform(0.65, 1.0)) * SIZE_PX[0])
    line_s = size / SIZE_PX[1] if fault == "rolling-shutter" else 0.0
    drift = size / PX_PER_M if fault == "camera-drift" else 0.0
    late = line_s * (np.arange(SIZE_PX[1]) - (SIZE_PX[1] - 1) / 2)
    images = []
    for t in true_s:
        centre = course(t + late) + np.array([drift * t, 0.0])  # (h, 2): each row at its own time
        images.append(_painted(plane, centre, rng))
    return Film(images, scene.fps), values.get("length", 9.80665)


def _places(scene: Scene, values: Mapping[str, float], observed: Array) -> Array:
    """Places (n, 2) m on the plane, right and down from the axis."""
    if scene.phenomenon == "pendulum":
        angle, length = observed[:, 0], values["length"]
        observed = np.column_stack([length * np.sin(angle), -length * np.cos(angle)])
    return (observed - np.array(scene.aim_m)) * np.array([1.0, -1.0])


def _painted(plane: Array, centre: Array, rng: np.random.Generator) -> np.ndarray:
    """A bright ball before a wall, with noise."""
    distance_px = PX_PER_M * np.hypot(plane[..., 0] - centre[:, None, 0], plane[..., 1] - centre[:, None, 1])
    covered = np.clip(RADIUS_PX + 0.5 - distance_px, 0.0, 1.0)
    image = WALL + (BALL - WALL) * covered + rng.normal(0.0, NOISE, covered.shape)
    return np.asarray(np.clip(np.rint(image), 0, 255).astype(np.uint8))


def measured(scene: Scene, film: Film) -> Trajectory:
    """The trajectory as the pipeline measures it, with the scale that holds on the axis."""
    tracks = track(film, PHENOMENA[scene.phenomenon].tracker)
    calibration = scale(PX_PER_M, 1.0, px_stderr=PX_PER_M * 1e-3)
    return observe(tracks, calibration, scene.phenomenon, image_size=SIZE_PX)[1]


def outcome(job: tuple[str, Fault, int]) -> Outcome:
    """Film, measure and diagnose one clip of a scene and a fault, by seed."""
    name, fault, seed = job
    scene, rng = SCENES[name], np.random.default_rng([seed, len(name), len(fault.name)])
    size = float(np.exp(rng.uniform(*np.log(fault.sizes)))) if fault.sizes[1] else 0.0
    size *= float(rng.choice([-1.0, 1.0])) if fault.signed else 1.0
    film, truth = filmed(scene, fault.name, size, rng)
    about = (name, fault.name, seed, size)
    try:
        found = diagnose(measured(scene, film), MODELS[scene.phenomenon], free=scene.free)
    except IrisError as error:
        return Outcome(*about, refused=str(error))
    return Outcome(*about, *_findings(found, found.final.estimates[scene.truth], truth))


def _findings(found: Diagnosis, estimate: Estimate, truth: float) -> tuple[object, ...]:
    added = tuple(effect.name for effect in found.added)
    classes = tuple((name, *found.indistinguishable[name]) for name in added)
    error = estimate.value - truth
    off = error / estimate.stderr if estimate.stderr > 0 else float("nan")
    return added, classes, found.incomplete, found.after.fitted / found.noise_floor, off, error / truth


def share(flags: Sequence[bool]) -> str:
    """The share that is true, with the counts."""
    return f"{100 * np.mean(flags):.0f} % ({sum(flags)} of {len(flags)})" if flags else ""


def table(outcomes: Sequence[Outcome]) -> pd.DataFrame:
    """A line for each scene and fault, and one for all faults."""
    hidden = [result for result in outcomes if result.fault != NO_FAULT.name]
    groups = {"all": hidden}
    for result in outcomes:
        groups.setdefault(f"{result.scene}: {result.fault}", []).append(result)
    return pd.DataFrame([_row(label, group) for label, group in groups.items()])


def _row(label: str, group: Sequence[Outcome]) -> dict[str, object]:
    known = [result for result in group if np.isfinite(result.off)]
    clean = group[0].fault == NO_FAULT.name
    return {
        "clips": label,
        "number": len(group),
        "named exactly": "" if clean else share([result.exact for result in group]),
        "in class": "" if clean else share([result.in_class for result in group]),
        "refused, or said to be incomplete": share([result.undetermined for result in group]),
        "named or refused": "" if clean else share([result.in_class or result.undetermined for result in group]),
        "wrong name": share([result.wrong for result in group]),
        f"L or g within {SIGMAS:.0f} sigma": share([abs(result.off) < SIGMAS for result in known]),
        "median error of L or g": f"{100 * np.median([abs(r.relative) for r in known]):.2f} %" if known else "",
    }


def lines(outcomes: Sequence[Outcome]) -> list[str]:
    """A line for each clip that went wrong."""
    return [
        f"  {r.seed} {r.scene}, {r.fault} of {r.size:.3g}: {', '.join(r.added) or 'nothing'} {r.classes}; "
        f"residual {r.excess:.2f}, off {r.off:.1f} sigma = {100 * r.relative:.2f} %; {r.refused}"
        for r in outcomes
        if r.wrong or not abs(r.off) < SIGMAS or not (r.fault == NO_FAULT.name or r.in_class or r.undetermined)
    ]


def jobs(clips: int, first: int, faults: Sequence[Fault]) -> list[tuple[str, Fault, int]]:
    """Scene, fault and seed of each clip; ``clips`` of each scene and fault, from seed ``first`` on."""
    return [(scene, fault, seed) for fault in faults for scene in fault.scenes for seed in range(first, first + clips)]


def main(arguments: Sequence[str] | None = None) -> None:
    """Print the table, and unless the seeds are sealed the clips that went wrong."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--clips", type=int, default=10, help="of each scene and fault")
    parser.add_argument("--first", type=int, default=SEALED, help="first seed")
    parser.add_argument("--workers", type=int, default=1)
    parser.add_argument("--fault", action="append", help="only this one")
    pages.add_option(parser)
    options = parser.parse_args(arguments)
    faults = [fault for fault in (*FAULTS, NO_FAULT) if options.fault is None or fault.name in options.fault]
    every = jobs(options.clips, options.first, faults)
    with pages.table("camera-effects", options.write_docs):
        with ProcessPoolExecutor(options.workers) as pool:
            outcomes = list(pool.map(outcome, every))
        print(pages.markdown(table(outcomes)))
    if options.first < SEALED:
        print("\n".join(lines(outcomes)))


if __name__ == "__main__":
    main()

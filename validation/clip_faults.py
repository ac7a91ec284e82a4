"""What common faults of a clip do to its result: one synthetic pendulum, filmed well and badly.

``python -m validation.clip_faults`` prints the table of ``docs/validation/faults.md``: the length that each clip gives,
beside the true one, and whether the verdict says that something is wrong. ``--pictures`` also draws the pictures of
``docs/guide/your_clip.md``, a multiple exposure of each clip.
"""

from __future__ import annotations

import argparse
import math
import tempfile
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

import cv2
import numpy as np
import pandas as pd

from iris_sysid import ClipOptions, IrisError, open_video, render_clip, run
from iris_sysid.synthetic import Look
from iris_sysid.types import Run
from validation import pages

PICTURES = pages.ROOT / "docs" / "guide" / "your_clip"
SIZE, FPS, DURATION_S = (480, 270), 60.0, 4.0
EXPOSURES = 5  # that a picture lays over each other
SPAN = 0.4  # of a picture: the first part of the clip, in which the body crosses once
JPEG_QUALITY = 80
GREY = 8  # grey levels by which the body differs from the wall


@dataclass(frozen=True, slots=True)
class Fault:
    """A way to film badly: how the clip looks, its frame rate, how it is read, and values of the scene."""

    name: str
    look: Mapping[str, object] = field(default_factory=dict)
    fps: float = FPS
    read_as_fps: float | None = None
    scene: Mapping[str, float] = field(default_factory=dict)


FAULTS = (
    Fault("as it should be"),
    Fault("long exposure", {"exposure_s": 1 / 30}, fps=30.0),
    Fault("few frames a second", fps=10.0),
    Fault("camera leans by 8°", {"roll_deg": 8.0}),
    Fault("camera looks from the side by 25°", {"tilt_deg": (0.0, 25.0)}),
    Fault("lens distorts", {"distortion": (-0.3, 0.0), "hand": False}),
    Fault("hand holds the camera", {"shake_px": 8.0}),
    Fault("dark and noisy", {"read_noise": 14.0}),
    Fault("compressed hard", {"bit_rate": 40e3}),
    Fault("wrong frame rate", read_as_fps=30.0),
)


def main() -> None:
    """Print the table, and draw the pictures where they are asked for."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--pictures", action="store_true", help=f"also write {PICTURES.relative_to(pages.ROOT)}/*.jpg")
    pages.add_option(parser)
    options = parser.parse_args()
    with pages.table("clip-faults", options.write_docs), tempfile.TemporaryDirectory() as folder:
        rows = [measured(fault, Path(folder), pictures=options.pictures) for fault in FAULTS]
        print(pages.markdown(pd.DataFrame(rows)))


def measured(fault: Fault, folder: Path, *, pictures: bool = False) -> dict[str, object]:
    """A row of the table: the fault, the length, how far it is off, and the verdict.

    Parameters
    ----------
    fault
        How the clip is filmed.
    folder
        Gets the clip.
    pictures
        Whether to write the picture of the clip.
    """
    clip = folder / f"{slug(fault.name)}.mp4"
    truth = (
        render_clip(
            "pendulum",
            clip,
            size=SIZE,
            fps=fault.fps,
            duration_s=DURATION_S,
            look=Look(**fault.look),
            overrides=fault.scene,
        )
        .exact("length")
        .value
    )
    if pictures and fault.read_as_fps is None:  # a wrong clock is not to be seen
        PICTURES.mkdir(exist_ok=True)
        cv2.imwrite(
            str(PICTURES / f"{slug(fault.name)}.jpg"), exposures(clip), [cv2.IMWRITE_JPEG_QUALITY, JPEG_QUALITY]
        )
    try:
        result = run(clip, "pendulum", clip=ClipOptions(fps=fault.read_as_fps))
    except IrisError as error:
        return {"clip": fault.name, "length (m)": "", "off": "", "errors off": "", "verdict": str(error)}
    return {"clip": fault.name, **answer(result, truth)}


def answer(result: Run, truth: float) -> dict[str, object]:
    """Length, deviation from the true one in per cent and in standard errors, verdict on number and equation."""
    verdict, length = result.fit.verdict, result.fit.estimates.get("length")
    words = f"{verdict.word}, {'complete' if verdict.complete else 'incomplete'}"
    if length is None:
        return {"length (m)": "", "off": "", "errors off": "", "verdict": words}
    off, digits = length.value - truth, max(1 - math.floor(math.log10(length.stderr)), 0)
    return {
        "length (m)": f"{length.value:.{digits}f} ± {length.stderr:.{digits}f}",
        "off": f"{100 * off / truth:+.2f} %",
        "errors off": f"{off / length.stderr:+.1f}",
        "verdict": words,
    }


def exposures(clip: Path) -> np.ndarray:
    """Frames of the beginning of a clip in one picture (h, w, 3): each pixel from the one that differs most."""
    frames = [frame.bgr().astype(np.int16) for frame in open_video(clip).frames()]
    chosen = [frames[k] for k in np.linspace(0, SPAN * (len(frames) - 1), EXPOSURES).astype(int)]
    median = np.median(frames[:: max(len(frames) // 30, 1)], axis=0)
    picture, furthest = chosen[0].copy(), np.abs(chosen[0] - median).max(axis=2)
    for frame in chosen[1:]:
        distance = np.abs(frame - median).max(axis=2)
        nearer = distance > np.maximum(furthest, GREY)
        picture[nearer], furthest[nearer] = frame[nearer], distance[nearer]
    return picture.astype(np.uint8)


def slug(name: str) -> str:
    """The name of a fault as that of a file."""
    return "-".join("".join(letter if letter.isalnum() else " " for letter in name).split())


if __name__ == "__main__":
    main()

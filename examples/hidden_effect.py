"""From a clip with a hidden effect to the sentence that names it, step by step.

The clip is rendered first, with one of three effects that the pendulum's equation lacks; it is printed at the end.
Run it: python examples/hidden_effect.py [folder] [seed]
"""

import sys
from pathlib import Path

import numpy as np

from iris_sysid import (
    MODELS,
    diagnose,
    diagnosis_sentence,
    estimates_frame,
    fit,
    observe,
    open_video,
    render_clip,
    track,
    uncalibrated,
    write_diagnosis,
)

HIDDEN = (("quadratic-drag", 0.15), ("coulomb-friction", 0.15), ("zero-offset", 0.03))  # 1/rad; rad/s^2; rad


def render(clip: Path, seed: int) -> tuple[str, float]:
    """Render a pendulum with a hidden effect; return the name and size of the effect."""
    name, size = HIDDEN[int(np.random.default_rng(seed).integers(len(HIDDEN)))]
    render_clip(
        "pendulum",
        clip,
        effects={name: size},
        size=(640, 360),
        fps=60.0,
        duration_s=6.0,
        seed=seed,
        overrides={"theta_0": -0.9, "damping": 0.04},
        overwrite=True,
    )
    return name, size


def main(folder: Path, seed: int) -> None:
    """Track, fit, diagnose, and only then print the hidden effect."""
    clip = folder / "pendulum.mp4"
    hidden = render(clip, seed)

    tracks = track(open_video(clip))
    _, angle = observe(tracks, uncalibrated(), "pendulum")

    fitted = fit(angle, MODELS["pendulum"])
    print(estimates_frame(fitted)[["value", "stderr", "unit"]])
    print(f"the fit: {fitted.verdict.text}; residual {fitted.rms[0]:.2g} rad, noise {fitted.noise[0]:.2g} rad")

    diagnosis = diagnose(angle, MODELS["pendulum"])
    print(diagnosis_sentence(diagnosis))
    print("hidden was: {} {:g}".format(*hidden))
    print(f"report: {write_diagnosis(diagnosis, angle, folder / 'diagnosis', overwrite=True)}")


if __name__ == "__main__":
    main(Path(sys.argv[1] if len(sys.argv) > 1 else "hidden-effect"), int(sys.argv[2]) if len(sys.argv) > 2 else 1)

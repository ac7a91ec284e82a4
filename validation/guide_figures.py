"""The figures of the guides on plugins and on several clips, from simulated motions with noise of one seed.

``python -m validation.guide_figures`` writes them into ``docs/guide``. The effect of the guide on plugins is read from
its page, so that the picture shows what the reader has just copied.
"""

from __future__ import annotations

import argparse
import re
from collections.abc import Mapping
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.figure import Figure

from fitters.compose_effects import with_effects
from iris_sysid import EFFECTS, MODELS, OdeModel, Trajectory, diagnose, fit_clips, simulate
from iris_sysid.report.plots import figure_of
from iris_sysid.types import NORMAL_975, Effect
from validation import pages

mpl.use("agg")

FOLDER = pages.ROOT / "docs" / "guide"
RATE_HZ = 60.0
LONG, SHORT = (12.0, 2e-3), (4.0, 3e-2)  # s, rad: a record and its noise; one clip of several, whose errors one sees
SEED = 33
LENGTH_M, CLIPS = 0.5, 8
DAMPING, SCATTER = 0.12, 0.03  # 1/s: mean over clips, standard deviation between them
DPI = 80


def main() -> None:
    """Draw both."""
    argparse.ArgumentParser(description=__doc__).parse_args()
    for name, figure in {"several_clips": clips_figure(), "plugins": own_effect_figure()}.items():
        figure.savefig(FOLDER / f"{name}.png", dpi=DPI)


def swing(
    model: OdeModel, values: Mapping[str, float], record: tuple[float, float], rng: np.random.Generator
) -> Trajectory:
    """The angles of a pendulum with white noise; it begins at rest."""
    seconds, noise_rad = record
    t_s = np.arange(round(RATE_HZ * seconds)) / RATE_HZ
    seen = simulate(model, t_s, {"length": LENGTH_M, "omega_0": 0.0, **values}).observed
    sigma = np.full_like(seen, noise_rad)
    noisy = seen + noise_rad * rng.standard_normal(seen.shape)
    return Trajectory(t_s, model.observed, noisy, sigma, np.ones(t_s.size, dtype=bool))


def clips_figure() -> Figure:
    """The damping of each clip with its interval; the mean over clips and the scatter between them."""
    rng = np.random.default_rng(SEED)
    dampings = DAMPING + SCATTER * rng.standard_normal(CLIPS)
    starts = rng.uniform(0.2, 0.6, CLIPS)
    values = [{"damping": b, "theta_0": angle} for b, angle in zip(dampings, starts, strict=True)]
    clips = [swing(MODELS["pendulum"], one, SHORT, rng) for one in values]
    pooled = fit_clips(clips, "pendulum", shared=["length"])
    each = [clip.estimates["damping"] for clip in pooled.clips]
    population = pooled.population["damping"]
    length, mean, between = pooled.shared["length"], population.mean, population.between.value
    numbers = np.arange(1, CLIPS + 1)
    figure = Figure(figsize=(7.0, 3.4), layout="constrained")
    axes = figure.add_subplot()
    axes.axhspan(mean.value - between, mean.value + between, color="#56B4E9", alpha=0.3, label="scatter between clips")
    axes.axhline(mean.value, color="#0072B2", label=f"mean {mean.value:.3f} ± {mean.stderr:.3f} 1/s")
    bars = [NORMAL_975 * estimate.stderr for estimate in each]
    axes.errorbar(numbers, [estimate.value for estimate in each], bars, fmt="ko", capsize=3, label="clip, 95 %")
    axes.plot(numbers, dampings, "x", color="#D55E00", markersize=9, label="true value")
    axes.set(xlabel="clip", ylabel="damping (1/s)", xticks=numbers)
    axes.set_title(
        f"length, shared: {length.value:.5f} ± {length.stderr:.5f} m (true: {LENGTH_M} m)", fontsize="medium"
    )
    axes.legend(loc="center left", bbox_to_anchor=(1.0, 0.5))
    return figure


def own_effect_figure() -> Figure:
    """The residual of a pendulum before and after the effect of the guide is found."""
    effect = printed_effect()
    model = with_effects("pendulum", [effect])
    clip = swing(model, {"damping": DAMPING, "theta_0": 1.0, "cubic_drag": 0.05}, LONG, np.random.default_rng(SEED))
    return figure_of(diagnose(clip, "pendulum", effects=[*EFFECTS.values(), effect]))


def printed_effect() -> Effect:
    """The effect that the page on plugins prints."""
    page = (FOLDER / "plugins.md").read_text("utf-8")
    blocks = re.findall(r"^```python\n(# my_effects\.py\n.*?)^```$", page, re.MULTILINE | re.DOTALL)
    names: dict[str, Any] = {}
    exec(compile(blocks[0], "my_effects.py", "exec"), names)
    effect = names["cubic_drag"]
    assert isinstance(effect, Effect)
    return effect


if __name__ == "__main__":
    main()

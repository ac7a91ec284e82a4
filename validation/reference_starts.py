"""Usual sizes and starting values for :mod:`validation.reference_fits`, from the samples alone."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from itertools import pairwise

import numpy as np

from validation.reference_least_squares import Experiment, Problem
from validation.reference_motions import GRAVITY, Clip, Motion
from validation.reference_terms import Array, Scales

MAX_SAMPLES, LONG_PERIODS = 600, 3.0  # samples used; periods of the first window of a fit
PIECE_S, MAX_PIECES = 1.2, 6  # of a driven clip
OUTLYING, NORMAL = 8.0, 1.4826  # MAD to standard deviation of a normal


def thinned(t: Array, values: Array, u: Array) -> Clip:
    """Every k-th sample that is there, at most some hundred; one far from both neighbours is left out."""
    there = np.isfinite(values).all(axis=1)
    t, values, u = t[there], values[there], u[there]
    middle = (values[:-2] + values[2:]) / 2
    away = np.abs(values[1:-1] - middle)
    limit = OUTLYING * NORMAL * np.nanmedian(away, axis=0)
    alone = away > np.maximum(limit, 0.02 * np.nanstd(values, axis=0)) + np.abs(values[2:] - values[:-2])
    values[1:-1][alone] = np.nan
    step = max(1, int(np.ceil(t.size / MAX_SAMPLES)))
    inputs = np.convolve(u, np.ones(step) / step, "same") if step > 1 else u
    return Clip(t[::step] - t[0], values[::step], inputs[::step])


def pieces(clip: Clip) -> list[Clip]:
    """A clip cut into short ones of equal length: an arm that is driven over the top is not predictable for long."""
    count = min(max(4, round(clip.t[-1] / PIECE_S)), MAX_PIECES)
    ends = np.linspace(0, clip.t.size, count + 1).astype(int)
    cut = [slice(first, last) for first, last in pairwise(ends)]
    return [Clip(clip.t[each] - clip.t[each][0], clip.values[each], clip.u[each]) for each in cut]


def own_frequency(clip: Clip) -> float:
    """The angular frequency, rad/s, with the largest Fourier component of a clip."""
    good = np.isfinite(clip.values[:, 0])
    grid = np.linspace(clip.t[0], clip.t[-1], clip.t.size)
    values = np.interp(grid, clip.t[good], clip.values[good, 0])
    power = np.abs(np.fft.rfft((values - values.mean()) * np.hanning(values.size), 8 * values.size))
    return 2 * np.pi * np.fft.rfftfreq(8 * values.size, grid[1])[1 + int(np.argmax(power[1:]))]


def sizes(base: Motion, clips: Sequence[Clip]) -> Scales:
    """The usual sizes of a recording."""
    clip = max(clips, key=lambda each: each.t[-1])
    values = np.concatenate([each.values for each in clips])
    reading = float(np.nanmax(np.nanmax(values, axis=0) - np.nanmin(values, axis=0))) / 2
    time = float(clip.t[-1])
    omega = own_frequency(clip) if base.swings else 0.0
    rate = reading * omega if base.swings else 2 * reading / time
    if base.reads == "v":
        speed, place = (reading if base.swings else 2 * reading), (reading / omega if omega else reading * time)
    else:
        speed, place = rate, float(np.nanmax(np.abs(values)))
    if base.degrees == 2 and base.order == 2:
        speed = float(
            np.hypot(*np.nanmedian(np.abs(np.diff(clip.values, axis=0)), axis=0)) / np.median(np.diff(clip.t))
        )
    force = place * omega**2 if base.swings else speed if base.order == 1 else speed / time
    force = GRAVITY if base.start.keys() <= {"gravity"} else force
    if base.driven:
        speed, force = float(np.nanstd(np.gradient(clip.values[:, 0], clip.t))), 10.0
    return Scales(place, speed, force, reading, rate, time, time / 2, omega)


def first_motion(base: Motion, clip: Clip, scales: Scales) -> list[float]:
    """The state at the beginning: by a polynomial through the first quarter of a swing, or through all of a fall."""
    short = 0.3 * 2 * np.pi / scales.omega if base.swings else scales.time
    short = 5.5 * clip.t[1] if base.driven or base.order == 1 else max(short, 5.5 * clip.t[1])
    lines = []
    for column in clip.values.T:
        early = np.isfinite(column) & (clip.t <= short)
        lines.append(np.polyfit(clip.t[early], column[early], 1 if base.order == 1 else 2)[::-1])
    if base.order == 1:
        return [lines[-1][0]] * base.degrees
    if base.reads == "v":
        return [-lines[0][1] / scales.omega**2 if base.swings else 0.0, lines[0][0]]
    return [line[k] for k in (0, 1) for line in lines]


def pulls(base: Motion, clip: Clip, scales: Scales) -> tuple[float, ...]:
    """Starting values of what pulls a swing back, 1/s^2; a wide pendulum swings slower than a narrow one."""
    lengthened = 1.0
    if base.own(np.array([2.0]), 0, 0, {"pull": 1.0})[0] != -2.0:
        angle = min(float(np.nanmax(np.abs(clip.values))), 3.0)
        lengthened = (1 + np.sqrt(np.cos(angle / 2))) ** 2 / 4  # about the mean of 1 and cos that a period goes with
    return tuple(scales.omega**2 * factor**2 / lengthened**2 for factor in (0.94, 0.97, 1.0, 1.03))


def base_fit(base: Motion, clips: Sequence[Clip]) -> tuple[Experiment, list[Problem]]:
    """The fit without any term, and the one with the first terms.

    From several starting values, over windows that grow from a few periods to all.
    """
    experiment = Experiment(base, clips, sizes(base, clips))
    values = {}
    for k, clip in enumerate(clips):
        values |= dict(zip(experiment.starts(k), first_motion(base, clip, experiment.scales), strict=True))
    free = (*base.start, *(name for name in values if not (base.reads == "v" and not base.swings and "/0#" in name)))
    candidates = [values]
    for name, starts in base.start.items():
        several = starts or pulls(base, clips[0], experiment.scales)
        candidates = [{**candidate, name: start} for candidate in candidates for start in several]
    labels = [f"{name}/0" for name in base.first]
    candidates = [{**candidate, **dict.fromkeys(labels, 0.0)} for candidate in candidates]
    problems = []
    for until in windows(base, experiment):
        weights = within(clips, until)
        problems = [Problem(base.first, (*free, *labels), candidate, weights) for candidate in candidates]
        experiment.fit(problems, 40)
        problems.sort(key=lambda problem: problem.cost)
        candidates = [problem.values for problem in problems[: 1 if len(problems) == 1 else 2]]
    begin = {name: value for name, value in candidates[0].items() if name not in labels}
    plain = Problem((), free, begin, within(clips, np.inf))
    experiment.fit([plain], 40)
    if base.measured:
        plain = with_geometry(plain, base.measured)
        experiment.fit([plain], 40)
    return experiment, [plain, *problems[: 1 if labels else 0]]


def with_geometry(plain: Problem, measured: Mapping[str, float]) -> Problem:
    """The problem with what was measured of the picture free as well, within its standard errors."""
    used = plain.weights > 0
    rms = float(np.sqrt(np.mean(plain.residual[used] ** 2)))
    prior = {name: stderr / rms for name, stderr in measured.items()}
    return Problem((), (*plain.free, *measured), {**plain.values, **dict.fromkeys(measured, 0.0)}, plain.weights, prior)


def windows(base: Motion, experiment: Experiment) -> list[float]:
    """Ends, s, of the windows over which the base model is fitted, each twice as long."""
    time = experiment.scales.time
    first = LONG_PERIODS * 2 * np.pi / experiment.scales.omega if base.swings else time / 8 if base.driven else time
    count = max(0, int(np.ceil(np.log2(time / first))))
    return [*(first * 2.0**k for k in range(count)), np.inf]


def within(clips: Sequence[Clip], until: float) -> Array:
    """Weights (n,) of the readings: one for those that are there before a moment."""
    return np.concatenate([(np.isfinite(clip.values) & (clip.t <= until)[:, None]).ravel() for clip in clips]).astype(
        float
    )


def looked_for(experiment: Experiment, base: Problem) -> Scales:
    """The sizes with the frequency of a periodic force, and the moment of a step of the clock, that fit best."""
    clip, scales = experiment.clips[0], experiment.scales
    used = base.weights[: clip.values.size] > 0
    residual = base.residual[: clip.values.size][used]
    slopes = base.slopes[: clip.values.size][used]
    basis = np.linalg.qr(slopes / np.maximum(np.linalg.norm(slopes, axis=0), 1e-300))[0]
    t = np.repeat(clip.t, clip.values.shape[1])[used]
    model = experiment.observed[: clip.values.size][used] - residual
    rate = np.gradient(model, t) if clip.values.shape[1] == 1 else model

    def explained(functions: Array) -> float:
        free = functions - basis @ (basis.T @ functions)
        return float(np.sum((np.linalg.qr(free)[0].T @ residual) ** 2))

    lines = allowed_lines(scales)
    waves = [explained(np.column_stack([np.cos(w * t), np.sin(w * t)])) for w in lines]
    moments = np.linspace(-0.45, 0.45, 37)
    jumps = [explained((rate * (scales.along(t) > moment))[:, None]) for moment in moments]
    return replace(scales, line=float(lines[int(np.argmax(waves))]), step=float(moments[int(np.argmax(jumps))]))


def allowed_lines(scales: Scales) -> Array:
    """Angular frequencies, rad/s, of a force away from the motion's own frequency and its double and triple."""
    slowest = 2 * np.pi * 4 / scales.time  # fewer periods imitate a drift
    fastest = 5 * scales.omega if scales.omega else 40 * slowest
    lines = np.arange(slowest, max(fastest, 3 * slowest), slowest / 16)
    own = scales.omega * np.array([1.0, 2.0, 3.0])
    return lines[np.all(np.abs(lines[:, None] - own) > 0.15 * np.maximum(own, 1e-9), axis=1)]

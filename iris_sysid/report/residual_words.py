"""A residual in words: where it is largest, and what it looks like."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from iris_sysid.report.diagnosis_text import size_text
from iris_sysid.types import Array, FitResult, Quantity

NOISE_LIKE = 1.5  # times the noise, up to which a residual is called noise
MIN_SHARE = 0.8  # of the sum of squares in one part of the motion, for that part to be named
ALIKE = 0.5  # of the variance that a simple form must explain to be named
MIN_SAMPLES = 12  # samples from which a form is read
PARTS = 5  # of the time, equal in length; the first and the last are looked at
SPIKES = 0.02  # the share of the samples that may hold most of the sum of squares


@dataclass(frozen=True, slots=True)
class ResidualWords:
    """Time, s, and value, in the observed unit, of the largest residual; what it looks like, in a clause."""

    t_s: float
    value: float
    looks: str


def residual_words(fit: FitResult, k: int) -> ResidualWords | None:
    """Say where the residual of the ``k``-th observed quantity is largest, and what it looks like; None without one."""
    used = fit.used & np.isfinite(fit.residual[:, k])
    if not used.any():
        return None
    t_s, residual = fit.t_s[used], fit.residual[used, k]
    largest = int(np.argmax(np.abs(residual)))
    looks = _looks(fit.model.observed[k], t_s, residual, fit.predicted[used, k], float(fit.noise[k]))
    return ResidualWords(float(t_s[largest]), float(residual[largest]), looks)


def largest_text(words: ResidualWords, unit: str) -> str:
    """Where it is largest, e.g. "largest: -5.9° at 0.58 s"."""
    return f"largest: {size_text(words.value, unit)} at {words.t_s:.2f} s"


def _looks(quantity: Quantity, t_s: Array, residual: Array, motion: Array, noise: float) -> str:
    rms = float(np.sqrt(np.mean(residual**2)))
    if rms == 0:
        return "zero throughout"
    if residual.size >= MIN_SAMPLES and _is_in_few(residual):
        return "almost all in a few samples"
    if noise > 0 and rms < NOISE_LIKE * noise:
        return "no more than noise"
    if residual.size < MIN_SAMPLES:
        return "too few samples to see a form"
    where = _where(quantity, t_s, residual, motion)
    form = _form(t_s, residual, motion)
    return ", ".join(filter(None, [where, form])) or "of no simple form"


def _is_in_few(residual: Array) -> bool:
    """Whether a few samples hold most of the sum of squares: they raise the noise that is estimated, too."""
    power = np.sort(residual**2)
    return bool(power[-max(1, round(SPIKES * power.size)) :].sum() > MIN_SHARE * power.sum())


def _where(quantity: Quantity, t_s: Array, residual: Array, motion: Array) -> str:
    """The part of the motion that holds most of it."""
    power = residual**2 / np.sum(residual**2)
    span = t_s[-1] - t_s[0]
    for inside, name in (
        (t_s <= t_s[0] + span / PARTS, f"mostly in the first {span / PARTS:.2g} s"),
        (t_s >= t_s[-1] - span / PARTS, f"mostly in the last {span / PARTS:.2g} s"),
    ):
        if power[inside].sum() > MIN_SHARE:
            return name
    middle = (motion.min() + motion.max()) / 2
    high, low = _sides(quantity)
    for inside, name in ((motion > middle, high), (motion < middle, low)):
        if 0.2 < inside.mean() < 0.8 and power[inside].sum() > MIN_SHARE:
            return f"almost always {name}"
    return ""


def _sides(quantity: Quantity) -> tuple[str, str]:
    """The two halves of a motion in words, that of large values first."""
    letter = quantity.name[:1]
    if quantity.unit == "rad":
        return "in the right-hand swing", "in the left-hand swing"
    if letter == "x":
        return "on the right", "on the left"
    if letter in ("z", "h"):
        return "in the upper half", "in the lower half"
    return f"while {quantity.name} is large", f"while {quantity.name} is small"


def _form(t_s: Array, residual: Array, motion: Array) -> str:
    """The simple form that explains most of its variance; empty where none explains half."""
    velocity = np.gradient(motion, t_s)
    time = (t_s - t_s.mean()) / np.ptp(t_s)
    turns = np.count_nonzero(np.diff(np.sign(velocity)))
    forms = {
        "it goes with the velocity": velocity,
        "it goes with the position": motion - motion.mean(),
        "it drifts slowly with time": np.stack([time, time**2, time**3]),
        f"it {'swings with' if turns > 1 else 'follows'} the motion, in a size that changes": np.stack(
            [way * time**power for way in (velocity, motion) for power in range(3)]
        ),
    }
    share = {name: _explained(residual, np.atleast_2d(form)) for name, form in forms.items()}
    best = max(share, key=lambda name: share[name])
    return best if share[best] > ALIKE else ""


def _explained(residual: Array, forms: Array) -> float:
    """The fraction of the variance that a sum of forms (f, n) and a constant explain, less what chance explains."""
    columns = np.column_stack([np.ones(residual.size), *(form / (np.std(form) or 1.0) for form in forms)])
    left = residual - columns @ np.linalg.lstsq(columns, residual, rcond=None)[0]
    degrees = residual.size / max(residual.size - columns.shape[1], 1)
    return 1.0 - degrees * float(left @ left) / float(np.sum((residual - residual.mean()) ** 2) or 1.0)

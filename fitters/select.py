"""Choose the governing equation: fit every model of the bank that the observable admits, predict what was held out."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from fitters._readings import (
    UPRIGHT,
    Raw,
    Reading,
    as_trajectory,
    moves_with_its_zero,
    raw_of,
    readings,
    suits,
    together,
)
from fitters._task import select
from fitters.compose import with_effect
from fitters.ode import fit, simulate
from iris_sysid.errors import FitError
from iris_sysid.registry import EFFECTS, MODELS
from iris_sysid.types import Array, Estimate, FitResult, Mask, OdeModel, Trajectory

FITTED = 0.7  # share of the samples, from the first on; the rest is held out
LONGEST = 900  # samples: what tells models apart shows in the first 15 s at 60 Hz
ENOUGH = 400  # samples for a first fit: of more than twice that every second is taken, and so on
ADEQUATE_NOISE, ADEQUATE_MOTION = 3.0, 0.02  # residual below 3 times the noise, or 2 % of the motion
FEWEST = 12  # samples: enough for four unknowns and something to predict
OPEN_ZERO = {"background", "rest"}  # parameters that say where a model counts from
FAR = 1e6  # in units of the noise: a prediction that has run away
NEAR = 10.0  # times the best held-out error: what predicts worse is not fitted to all samples
MOST_ALONE = 3  # bodies that are looked at one by one; models fitted to all samples in any case


@dataclass(frozen=True, eq=False, slots=True)
class Candidate:
    """One model of the bank under one reading of the track.

    ``heldout`` and ``residual``: root mean square, in units of the measurement's noise, of all raw channels over the
    samples held out and over all of them; ``bic`` over all samples. ``fit`` is that of all samples, None when it
    failed; ``adequate`` when its residual is near the noise.
    """

    model: str
    reading: str
    heldout: float
    residual: float
    bic: float
    adequate: bool
    fit: FitResult | None
    note: str = ""


@dataclass(frozen=True, eq=False, slots=True)
class Choice:
    """Models ranked, the best first, and what that says.

    ``chosen`` is None when none of them fits. ``heldout_margin`` is the held-out error of the next model over that of
    the first, ``bic_margin`` how much larger its BIC is.
    """

    chosen: Candidate | None
    ranking: tuple[Candidate, ...]
    heldout_margin: float
    bic_margin: float
    message: str

    @property
    def nearest(self) -> Candidate:
        """The first of the ranking, adequate or not."""
        return self.ranking[0]


def select_model(
    bodies: Trajectory | Sequence[Trajectory], bank: Mapping[str, OdeModel] = MODELS, *, free: Sequence[str] = ()
) -> Choice:
    """Fit the models that the observable admits, and rank them by what they predict of the held-out end.

    A track of x and z (and apparent radius r) in m or px is read as a place, a height, a way along a line, an angle
    about the centre of a circle, and a size. Other quantities are taken as they are, whatever their names: an angle
    may be the angle of any model that observes one. Zeros are not known but for straight down, which is known to 3
    degrees. Of the models whose held-out errors cannot be told apart the one with the smallest BIC is first.

    Parameters
    ----------
    bodies
        One trajectory, or one a body with the same times.
    bank
        Models by name.
    free
        Constants to estimate as well, in the models that have them.

    Returns
    -------
    Choice
        The ranking, and the chosen model unless none of them fits.

    Raises
    ------
    FitError
        When there are too few samples, or no model of the bank can observe this.
    """
    tracks = [bodies] if isinstance(bodies, Trajectory) else list(bodies)
    raws = _raws(tracks)
    known = np.arange(raws[0].t_s.size) < FITTED * raws[0].t_s.size
    motion = float(np.sqrt(np.mean([np.var(raw.channels, axis=0) / raw.noise**2 for raw in raws])))
    trials = [_Trial(raws[0].t_s, known, motion, reading) for reading in _readings_of(raws, known)]
    tried = _all_tried(trials, bank, free)
    tried += _each_alone(raws, known, bank, motion, free) if len(raws) > 1 else []
    if not tried:
        seen = ", ".join(f"{q.name} in {q.unit}" for q in tracks[0].quantities)
        raise FitError(f"no model of the bank observes {len(tracks)} times {seen}: {', '.join(bank)}")
    return _chosen(tried, int((~known).sum()))


def _raws(tracks: Sequence[Trajectory]) -> list[Raw]:
    """The bodies at the samples that all of them have, from the start of the motion on."""
    used = np.logical_and.reduce([select(track, ("motion",)).used for track in tracks])
    index = np.flatnonzero(used)[:LONGEST]
    if index.size < FEWEST:
        raise FitError(f"only {index.size} usable samples, {FEWEST} are needed to choose a model: take a longer clip")
    kept = np.zeros_like(used)
    kept[index] = True
    return [raw_of(track, kept) for track in tracks]


def _readings_of(raws: Sequence[Raw], known: Mask) -> list[Reading]:
    """Readings of one body; of several bodies those that they have in common."""
    if len(raws) == 1:
        return readings(raws[0], known)
    bodies = [{one.name: one for one in readings(raw, known)} for raw in raws]
    found = []
    if all("angle" in body for body in bodies):
        found.append(together([body["angle"] for body in bodies], "angles"))
    if all("way" in body for body in bodies) and len(raws) > 2:
        found.append(_common_ways(raws))
    return found


def _common_ways(raws: Sequence[Raw]) -> Reading:
    """Sideways places of the three bodies that move most, in the order of their places."""
    extent = [float(np.ptp(raw.column("x"))) for raw in raws]
    most = sorted(np.argsort(extent)[-3:].tolist(), key=lambda k: float(raws[k].column("x")[0]))
    parts = []
    for k in most:
        sigma, x, z = raws[k].sigma("x", "z"), raws[k].column("x"), raws[k].column("z")
        rest = (z - z.mean())[:, None] / sigma
        parts.append(Reading("way", x[:, None], (raws[k].unit,), np.array([1 / sigma]), rest, 1))
    return together(parts, "ways")


def _each_alone(
    raws: Sequence[Raw], known: Mask, bank: Mapping[str, OdeModel], motion: float, free: Sequence[str]
) -> list[Candidate]:
    """One-body models for each body by itself: bodies that have nothing to do with one another."""
    per_body = []
    for raw in raws[:MOST_ALONE]:
        trials = [_Trial(raw.t_s, known, motion, reading) for reading in readings(raw, known)]
        per_body.append({(one.model, one.reading): one for one in _all_tried(trials, bank, free)})
    found = []
    for key in per_body[0]:
        parts = [body[key] for body in per_body if key in body]
        if len(parts) < len(per_body):
            continue
        heldout, residual = (
            float(np.sqrt(np.mean([getattr(one, name) ** 2 for one in parts]))) for name in ("heldout", "residual")
        )
        adequate, bic = all(one.adequate for one in parts), float(np.sum([one.bic for one in parts]))
        found.append(Candidate(key[0], f"{key[1]}, each alone", heldout, residual, bic, adequate, parts[0].fit))
    return found


# --------------------------------------------------------------------------- one candidate


@dataclass(frozen=True, eq=False, slots=True)
class _Trial:
    """A reading at its times (n,), of which ``known`` (n,) are fitted first; ``motion`` in units of the noise."""

    t_s: Array
    known: Mask
    motion: float
    reading: Reading


@dataclass(frozen=True, eq=False, slots=True)
class _Begun:
    """A model fitted to the first part of a reading, and the error of what it predicts."""

    trial: _Trial
    model: OdeModel
    name: str
    options: Mapping[str, Any]
    first: FitResult
    heldout: float


def _all_tried(trials: Sequence[_Trial], bank: Mapping[str, OdeModel], free: Sequence[str]) -> list[Candidate]:
    """Fit every model that suits a reading to its first part; those that predict best, to all of it."""
    tried: list[Candidate] = []
    begun: list[_Begun] = []
    for trial in trials:
        for model in bank.values():
            if suits(model, trial.reading):
                one = _begun(model, trial, free)
                if isinstance(one, _Begun):
                    begun.append(one)
                else:
                    tried.append(one)
    begun.sort(key=lambda one: one.heldout)
    near = NEAR * begun[0].heldout if begun else 0.0
    for k, one in enumerate(begun):
        tried.append(_finished(one) if k < MOST_ALONE or one.heldout <= near else _left_behind(one))
    return tried


def _begun(model: OdeModel, trial: _Trial, free: Sequence[str]) -> _Begun | Candidate:
    adapted, options = _adapted(model, trial.reading, free)
    every = max(1, trial.t_s.size // ENOUGH)
    whole = as_trajectory(trial.t_s, trial.reading, adapted)
    some = {name: getattr(whole, name)[::every] for name in ("t_s", "position", "sigma")}
    part = whole.with_(**some, valid=trial.known[::every])
    try:
        first = fit(part, adapted, multistart=0, **options)
    except FitError as error:
        return _no_candidate(model, trial.reading, str(error))
    if not first.usable:
        return _no_candidate(model, trial.reading, f"{first.status}: {first.message}")
    heldout = _rms(trial.reading, _prediction(adapted, first, trial.t_s), ~trial.known)
    return _Begun(trial, adapted, model.name, options, first, heldout)


def _finished(begun: _Begun) -> Candidate:
    """Fit all samples, from where the first part led."""
    trial, reading = begun.trial, begun.trial.reading
    start = {name: begun.first.estimates[name].value for name in begun.first.free}
    whole = as_trajectory(trial.t_s, reading, begun.model)
    full = fit(whole, begun.model, start=start, nearby=True, **begun.options)
    if not full.usable:
        return Candidate(
            begun.name, reading.name, begun.heldout, np.inf, np.inf, False, None, f"{full.status}: {full.message}"
        )
    residual = _rms(reading, full.predicted, np.ones_like(trial.known))
    n = reading.quantities.size + reading.rest.size
    count = len(full.free) + reading.count
    bic = n * float(np.log(max(residual, 1e-6) ** 2)) + count * float(np.log(n)) + _pulls(full, begun.options)
    adequate = residual <= max(ADEQUATE_NOISE, ADEQUATE_MOTION * trial.motion)
    return Candidate(begun.name, reading.name, begun.heldout, residual, bic, adequate, full)


def _left_behind(begun: _Begun) -> Candidate:
    """What predicts far worse than others is not fitted any further."""
    reading = begun.trial.reading
    residual = _rms(reading, _prediction(begun.model, begun.first, begun.trial.t_s), np.ones_like(begun.trial.known))
    return Candidate(
        begun.name, reading.name, begun.heldout, residual, np.inf, False, begun.first, "predicts far worse"
    )


def _no_candidate(model: OdeModel, reading: Reading, why: str) -> Candidate:
    return Candidate(model.name, reading.name, np.inf, np.inf, np.inf, False, None, why)


def _adapted(model: OdeModel, reading: Reading, free: Sequence[str]) -> tuple[OdeModel, dict[str, Any]]:
    """The model with its zero left open, and what else the reading leaves open or knows."""
    names = {parameter.name for parameter in model.parameters}
    fixed: dict[str, float | Estimate] = {name: one for name, one in reading.known.items() if name in names}
    if "pivot_x" in names or "angle" in names:  # what the model estimates itself, or needs for derived numbers only
        fixed = {name: one for name, one in fixed.items() if name not in ("pivot_x", "pivot_z")}
    opened = [name for name in free if name in names and name not in fixed]
    opened += ["gravity"] if reading.name in ("height", "place") and _holds_gravity(model) else []
    upright = [name for name in names if name == "vertical" or name.startswith("vertical_")]
    fixed |= {name: Estimate(0.0, UPRIGHT, "rad", source="a camera held upright") for name in upright}
    opened += sorted(upright)
    if names & OPEN_ZERO:
        opened += sorted(names & OPEN_ZERO)
    elif not upright and model.observe is None and not model.events and not moves_with_its_zero(model):
        offset = EFFECTS["zero-offset"]
        model = with_effect(model, offset) if offset.applies(model) else model
        if "gravity" in names and model.observed[0].unit == "rad":  # an angle from the vertical
            fixed["zero_offset"] = Estimate(0.0, UPRIGHT, "rad", source="a camera held upright")
            opened.append("zero_offset")
    return model, {"fixed": fixed, "free": opened}


def _holds_gravity(model: OdeModel) -> bool:
    """Whether a model takes gravity for known: then one that estimates it would have the harder task."""
    return any(parameter.name == "gravity" and parameter.constant for parameter in model.parameters)


def _pulls(full: FitResult, options: Mapping[str, Any]) -> float:
    """Squared distances from the priors in their standard errors."""
    priors = {name: one for name, one in options["fixed"].items() if isinstance(one, Estimate)}
    return float(sum(((full.estimates[name].value - one.value) / one.stderr) ** 2 for name, one in priors.items()))


def _prediction(model: OdeModel, first: FitResult, t_s: Array) -> Array:
    """What the fit of the first part says of all samples (n, d)."""
    values = {name: estimate.value for name, estimate in first.estimates.items()}
    return simulate(model, t_s, values).observed


def _rms(reading: Reading, predicted: Array, wanted: Mask) -> float:
    """Root mean square of all raw channels in units of their noise."""
    with np.errstate(all="ignore"):
        moved = (reading.quantities - predicted)[wanted] * reading.lever
        every = np.concatenate([moved.ravel(), reading.rest[wanted].ravel()])
        every = np.where(np.isfinite(every), np.clip(every, -FAR, FAR), FAR)
    return float(np.sqrt(np.mean(every**2)))


# --------------------------------------------------------------------------- the choice


def _chosen(tried: Sequence[Candidate], n_heldout: int) -> Choice:
    """Rank: held-out error first, BIC among those whose held-out errors cannot be told apart."""
    best = min(one.heldout for one in tried)
    alike = best * (1.0 + 3.0 / np.sqrt(2.0 * max(n_heldout, 1)))  # three standard errors of a root mean square
    ranking = sorted(tried, key=lambda one: (one.heldout > alike, one.bic if one.heldout <= alike else one.heldout))
    first = ranking[0]
    others = [one for one in ranking[1:] if one.model != first.model]
    heldout_margin = others[0].heldout / max(first.heldout, 1e-12) if others else np.inf
    bic_margin = others[0].bic - first.bic if others else np.inf
    chosen = first if first.adequate else None
    return Choice(chosen, tuple(ranking), float(heldout_margin), float(bic_margin), _sentence(first, others, chosen))


def _sentence(first: Candidate, others: Sequence[Candidate], chosen: Candidate | None) -> str:
    if chosen is None:
        return (
            f"none of these: the nearest, {first.model} ({first.reading}), leaves {first.residual:.3g} times the noise "
            f"and {first.heldout:.3g} times where it predicts; the bank lacks this equation, or the track is not one "
            "motion"
        )
    text = (
        f"{first.model} ({first.reading}): residual {first.residual:.3g}, held out {first.heldout:.3g} times the noise"
    )
    if others and np.isfinite(others[0].heldout):
        text += f"; next {others[0].model} ({others[0].reading}), held out {others[0].heldout:.3g}"
    return text

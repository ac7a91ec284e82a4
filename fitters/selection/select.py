"""Choose the governing equation: fit every model of the bank that the observable admits, predict what was held out."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from fitters.ode.fit_problem import select
from fitters.selection.candidates import Trial, all_tried
from fitters.selection.observables import ObservableCandidate, Raw, combined, observables_of, raw_of
from iris_sysid.errors import FitError
from iris_sysid.io.one_thread import on_one_thread
from iris_sysid.registry import MODELS
from iris_sysid.types import Mask, ModelCandidate, ModelChoice, OdeModel, Trajectory, departure

FITTED = 0.7  # share of the samples, from the first on; the rest is held out
MAX_SAMPLES = 900  # samples: what tells models apart shows in the first 15 s at 60 Hz
MIN_SAMPLES = 12  # samples: enough for four unknowns and something to predict
MAX_BODIES = 3  # that are looked at together: of more, those that move farthest
CORRELATED = 0.9  # at lag one, and beyond: the residual has the form of a motion, not of noise
STRONG = 6.0  # BIC, of independent samples: less is not strong evidence (Kass and Raftery 1995, J. Am. Stat. Assoc. 90)


@on_one_thread
def select_model(
    bodies: Trajectory | Sequence[Trajectory],
    bank: Mapping[str, OdeModel] | Sequence[str | OdeModel] = MODELS,
    *,
    free: Sequence[str] = (),
) -> ModelChoice:
    """Fit the models that the observable admits, and rank them by what they predict of the held-out end.

    A track of x and z (and apparent radius r) in m or px is taken for a position, a height, a distance along a line, an
    angle about the centre of a circle, and an apparent radius. Other quantities are taken as they are, whatever their
    names: an angle may be the angle of any model that observes one. Zeros are not known but for straight down, which
    is known to 3 degrees. Of the models whose held-out errors are indistinguishable, the one with the smallest BIC is
    first. One whose events never happen comes after the others, and a BIC that is smaller by less than 6 does
    not pay for more numbers, nor for an equation with more unknowns.

    A body that stays in its position is left out, and of more than three those that move farthest are looked at. When
    no equation fits several bodies, one is chosen for the first that moves, until others move too; the observable
    says so.

    Parameters
    ----------
    bodies
        One trajectory, or one a body with the same times.
    bank
        The models, or their names, in a list, or models by name.
    free
        Constants to estimate as well, in the models that have them.

    Returns
    -------
    ModelChoice
        The ranking, and the chosen model unless none of them fits.

    Raises
    ------
    FitError
        When there are too few samples, or no model of the bank can observe this.

    Examples
    --------
    >>> import numpy as np
    >>> from iris_sysid import MODELS, Trajectory, select_model, simulate
    >>> fall, t_s = MODELS["free-fall"], np.arange(60) / 60
    >>> z = simulate(fall, t_s, {"gravity": 9.81, "z_0": 5.0, "vz_0": 0.0}).observed
    >>> z += 1e-3 * np.random.default_rng(0).standard_normal(z.shape)
    >>> clip = Trajectory(t_s, fall.observed, z, np.full_like(z, np.nan), np.ones(60, bool))
    >>> select_model(clip, ["free-fall", "linear-oscillator"]).nearest.model
    'free-fall'
    """
    tracks = [bodies] if isinstance(bodies, Trajectory) else list(bodies)
    if not isinstance(bank, Mapping):
        bank = {model.name: model for model in MODELS.all_resolved(bank)}
    departures = _departures(tracks)
    moving = np.flatnonzero(departures < tracks[0].n).tolist() if len(tracks) > 1 else [0]
    joint = _choice(_raws([tracks[k] for k in _most_moving(tracks, moving or range(len(tracks)))]), bank, free)
    alone = _first_mover(tracks, departures) if len(moving) > 1 and joint.chosen is None else None
    return joint if alone is None else _until_others_move(_choice([alone], bank, free), joint)


def _choice(raws: Sequence[Raw], bank: Mapping[str, OdeModel], free: Sequence[str]) -> ModelChoice:
    """The choice for one body, or for several with the same samples."""
    known = np.arange(raws[0].t_s.size) < FITTED * raws[0].t_s.size
    trials = [Trial(raws[0].t_s, known, _motion(raws), observable) for observable in _observables_of(raws, known)]
    tried = all_tried(trials, bank, free)
    tried += _each_alone(raws, known, bank, free) if len(raws) > 1 else []
    if not tried:
        seen = ", ".join(f"{q.name} in {q.unit or 'numbers'}" for q in raws[0].quantities)
        each = f"{len(raws)} bodies with {seen} each" if len(raws) > 1 else seen
        raise FitError(
            f"no model of the bank observes {each}: write one (--equation), or let iris-sysid discover propose it"
        )
    return _chosen(tried, int((~known).sum()))


def _motion(raws: Sequence[Raw]) -> float:
    """How far the bodies move, root mean square in units of the noise."""
    return float(np.sqrt(np.mean([np.var(raw.channels, axis=0) / raw.noise**2 for raw in raws])))


def _raws(tracks: Sequence[Trajectory]) -> list[Raw]:
    """The bodies at the samples that all of them have, from the start of the motion on."""
    used = np.logical_and.reduce([select(track, ("motion",)).used for track in tracks])
    return [raw_of(track, _first_of(used)) for track in tracks]


def _first_of(used: Mask) -> Mask:
    """The first MAX_SAMPLES of some samples; FitError for too few."""
    index = np.flatnonzero(used)[:MAX_SAMPLES]
    if index.size < MIN_SAMPLES:
        raise FitError(
            f"only {index.size} usable samples, {MIN_SAMPLES} are needed to choose a model: take a longer clip"
        )
    kept = np.zeros_like(used)
    kept[index] = True
    return kept


# --------------------------------------------------------------------------- several bodies


def _departures(tracks: Sequence[Trajectory]) -> NDArray[np.intp]:
    """Sample at which each body leaves its rest position; the number of samples for one at rest, or barely seen."""
    seen = [select(track, ("motion",)).used for track in tracks]
    noise = [
        np.max(raw_of(track, used).noise) for track, used in zip(tracks, seen, strict=True) if used.sum() >= MIN_SAMPLES
    ]
    departures = np.full(len(tracks), tracks[0].n)
    for k, (track, used) in enumerate(zip(tracks, seen, strict=True)):
        index = np.flatnonzero(used)
        gone = departure(track.position[index], float(max(noise, default=0.0)))
        if index.size >= MIN_SAMPLES and gone < index.size:
            departures[k] = index[gone]
    return departures


def _most_moving(tracks: Sequence[Trajectory], moving: Sequence[int]) -> list[int]:
    """Those of the moving bodies that move farthest, in the order given."""
    way = [float(np.max(np.ptp(tracks[k].position[tracks[k].valid], axis=0), initial=0.0)) for k in moving]
    return sorted(moving[k] for k in np.argsort(way, kind="stable")[-MAX_BODIES:])


def _first_mover(tracks: Sequence[Trajectory], departures: NDArray[np.intp]) -> Raw | None:
    """The body that moves first, up to the last exposure before another one moves; None when that is too short."""
    first, second = np.argsort(departures, kind="stable")[:2]
    used = select(tracks[first], ("motion",)).used.copy()
    used[: departures[first]] = used[max(departures[second] - 1, 0) :] = False
    return raw_of(tracks[first], _first_of(used)) if used.sum() >= MIN_SAMPLES else None


def _until_others_move(alone: ModelChoice, joint: ModelChoice) -> ModelChoice:
    """The choice for the first body alone, with the observable named so; the joint choice where nothing fits it."""
    if alone.chosen is None:
        return joint
    ranking = tuple(
        replace(candidate, observable=f"{candidate.observable}, until others move") for candidate in alone.ranking
    )
    return replace(alone, chosen=ranking[0], ranking=ranking, message=_sentence(ranking, ranking[0]))


def _observables_of(raws: Sequence[Raw], known: Mask) -> list[ObservableCandidate]:
    """Observables of one body; for several bodies, those that they have in common."""
    if len(raws) == 1:
        return observables_of(raws[0], known)
    bodies = [{observable.name: observable for observable in observables_of(raw, known)} for raw in raws]
    joint = []
    if all("angle" in body for body in bodies):
        joint.append(combined([body["angle"] for body in bodies], "angles"))
    if all("distance" in body for body in bodies) and len(raws) == MAX_BODIES:
        joint.append(_common_distances(raws))
    return joint


def _common_distances(raws: Sequence[Raw]) -> ObservableCandidate:
    """Sideways positions of bodies, in the order of their positions."""
    parts = []
    for raw in sorted(raws, key=lambda body: float(body.column("x")[0])):
        sigma, x, z = raw.sigma("x", "z"), raw.column("x"), raw.column("z")
        rest = (z - z.mean())[:, None] / sigma
        parts.append(ObservableCandidate("distance", x[:, None], (raw.unit,), np.array([1 / sigma]), rest, 1))
    return combined(parts, "distances")


def _each_alone(
    raws: Sequence[Raw], known: Mask, bank: Mapping[str, OdeModel], free: Sequence[str]
) -> list[ModelCandidate]:
    """One-body models for each body separately, for bodies that do not interact."""
    per_body = []
    for raw in raws:
        trials = [Trial(raw.t_s, known, _motion([raw]), observable) for observable in observables_of(raw, known)]
        per_body.append(
            {(candidate.model, candidate.observable): candidate for candidate in all_tried(trials, bank, free)}
        )
    joint = []
    for key in per_body[0]:
        parts = [body[key] for body in per_body if key in body]
        if len(parts) == len(per_body):
            joint.append(_all_of(key, parts))
    return joint


def _all_of(key: tuple[str, str], parts: Sequence[ModelCandidate]) -> ModelCandidate:
    """One model under one observable, for each body separately."""
    heldout, residual = (
        float(np.sqrt(np.mean([getattr(part, name) ** 2 for part in parts]))) for name in ("heldout", "residual")
    )
    return ModelCandidate(
        model=key[0],
        observable=f"{key[1]}, each alone",
        heldout=heldout,
        residual=residual,
        bic=float(np.sum([part.bic for part in parts])),
        adequate=all(part.adequate for part in parts),
        fit=parts[0].fit,
        count=sum(part.count for part in parts),
        idle=all(part.idle for part in parts),
    )


# --------------------------------------------------------------------------- the choice


def _chosen(tried: Sequence[ModelCandidate], n_heldout: int) -> ModelChoice:
    """Rank: held-out error first, then what the samples show, then BIC.

    A model whose events or rest position are not in the samples is chosen only where no other one is adequate.
    """
    fitted = [
        candidate for candidate in tried if np.isfinite(candidate.bic)
    ] or tried  # to all samples, not only to the first
    fitted = [candidate for candidate in fitted if candidate.adequate and not candidate.idle] or fitted
    best = min(candidate.heldout for candidate in fitted)
    alike = best * (1.0 + 3.0 / np.sqrt(2.0 * max(n_heldout, 1)))  # three standard errors of a root mean square
    near = sorted(
        (candidate for candidate in fitted if candidate.heldout <= alike),
        key=lambda candidate: (candidate.idle, candidate.bic),
    )
    strong = STRONG / _independent(near[0])
    equal = [
        candidate for candidate in near if candidate.idle == near[0].idle and candidate.bic <= near[0].bic + strong
    ]
    first = min(equal, key=lambda candidate: (candidate.count, candidate.unknowns, _unneeded(candidate), candidate.bic))
    far = sorted((candidate for candidate in tried if candidate not in near), key=lambda candidate: candidate.heldout)
    ranking = (first, *(candidate for candidate in near if candidate is not first), *far)
    others = [candidate for candidate in ranking[1:] if candidate.model != first.model]
    heldout_margin = others[0].heldout / max(first.heldout, 1e-12) if others else np.inf
    bic_margin = others[0].bic - first.bic if others else np.inf
    chosen = first if first.adequate else None
    return ModelChoice(chosen, ranking, float(heldout_margin), float(bic_margin), _sentence(ranking, chosen))


def _unneeded(candidate: ModelCandidate) -> int:
    """Number of a model's own values whose intervals hold zero: it says no more than the equation without them."""
    fitted = candidate.fit
    if fitted is None:
        return 0
    own = [each.name for each in fitted.model.with_role("physical") if each.name in fitted.free]
    intervals = [fitted.estimates[name].interval for name in own]
    return sum(low <= 0.0 <= high for low, high in intervals)


def _independent(candidate: ModelCandidate) -> float:
    """Share of a residual's samples that are independent of one another, by its autocorrelation at lag one."""
    correlation = 0.0 if candidate.fit is None else float(np.clip(candidate.fit.correlation, 0.0, CORRELATED))
    return (1.0 - correlation) / (1.0 + correlation)


def _sentence(ranking: Sequence[ModelCandidate], chosen: ModelCandidate | None) -> str:
    first = ranking[0]
    if chosen is None:
        return (
            f"none of these: the nearest, {first.model} ({first.observable}), has a residual of {first.residual:.3g} "
            f"times the noise and a prediction error of {first.heldout:.3g} times; the bank does not have this "
            "equation, or the track is not one motion: write it (--equation), or let iris-sysid discover propose it"
        )
    text = f"{first.model} ({first.observable}): its residual is {first.residual:.3g} times the noise, "
    text += f"and {first.heldout:.3g} times in samples that it did not see"
    others = [candidate for candidate in ranking if candidate.model != first.model]
    if others and np.isfinite(others[0].heldout):
        text += f"; next best: {others[0].model} ({others[0].observable}), {others[0].heldout:.3g} times"
    return text

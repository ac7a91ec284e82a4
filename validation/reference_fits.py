"""What a physicist finds in each real recording: candidate terms, by hand, scored by predicting what was held out.

``python -m validation.reference_fits --folder FOLDER`` fits, with NumPy only, the base model with no term, with each
candidate, with pairs and with the best triples: one free run over the whole clip. Each set is then fitted anew without
one of eight contiguous blocks, and predicts it; of several drops of one ball, the size comes from the other drops. A
set counts as good as the best where its mean squared error is above it by no more than the standard error, over the
blocks, of the difference. Of these, the minimal ones (none of whose parts is as good) support their names and their
components. No code is shared with the fits and the diagnosis of the program; results in ``--folder`` are kept.
"""

from __future__ import annotations

import argparse
import itertools
import json
from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path

import numpy as np

from validation import pages
from validation import reference_starts as starts
from validation.reference_least_squares import Experiment, Problem
from validation.reference_motions import MOTIONS, Clip
from validation.reference_terms import TERMS, Array, physical, waves
from validation.world_recordings import RECORDINGS, Recording, sealed

BLOCKS, GAP = 8, 0.05  # blocks held out in turn, and what is left out beside each, of its length
PAIRS, TRIPLES, GROWN = 12, 6, 3  # sets that are held out, and pairs from which triples are made
FULL_ROUNDS, BLOCK_ROUNDS = 15, 5
HOPELESS = 1e12  # the squared error of a fit that failed
PRICE = 0.15  # by how much each term more must lower the logarithm of the squared error
LITTLE = 0.05  # of the squared error: a difference that nobody would decide by
LOSSES = ("linear-drag", "quadratic-drag", "cubic-drag", "dry-friction", "weakening-friction")


@dataclass(frozen=True)
class Candidate:
    """One set of terms: the root mean squares of its residual and of its prediction, the squares of that by block."""

    terms: tuple[str, ...]
    fitted: float
    heldout: float
    blocks: tuple[float, ...]
    values: dict[str, float]

    @property
    def price(self) -> int:
        """For how many terms it counts."""
        return sum(TERMS[name].price for name in self.terms)

    @property
    def scores(self) -> Array:
        """The squared errors by block, dearer with each term."""
        return np.array(self.blocks) * np.exp(PRICE * self.price)


@dataclass(frozen=True)
class Row:
    """What was found in one recording: all sets that were held out, the best prediction first.

    ``alike``: eight blocks of one clip were held out, as a diagnosis holds them out; not whole clips, or pieces.
    """

    name: str
    unit: str
    samples: int
    alike: bool
    candidates: tuple[Candidate, ...]

    @property
    def nothing(self) -> Candidate:
        """The base model."""
        return next(each for each in self.candidates if not each.terms)

    @property
    def best(self) -> Candidate:
        """The set with the best prediction, the price of its terms included."""
        return min(self.candidates, key=lambda each: each.scores.mean())

    @property
    def margin(self) -> tuple[Candidate, ...]:
        """All sets that predict as well as the best, within the standard error of the difference."""
        return tuple(each for each in self.candidates if as_good(each.scores, self.best.scores))

    @property
    def minimal(self) -> tuple[Candidate, ...]:
        """Those of them of which no part is as good."""
        good = [set(each.terms) for each in self.margin]
        return tuple(each for each in self.margin if not any(part < set(each.terms) for part in good))

    @property
    def chosen(self) -> Candidate:
        """The simplest set as good as the best."""
        return min(self.margin, key=lambda each: (each.price, each.heldout))

    @property
    def removed(self) -> float:
        """The share of the base model's held-out squared error that the chosen set removes."""
        return 1 - (self.chosen.heldout / self.nothing.heldout) ** 2


def as_good(errors: Array, best: Array) -> bool:
    """Whether squared errors by block exceed the best ones by the standard error of the difference, or by little."""
    worse = errors - best
    margin = max(float(worse.std(ddof=1) / np.sqrt(worse.size)), LITTLE * float(best.mean()))
    return float(worse.mean()) <= margin


def supported(row: Row) -> set[str]:
    """The library's names of the effects in the minimal sets."""
    return set().union(*(TERMS[name].effects for each in row.minimal for name in each.terms))


def components(row: Row) -> set[str]:
    """The kinds of component in which the minimal sets lie; empty where nothing predicts as well as the best."""
    return set().union(*(TERMS[name].kinds for each in row.minimal for name in each.terms))


# Fits ---------------------------------------------------------------------------------------------------------------


def experiment_of(recording: Recording) -> tuple[Experiment, list[Problem]]:
    """The base model fitted to the clips of a recording, and what else was fitted on the way."""
    clips = [
        starts.thinned(
            clip.t_s,
            np.where(clip.valid[:, None], clip.position, np.nan),
            np.zeros(clip.n) if clip.inputs is None else clip.inputs[:, 0],
        )
        for clip in recording.clips()
    ]
    base = MOTIONS[recording.model.name]
    experiment, fits = starts.base_fit(base, starts.pieces(clips[0]) if base.driven else clips)
    return replace(experiment, scales=starts.looked_for(experiment, fits[0])), fits


def begins(terms: Sequence[str], known: Sequence[Problem], fits: Sequence[Problem]) -> list[Problem]:
    """Fits to begin with: the best of those that have a part of the terms, and those that were made on the way."""
    parts = [problem for problem in known if set(problem.terms) <= set(terms)]
    return [min(parts, key=lambda problem: problem.cost), *fits[1:]]


def with_terms(base: Problem, terms: Sequence[str], begin: Problem, sigma: float) -> Problem:
    """A set of terms, from the values of another fit."""
    labels = [label for name in terms for label in TERMS[name].names]
    values = {name: begin.values.get(name, 0.0) for name in (*base.values, *labels)}
    if "periodic-force/0" in labels and not values["periodic-force/0"]:
        values["periodic-force/0"] = 1e-3  # of a force of zero the frequency has no slope
    prior = dict.fromkeys(set(labels) & set(TERMS["zero-wander"].names[2:]), sigma)
    return Problem(tuple(terms), (*base.free, *labels), values, base.weights, {**base.prior, **prior})


def is_physical(problem: Problem) -> bool:
    """Whether a fit ended with sizes that a rig or a camera can have; no damping and no rolling drives a motion."""
    terms = [TERMS[name] for name in problem.terms]
    driven = problem.values.get("damping", 0.0) < 0 and any(term.name in LOSSES for term in terms)
    driven |= problem.values.get("rolling", 0.0) < 0
    sizes = all(physical(term, [problem.values[label] for label in term.names]) for term in terms)
    return bool(np.isfinite(problem.cost)) and sizes and not driven


def searched(experiment: Experiment, fits: Sequence[Problem]) -> list[Problem]:
    """The sets that are worth a prediction: none, each term, the best pairs and triples by their residuals."""
    # A wander's cosines are of the size of the residual, of which samples within a half wave are no independent ones.
    base = fits[0]
    alike = base.weights.size / (2 * waves(experiment.scales))
    sigma = 1 / (experiment.scales.reading * np.sqrt(alike))

    def fitted(sets, known):
        problems = [
            with_terms(base, terms, each, sigma) for terms in sets for each in begins(terms, [base, *known], fits)
        ]
        experiment.fit(problems, FULL_ROUNDS)
        problems = list({each.terms: each for each in sorted(problems, key=lambda each: -each.cost)}.values())
        return sorted(filter(is_physical, problems), key=lambda problem: problem.cost)

    names = experiment.base.terms
    singles = fitted([(name,) for name in names], [])
    pairs = fitted(itertools.combinations(names, 2), singles)
    grown = {tuple(sorted({*pair.terms, name})) for pair in pairs[:GROWN] for name in names if name not in pair.terms}
    triples = fitted(sorted(grown), [*singles, *pairs])
    return [base, *singles, *pairs[:PAIRS], *triples[:TRIPLES]]


def block_of(clip: Clip) -> Array:
    """The number of the contiguous block (n,) of each sample."""
    return np.minimum(np.arange(clip.t.size) * BLOCKS // clip.t.size, BLOCKS - 1)


def held_out(clip: Clip, block: int) -> tuple[Array, Array]:
    """Flags (n d,) of the readings of a block, and of those that may be used to predict it."""
    number = block_of(clip)
    inside = np.flatnonzero(number == block)
    beside = int(np.ceil(GAP * inside.size))
    near = np.zeros(clip.t.size, bool)
    near[max(inside[0] - beside, 0) : inside[-1] + beside + 1] = True
    width = clip.values.shape[1]
    return np.repeat(number == block, width), np.repeat(~near, width)


def predicted_blocks(experiment: Experiment, problems: Sequence[Problem]) -> list[list[float]]:
    """Mean squared errors, by set and block, of the samples of one clip that were held out."""
    cuts = [held_out(experiment.clips[0], block) for block in range(BLOCKS)]
    refits = [[anew(problem, problem.weights * outside) for _, outside in cuts] for problem in problems]
    experiment.fit([refit for each in refits for refit in each], BLOCK_ROUNDS)
    return [
        [mean_square(refit, inside, problem.weights) for refit, (inside, _) in zip(each, cuts, strict=True)]
        for problem, each in zip(problems, refits, strict=True)
    ]


def predicted_drops(experiment: Experiment, problems: Sequence[Problem]) -> list[list[float]]:
    """The same for several clips: what they share comes from the others, and only the start from the one held out."""
    sizes = [clip.values.size for clip in experiment.clips]
    owner = np.repeat(np.arange(len(sizes)), sizes)
    errors: list[list[float]] = [[] for _ in problems]
    for k in range(len(sizes)):
        begin = set(experiment.starts(k))
        others = [
            anew(each, each.weights * (owner != k), [n for n in each.free if n not in begin]) for each in problems
        ]
        experiment.fit(others, BLOCK_ROUNDS)
        starts_only = [
            anew(each, base.weights * (owner == k), sorted(begin)) for each, base in zip(others, problems, strict=True)
        ]
        experiment.fit(starts_only, BLOCK_ROUNDS)
        for mine, refit, problem in zip(errors, starts_only, problems, strict=True):
            mine.append(mean_square(refit, owner == k, problem.weights))
    return errors


def anew(problem: Problem, weights: Array, free: Sequence[str] | None = None) -> Problem:
    """The same problem with other weights, and other free values, from its best values."""
    names = problem.free if free is None else tuple(free)
    prior = {name: sigma for name, sigma in problem.prior.items() if name in names}
    return Problem(problem.terms, names, problem.values, weights, prior)


def mean_square(refit: Problem, inside: Array, weights: Array) -> float:
    """The mean squared error of readings that are there; a fit that failed predicts nothing."""
    if refit.residual is None:
        return HOPELESS
    chosen = inside & (weights > 0)
    return float(min(np.mean(np.clip(refit.residual[chosen], -1e6, 1e6) ** 2), HOPELESS)) if chosen.any() else 0.0


def row_of(recording: Recording) -> Row:
    """All of it for one recording."""
    experiment, fits = experiment_of(recording)
    problems = searched(experiment, fits)
    predicted = predicted_blocks if len(experiment.clips) == 1 else predicted_drops
    used = fits[0].weights > 0
    candidates = [
        Candidate(
            each.terms,
            float(np.sqrt(np.mean(each.residual[used] ** 2))),
            float(np.sqrt(np.mean(errors))),
            tuple(errors),
            {name: float(each.values[name]) for name in each.free if not name.startswith("start/")},
        )
        for each, errors in zip(problems, predicted(experiment, problems), strict=True)
    ]
    candidates.sort(key=lambda each: each.heldout)
    return Row(
        recording.name, recording.model.observed[0].unit, int(used.sum()), len(experiment.clips) == 1, tuple(candidates)
    )


# Results ------------------------------------------------------------------------------------------------------------


def kept(recording: Recording, folder: Path) -> Row:
    """The row from the folder, else computed and put there."""
    path = folder / f"{recording.name}.json"
    if not path.exists():
        folder.mkdir(parents=True, exist_ok=True)
        path.write_text(json.dumps(asdict(row_of(recording)), indent=1))
    return read_row(path)


def read_row(path: Path) -> Row:
    """A row as it was written."""
    content = json.loads(path.read_text())
    candidates = [
        Candidate(**{**each, "terms": tuple(each["terms"]), "blocks": tuple(each["blocks"])})
        for each in content["candidates"]
    ]
    return Row(**{**content, "candidates": tuple(candidates)})


def words(sets: Sequence[Candidate]) -> str:
    """Sets of terms as text."""
    return "; ".join(" + ".join(each.terms) or "nothing" for each in sets)


def line(row: Row) -> str:
    """One row of the table."""
    cells = (
        row.name,
        words([row.chosen]),
        ", ".join(sorted(components(row))) or "none",
        f"{row.nothing.heldout:.3g} → {row.chosen.heldout:.3g} (best {row.best.heldout:.3g}) {row.unit}",
        f"{100 * row.removed:.0f} %",
        words([each for each in row.minimal if each is not row.chosen][:6]),
    )
    return f"| {' | '.join(cells)} |"


def main() -> None:
    """Print the table as Markdown."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--folder", type=Path, required=True, help="where results are kept")
    parser.add_argument("--only", default="", help="only recordings whose name contains this")
    parser.add_argument("--sealed", action="store_true", help="the sealed recordings as well")
    pages.add_option(parser)
    options = parser.parse_args()
    with pages.table("reference-fits", options.write_docs):
        print("| recording | simplest set | components | held out: nothing → it | removed | as good, and minimal |")
        print("|---|---|---|---|---|---|")
        for recording in RECORDINGS:
            if options.only in recording.name and (options.sealed or not sealed(recording.name)):
                print(line(kept(recording, options.folder)), flush=True)


if __name__ == "__main__":
    main()

"""What a physicist finds in each real recording: candidate terms, by hand, scored by predicting what was held out.

``python -m validation.reference_fits --folder FOLDER`` fits, with NumPy only, the base model with no term, with each
candidate, with the likeliest pairs and triples: one free run over the samples of the motion. These are cut into nine
blocks. Each but the first, which fixes the initial state, is left out in turn, and predicted by a fit to the rest; of
several drops of one ball, cut into five, the size comes from the other drops. So the program's own held-out errors can
be compared. A set counts as good as the best where its mean squared error is above it by no more than the standard
error, over the blocks, of the difference. Of these, the minimal ones (none of whose parts is as good) support their
names and their components. No code is shared with the fits and the diagnosis of the program; rows in ``--folder`` are
kept, each with what it supports.
"""

from __future__ import annotations

import argparse
import itertools
import json
from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path

import numpy as np

from iris_sysid import Trajectory
from validation import pages
from validation import reference_starts as starts
from validation.reference_least_squares import Experiment, Problem
from validation.reference_motions import MOTIONS, Clip, Motion
from validation.reference_terms import TERMS, Array, Term, physical, waves
from validation.world_recordings import Recording, chosen, sealed

BLOCKS, BLOCKS_OF_SEVERAL = 8, 4  # blocks of a clip held out in turn, and the same where there are several clips
PROMISING, LEADING = 24, 3  # pairs that are fitted: the best to first order, and those with one of the best terms
PAIRS, TRIPLES, GROWN = 12, 6, 2  # sets that are held out, and pairs from which triples are made
FULL_ROUNDS, BLOCK_ROUNDS = 15, 5
HOPELESS = 1e12  # the squared error of a fit that failed
PRICE = 0.15  # by how much each term more must lower the logarithm of the squared error
PIVOT = ("across", "along")
LITTLE = 0.05  # of the squared error: a difference that nobody would decide by
Squares = list[tuple[float, int]]
LOSSES = ("linear-drag", "quadratic-drag", "cubic-drag", "dry-friction", "weakening-friction")


@dataclass(frozen=True)
class Candidate:
    """One set of terms: the root mean squares of its residual and of its prediction, the squares of that by block.

    A block's mean square is multiplied by its number of samples over the mean number.
    """

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
    def meant(self) -> list[Term]:
        """What the terms stand for: a wander of which most is its constant is a zero that is off as well."""
        sizes = [self.values.get(name, 0.0) for name in TERMS["zero-wander"].names]
        slow = np.sqrt(sizes[1] ** 2 / 12 + np.sum(np.square(sizes[2:])) / 2)
        return [TERMS[name] for name in (*self.terms, *(["zero-offset"] if abs(sizes[0]) > slow else []))]

    @property
    def scores(self) -> Array:
        """The squared errors by block, dearer with each term."""
        return np.array(self.blocks) * np.exp(PRICE * self.price)


@dataclass(frozen=True)
class Row:
    """What was found in one recording: all sets that were held out, the best prediction first.

    ``alike``: blocks were held out as a diagnosis holds them out; not pieces of a driven clip.
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
    return set().union(*(term.effects for each in row.minimal for term in each.meant))


def allowed(row: Row) -> set[str]:
    """The same, and those of the set that predicts best, whose terms need not all be needed."""
    return supported(row).union(*(term.effects for term in row.best.meant))


def components(row: Row) -> set[str]:
    """The kinds of component in which the minimal sets lie; empty where nothing predicts as well as the best."""
    return set().union(*(term.kinds for each in row.minimal for term in each.meant))


def places(row: Row) -> set[str]:
    """The same, and the kinds of the set that predicts best; empty where nothing predicts as well as that."""
    return components(row) and components(row).union(*(term.kinds for term in row.best.meant))


# Fits ---------------------------------------------------------------------------------------------------------------


def moving(clip: Trajectory) -> Array:
    """Flags (n,) of the valid samples of the motion; of several motions, with others between, the longest."""
    motion = clip.mask("motion")
    inside = clip.valid & motion
    number = np.cumsum(~motion)
    return inside & (number == np.bincount(number[inside]).argmax())


def sampled(clip: Trajectory) -> Clip:
    """Some hundred samples of the motion of a clip."""
    used = moving(clip)
    inputs = np.zeros(clip.n) if clip.inputs is None else clip.inputs[:, 0]
    return starts.thinned(clip.t_s[used], clip.position[used], inputs[used])


def base_of(recording: Recording, clip: Trajectory) -> Motion:
    """The base model, with what is free in the recording's: of a filmed pendulum the angle at rest and the pivot."""
    base = MOTIONS[recording.model.name]
    if "vertical" not in recording.free:
        return base
    terms = tuple(name for name in base.terms if name != "zero-offset")
    pivot = {name: clip.geometry[f"pivot_{name}"].stderr for name in PIVOT if f"pivot_{name}" in clip.geometry}
    return replace(base, start={**base.start, "vertical": (0.0,)}, terms=terms, measured=pivot)


def experiment_of(recording: Recording) -> tuple[Experiment, list[Problem]]:
    """The base model fitted to the clips of a recording, and what else was fitted on the way."""
    recorded = recording.clips()
    clips, base = [sampled(clip) for clip in recorded], base_of(recording, recorded[0])
    experiment, fits = starts.base_fit(base, starts.pieces(clips[0]) if base.driven else clips)
    return replace(experiment, scales=starts.looked_for(experiment, fits[0])), fits


def begins(terms: Sequence[str], known: Sequence[Problem], fits: Sequence[Problem]) -> list[Problem]:
    """Fits to begin with: the best of those that have a part of the terms, and those that were made on the way."""
    parts = [problem for problem in known if set(problem.terms) <= set(terms)]
    return [min(parts, key=lambda problem: problem.cost), *fits[1:]]


def with_terms(base: Problem, terms: Sequence[str], begin: Problem, sigma: float, imitated: bool = False) -> Problem:
    """A set of terms, from the values of another fit; ``imitated``: a start imitates a constant and a line in time."""
    labels = [label for name in terms for label in TERMS[name].names]
    values = {name: begin.values.get(name, 0.0) for name in (*base.values, *labels)}
    if "periodic-force/0" in labels and not values["periodic-force/0"]:
        values["periodic-force/0"] = 1e-3  # of a force of zero the frequency has no slope
    prior = dict.fromkeys(set(labels) & set(TERMS["zero-wander"].names[2:]), sigma)
    free = [label for label in labels if not (imitated and label in TERMS["zero-wander"].names[:2])]
    return Problem(tuple(terms), (*base.free, *free), values, base.weights, {**base.prior, **prior})


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
    imitated = experiment.base.order == 2 and experiment.base.reads == "x" and not experiment.base.swings

    def fitted(sets, known):
        problems = [
            with_terms(base, terms, each, sigma, imitated)
            for terms in sets
            for each in begins(terms, [base, *known], fits)
        ]
        experiment.fit(problems, FULL_ROUNDS)
        problems = list({each.terms: each for each in sorted(problems, key=lambda each: -each.cost)}.values())
        return sorted(filter(is_physical, problems), key=lambda problem: problem.cost)

    names = experiment.base.terms
    singles = fitted([(name,) for name in names], [])
    pairs = fitted(promising(experiment, with_terms(base, names, base, sigma, imitated), singles), singles)
    grown = {tuple(sorted({*pair.terms, name})) for pair in pairs[:GROWN] for name in names if name not in pair.terms}
    triples = fitted(sorted(grown), [*singles, *pairs])
    return [base, *singles, *pairs[:PAIRS], *triples[:TRIPLES]]


def promising(experiment: Experiment, full: Problem, singles: Sequence[Problem]) -> list[tuple[str, ...]]:
    """The pairs that are worth a fit: the best to first order about the base model, and those with a leading term.

    ``full`` has all terms, none of them with a size yet.
    """
    experiment.evaluate_first(full)
    used = full.weights > 0
    residual, slopes = full.residual[used], full.slopes[used]
    slopes = np.nan_to_num(slopes / np.maximum(np.linalg.norm(slopes, axis=0), 1e-300))
    column = {name: slopes[:, [k]] for k, name in enumerate(full.free)}
    shared = np.linalg.qr(np.hstack([each for name, each in column.items() if is_shared(name)]))[0]
    left = residual - shared @ (shared.T @ residual)
    terms = {}
    for name in full.terms:
        own = np.hstack([column[label] for label in TERMS[name].names if label in column])
        terms[name] = own - shared @ (shared.T @ own)

    def remaining(pair):
        basis = np.linalg.svd(np.hstack([terms[name] for name in pair]), full_matrices=False)
        kept = basis[0][:, basis[1] > 1e-6 * max(basis[1][0], 1e-300)]
        price = sum(TERMS[name].price for name in pair)
        return float(np.log(np.sum((left - kept @ (kept.T @ left)) ** 2)) + PRICE * price)

    every = list(itertools.combinations(full.terms, 2))
    leading = {name for problem in singles[:LEADING] for name in problem.terms}
    best = sorted(every, key=remaining)[:PROMISING]
    return best + [pair for pair in every if leading & set(pair) and pair not in best]


def is_shared(name: str) -> bool:
    """Whether a free value belongs to the base model or to the start of a clip, not to a term."""
    return "/" not in name or name.startswith("start/")


def blocks_of(clip: Clip, count: int) -> list[Array]:
    """Flags (n d,) of the readings of each block that is left out: all but the first of one more, of equal length."""
    number = np.concatenate([np.full(part.size, k) for k, part in enumerate(np.array_split(clip.t, count + 1))])
    return [np.repeat(number == k, clip.values.shape[1]) for k in range(1, count + 1)]


def predicted_blocks(experiment: Experiment, problems: Sequence[Problem]) -> list[Squares]:
    """Mean squared errors and numbers, by set and block, of the samples of one clip that were held out."""
    blocks = blocks_of(experiment.clips[0], BLOCKS)
    refits = [[anew(problem, problem.weights * ~block) for block in blocks] for problem in problems]
    experiment.fit([refit for each in refits for refit in each], BLOCK_ROUNDS)
    return [
        [mean_square(refit, block, problem.weights) for refit, block in zip(each, blocks, strict=True)]
        for problem, each in zip(problems, refits, strict=True)
    ]


def predicted_drops(experiment: Experiment, problems: Sequence[Problem]) -> list[Squares]:
    """The same for several clips: what they share comes from the others, and only the start from the one held out."""
    blocks = [blocks_of(clip, BLOCKS_OF_SEVERAL) for clip in experiment.clips]
    errors = []
    for number in range(BLOCKS_OF_SEVERAL):
        left_out = np.concatenate([each[number] for each in blocks])
        for k, mine in enumerate(owners(experiment)):
            errors.append(by_others(experiment, problems, k, (~mine & ~left_out, mine & ~left_out, mine & left_out)))
    return list(map(list, zip(*errors, strict=True)))


def predicted_pieces(experiment: Experiment, problems: Sequence[Problem]) -> list[Squares]:
    """The same for pieces of a driven clip: each is left out as a whole, but for its start."""
    own = owners(experiment)
    errors = [by_others(experiment, problems, k, (~mine, mine, mine)) for k, mine in enumerate(own)]
    return list(map(list, zip(*errors, strict=True)))


def owners(experiment: Experiment) -> list[Array]:
    """Flags (n,) of the readings of each clip."""
    sizes = [clip.values.size for clip in experiment.clips]
    return [np.repeat(np.arange(len(sizes)) == k, sizes) for k in range(len(sizes))]


def by_others(experiment: Experiment, problems: Sequence[Problem], k: int, flags: Sequence[Array]) -> Squares:
    """The errors of each set in one clip; ``flags`` (n,): what the others show, what shows the start, what counts."""
    seen, own, scored = flags
    begin = set(experiment.starts(k))
    others = [anew(each, each.weights * seen, [name for name in each.free if name not in begin]) for each in problems]
    experiment.fit(others, BLOCK_ROUNDS)
    here = [anew(each, base.weights * own, sorted(begin)) for each, base in zip(others, problems, strict=True)]
    experiment.fit(here, BLOCK_ROUNDS)
    return [mean_square(each, scored, base.weights) for each, base in zip(here, problems, strict=True)]


def anew(problem: Problem, weights: Array, free: Sequence[str] | None = None) -> Problem:
    """The same problem with other weights, and other free values, from its best values."""
    names = problem.free if free is None else tuple(free)
    prior = {name: sigma for name, sigma in problem.prior.items() if name in names}
    return Problem(problem.terms, names, problem.values, weights, prior)


def mean_square(refit: Problem, inside: Array, weights: Array) -> tuple[float, int]:
    """The mean squared error of readings that are there, and how many; a fit that failed predicts nothing."""
    chosen = inside & (weights > 0)
    if refit.residual is None or not chosen.any():
        return (HOPELESS if chosen.any() else 0.0), int(chosen.sum())
    squares = np.clip(refit.residual[chosen], -1e6, 1e6) ** 2
    return float(min(np.mean(squares), HOPELESS)), int(chosen.sum())


def candidate_of(problem: Problem, errors: Squares) -> Candidate:
    """What is kept of a set that was held out."""
    squares, counts = np.array(errors).T
    blocks = squares * counts / counts.mean()
    values = {name: float(problem.values[name]) for name in problem.free if not name.startswith("start/")}
    fitted = float(np.sqrt(np.mean(problem.residual[problem.weights > 0] ** 2)))
    return Candidate(problem.terms, fitted, float(np.sqrt(blocks.mean())), tuple(map(float, blocks)), values)


def has_motion(recording: Recording) -> bool:
    """Whether the equation of a recording is written out here."""
    return recording.model.name in MOTIONS


def row_of(recording: Recording) -> Row:
    """All of it for one recording."""
    experiment, fits = experiment_of(recording)
    problems = searched(experiment, fits)
    driven = experiment.base.driven
    single = len(experiment.clips) == 1
    predicted = predicted_pieces if driven else predicted_blocks if single else predicted_drops
    candidates = map(candidate_of, problems, predicted(experiment, problems))
    every = tuple(sorted(candidates, key=lambda each: each.heldout))
    return Row(recording.name, recording.model.observed[0].unit, int((fits[0].weights > 0).sum()), not driven, every)


# Results ------------------------------------------------------------------------------------------------------------


def kept(recording: Recording, folder: Path) -> Row:
    """The row from the folder, else computed and put there."""
    path = folder / f"{recording.name}.json"
    if not path.exists():
        folder.mkdir(parents=True, exist_ok=True)
        row = row_of(recording)
        path.write_text(json.dumps({**asdict(row), **exported(row)}, indent=1))
    return read_row(path)


def exported(row: Row) -> dict[str, list[str]]:
    """What a row says, for other programs; not read again here, as it follows from the candidates."""
    said = {
        "chosen": row.chosen.terms,
        "supported": supported(row),
        "allowed": allowed(row),
        "components": components(row),
        "places": places(row),
    }
    return {name: sorted(each) for name, each in said.items()}


def read_row(path: Path) -> Row:
    """A row as it was written."""
    content = json.loads(path.read_text())
    candidates = [
        Candidate(**{**each, "terms": tuple(each["terms"]), "blocks": tuple(each["blocks"])})
        for each in content["candidates"]
    ]
    known = {name: content[name] for name in ("name", "unit", "samples", "alike")}
    return Row(**known, candidates=tuple(candidates))


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
    parser.add_argument("--without", default="", help="leave out recordings whose name contains this")
    parser.add_argument("--sealed", action="store_true", help="the sealed recordings as well")
    pages.add_option(parser)
    options = parser.parse_args()
    with pages.table("reference-fits", options.write_docs):
        print("| recording | simplest set | components | held out: nothing → it | removed | as good, and minimal |")
        print("|---|---|---|---|---|---|")
        for recording in chosen(options.only, options.without):
            if has_motion(recording) and (options.sealed or not sealed(recording.name)):
                print(line(kept(recording, options.folder)), flush=True)


if __name__ == "__main__":
    main()

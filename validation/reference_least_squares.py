"""Least squares of :mod:`validation.reference_fits`: many problems at once, each with its own free values and weights.

All problems of a chunk, and all the differences that their derivatives need, are columns of one integration.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field

import numpy as np

from validation.reference_motions import Clip, Motion, course, shown
from validation.reference_terms import TERMS, Array, Scales

COLUMNS = 800  # integrated at once: more do not fit the processor's cache
DIFFERENCE = 1e-6
EASED, STIFFENED, HOPELESS, DONE = 0.2, 6.0, 1e7, 1e-5  # Marquardt's factor, where it ends, and the gain that ends it


@dataclass
class Problem:
    """A set of terms, the names of the free values, all values by name, and the weights (n,) of the residuals.

    ``residual`` (n,), observed - predicted, and ``slopes`` (n, p) are those of the best values so far; ``prior`` has
    the standard deviation of free values that have one, in the unit of a residual of one.
    """

    terms: tuple[str, ...]
    free: tuple[str, ...]
    values: dict[str, float]
    weights: Array
    prior: dict[str, float] = field(default_factory=dict)
    cost: float = np.inf
    residual: Array | None = None
    slopes: Array | None = None
    stiffness: float = 1e-3
    trial: dict[str, float] | None = None
    done: bool = False

    @property
    def own_terms(self) -> tuple[list[str], list[str]]:
        """Its forces and its readings."""
        forces = [name for name in self.terms if TERMS[name].force is not None]
        return forces, [name for name in self.terms if TERMS[name].reading is not None]

    def judge(self, residual: Array, slopes: Array, values: dict[str, float]) -> None:
        """Keep a trial that is better, and go back from one that is worse."""
        used = self.weights > 0
        with np.errstate(all="ignore"):
            cost = self.penalty(values) + float(np.sum(self.weights[used] * residual[used] ** 2))
        cost = cost if np.isfinite(cost) and np.isfinite(slopes[used]).all() else np.inf
        if cost < self.cost:
            self.done = self.cost - cost < DONE * self.cost
            self.cost, self.residual, self.slopes, self.values = cost, residual, slopes, values
            self.stiffness *= EASED
        else:
            self.stiffness *= STIFFENED
            self.done = self.stiffness > HOPELESS

    def penalty(self, values: dict[str, float]) -> float:
        """What the prior adds to the sum of squares."""
        return sum((values[name] / sigma) ** 2 for name, sigma in self.prior.items())

    def step(self) -> dict[str, float]:
        """The next trial by Marquardt's method."""
        if self.slopes is None:
            return self.values
        used = self.weights > 0
        slopes = self.slopes[used] * np.sqrt(self.weights[used])[:, None]
        normal, pull = slopes.T @ slopes, slopes.T @ (self.residual[used] * np.sqrt(self.weights[used]))
        for k, name in enumerate(self.free):
            if name in self.prior:
                normal[k, k] += self.prior[name] ** -2
                pull[k] -= self.values[name] * self.prior[name] ** -2
        size = np.sqrt(np.maximum(np.diag(normal), 1e-30))
        scaled = normal / np.outer(size, size) + self.stiffness * np.eye(size.size)
        change = np.linalg.lstsq(scaled, pull / size, rcond=1e-12)[0] / size
        return {
            **self.values,
            **dict(zip(self.free, (self.values[n] + d for n, d in zip(self.free, change, strict=True)), strict=True)),
        }


@dataclass(frozen=True)
class Experiment:
    """What all problems of a recording share: the base model, the clips, the usual sizes, the readings stacked (n,)."""

    base: Motion
    clips: Sequence[Clip]
    scales: Scales

    @property
    def observed(self) -> Array:
        """All readings of all clips (n,), one after another."""
        return np.concatenate([clip.values.ravel() for clip in self.clips])

    def starts(self, clip: int) -> list[str]:
        """The names of the values at the beginning of a clip."""
        return [f"start/{k}#{clip}" for k in range(self.base.states)]

    def difference(self, name: str, value: float) -> float:
        """By how much a value is changed to see what it does."""
        s = self.scales
        if name.startswith("start/"):
            speed = self.base.order == 2 and int(name[6 : name.index("#")]) >= self.base.degrees
            return DIFFERENCE * (s.v if speed else s.x)
        return DIFFERENCE if "/" in name else DIFFERENCE * max(abs(value), 0.01)

    def moving(self, problem: Problem) -> list[str]:
        """Free values on which the motion depends; the others only scale a reading."""
        return [
            name
            for name in problem.free
            if "/" not in name or name.startswith("start/") or name.split("/")[0] in problem.own_terms[0]
        ]

    def fit(self, problems: Sequence[Problem], rounds: int) -> None:
        """Improve all problems, for at most some rounds each."""
        for _ in range(rounds):
            left = [problem for problem in problems if not problem.done]
            if not left:
                return
            for chunk in self.chunks(left):
                for problem in chunk:
                    problem.trial = problem.step()
                self.evaluate(chunk)

    def evaluate_first(self, problem: Problem) -> None:
        """The residual and the slopes of a problem at the values that it begins with."""
        problem.trial = problem.values
        self.evaluate([problem])

    def chunks(self, problems: Sequence[Problem]) -> Iterator[list[Problem]]:
        """Problems that are integrated together."""
        chunk, columns = [], 0
        for problem in problems:
            more = 1 + len(self.moving(problem))
            if chunk and columns + more > COLUMNS:
                yield chunk
                chunk, columns = [], 0
            chunk.append(problem)
            columns += more
        yield chunk

    def evaluate(self, problems: Sequence[Problem]) -> None:
        """Residuals and slopes of the trials, which each problem keeps or not."""
        columns, steps = [], []
        for problem in problems:
            columns.append(problem.trial)
            for name in self.moving(problem):
                steps.append(self.difference(name, problem.trial[name]))
                columns.append({**problem.trial, name: problem.trial[name] + steps[-1]})
        read, functions = self.predicted(problems, columns)
        at, taken = 0, 0
        for problem in problems:
            moving = self.moving(problem)
            here = read[:, at : at + 1 + len(moving)]
            slope = dict(zip(moving, ((here[:, 1:] - here[:, :1]) / steps[taken : taken + len(moving)]).T, strict=True))
            slopes = [slope[name] if name in slope else functions[name][:, at] for name in problem.free]
            problem.judge(self.observed - here[:, 0], np.array(slopes).T, problem.trial)
            at, taken = at + here.shape[1], taken + len(moving)

    def predicted(self, problems: Sequence[Problem], columns: Sequence[dict[str, float]]) -> tuple[Array, dict]:
        """What is read (n, b) with each column of values, and what each coefficient of a reading multiplies (n, b)."""
        forces, readings = (sorted(set().union(*(problem.own_terms[k] for problem in problems))) for k in (0, 1))
        names = set().union(*columns)
        p = {name: np.array([column.get(name, 0.0) for column in columns]) for name in names}
        for name in (label for each in (*forces, *readings) for label in TERMS[each].names):
            p.setdefault(name, np.zeros(len(columns)))
        read, functions = [], []
        with np.errstate(all="ignore"):
            for k, clip in enumerate(self.clips):
                start = np.array([p[name] for name in self.starts(k)])
                states = course(self.base, clip, forces, self.scales, p, start)
                total, parts = shown(self.base, clip, states, readings, self.scales, p)
                read.append(total.reshape(-1, len(columns)))
                functions.append({name: part.reshape(-1, len(columns)) for name, part in parts.items()})
        return np.concatenate(read), {name: np.concatenate([part[name] for part in functions]) for name in functions[0]}

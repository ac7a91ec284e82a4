"""Sets of parts of a residual, compared by their restricted likelihood and the odds of each part before the data."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from fitters.components.likelihood import Columns, Products, Variances, best_choice, likeliest

BEAM = 3  # sets from which each larger one is made
CLOSE = 3.0  # log units within which two sets explain the data about equally well (20 to 1)

Key = tuple[str, ...]


@dataclass(frozen=True, eq=False, slots=True)
class FoundSet:
    """A set: its log ``evidence``, its ``variances``, and for each part which of its shapes is chosen."""

    evidence: float
    variances: Variances
    chosen: dict[str, int]


@dataclass(eq=False)
class SetSearch:
    """The sets compared so far, for one correlation of the noise.

    ``groups`` holds, by name, the columns of each part, or of each of its rival shapes (one is chosen); ``log_odds``
    those of each part before the data; ``always`` are in every set.
    """

    products: Products
    groups: Mapping[str, list[Columns]]
    log_odds: Mapping[str, float]
    always: tuple[str, ...] = ()
    found: dict[Key, FoundSet] = field(default_factory=dict)

    @property
    def free(self) -> list[str]:
        """The parts that a set may have or not."""
        return [name for name in self.groups if name not in self.always]

    def evidence(self, kinds: Sequence[str]) -> float:
        """Log likelihood of a set, with the odds before the data."""
        key = tuple(sorted(kinds))
        if key not in self.found:
            self.found[key] = self._evaluated(key)
        return self.found[key].evidence

    def _evaluated(self, key: Key) -> FoundSet:
        chosen = {kind: 0 for kind in (*self.always, *key) if len(self.groups[kind]) == 1}
        variances = likeliest(self.products, [self.groups[kind][0] for kind in chosen])
        odds = sum(self.log_odds[kind] for kind in key)
        for kind in [kind for kind in key if kind not in chosen]:
            chosen[kind] = best_choice(self.products, variances, self.groups[kind])
            variances = likeliest(self.products, [self.groups[each][k] for each, k in chosen.items()])
            odds -= float(np.log(len(self.groups[kind])))
        return FoundSet(variances.log_likelihood + odds, variances, chosen)

    def run(self, largest: int) -> None:
        """Grow sets one part at a time from the best few of the size before, then exchange one by one."""
        best: list[Key] = [()]
        for _ in range(largest):
            larger = {tuple(sorted({*key, kind})) for key in best for kind in self.free if kind not in key}
            best = sorted(larger, key=lambda key: -self.evidence(key))[:BEAM]
            if not best or self.evidence(best[0]) < self.evidence(self.top()) - 2 * CLOSE:
                break
        top = self.top()
        for kind in top:
            rest = [each for each in top if each != kind]
            for other in [[], *([each] for each in self.free if each not in top)]:
                self.evidence([*rest, *other])

    def top(self) -> Key:
        """The best set."""
        return max(self.found, key=lambda key: self.found[key].evidence)

    def explanations(self) -> list[tuple[Key, float]]:
        """The sets within a factor of twenty of the best, with their probabilities, the best first."""
        best = self.found[self.top()].evidence
        close = {key: np.exp(each.evidence - best) for key, each in self.found.items() if best - each.evidence < CLOSE}
        total = sum(close.values())
        return [(key, float(close[key] / total)) for key in sorted(close, key=lambda key: -close[key])]

    def variances(self, key: Key) -> Variances:
        """The variances of a set that was compared, in the order given."""
        found = self.found[tuple(sorted(key))]
        place = {kind: k for k, kind in enumerate(found.chosen)}
        order = [place[kind] for kind in (*self.always, *key)]
        groups = tuple(found.variances.groups[k] for k in order)
        return replace(found.variances, groups=groups, variances=found.variances.variances[order])

    def probability(self, kind: str) -> float:
        """The probability that there is such a component, over all sets compared."""
        best = self.found[self.top()].evidence
        weights = {key: float(np.exp(each.evidence - best)) for key, each in self.found.items()}
        return sum(weight for key, weight in weights.items() if kind in key) / sum(weights.values())

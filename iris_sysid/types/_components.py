"""The parts of a residual: what share depends on the velocity, on the position or on time, and what is noise."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal

from iris_sysid.types._arrays import Array
from iris_sysid.types._display import text_of
from iris_sysid.types._numbers import NORMAL_975, Estimate, Quantity

ComponentKind = Literal[
    "force-of-velocity",
    "force-of-position",
    "force-of-time",
    "own-force-drift",
    "pulse",
    "periodic-force",
    "zero-wander",
    "reading-of-position",
    "reading-of-velocity",
    "clock",
    "input",
]
ComponentSide = Literal["force", "reading", "clock", "input"]
SIDES: Mapping[ComponentKind, ComponentSide] = {
    "force-of-velocity": "force",
    "force-of-position": "force",
    "force-of-time": "force",
    "own-force-drift": "force",
    "pulse": "force",
    "periodic-force": "force",
    "zero-wander": "reading",
    "reading-of-position": "reading",
    "reading-of-velocity": "reading",
    "clock": "clock",
    "input": "input",
}
OF_STATE: frozenset[ComponentKind] = frozenset(
    {"force-of-velocity", "force-of-position", "reading-of-velocity", "reading-of-position"}
)


@dataclass(frozen=True, eq=False, slots=True)
class ComponentCurve:
    """A component as a function of its own argument, with its error.

    ``argument`` is the velocity, the position or the time, ``at`` (m,) its values; ``values`` (m, f) the component in
    the units of ``quantities`` (f,), an acceleration for a force, what is observed for a reading, s for a clock;
    ``stderr`` (m, f) its standard error. What the fitted parameters imitate is left out.
    """

    argument: Quantity
    at: Array
    quantities: tuple[Quantity, ...]
    values: Array
    stderr: Array

    @property
    def band(self) -> tuple[Array, Array]:
        """Lower and upper end (m, f) of the pointwise 95 % band."""
        half = NORMAL_975 * self.stderr
        return self.values - half, self.values + half


@dataclass(frozen=True, eq=False, slots=True)
class Component:
    """One part of a residual.

    ``share`` is the fraction of the residual's variance that it explains beyond the likelier components before it, so
    that shares and noise sum to one; ``share_range`` runs over all orders of the components, and over the explanations
    that the data cannot tell apart. ``rms`` is the size of its
    contribution in the observed unit, ``probability`` that there is such a component. ``at`` is the moment of a pulse,
    s, or the frequency of a periodic force, Hz; None for the others. ``similar`` are kinds that can take its place.
    """

    kind: ComponentKind
    share: float
    share_range: tuple[float, float]
    rms: float
    probability: float
    curve: ComponentCurve | None = None
    at: Estimate | None = None
    similar: tuple[ComponentKind, ...] = ()

    @property
    def side(self) -> ComponentSide:
        """Where it lies: in the forces, in the reading, in the clock, or in a measured input."""
        return SIDES[self.kind]

    @property
    def is_of_state(self) -> bool:
        """Whether it depends on the velocity or the position, as a law does, and not on the time."""
        return self.kind in OF_STATE


@dataclass(frozen=True, eq=False, slots=True)
class Components:
    """The additive parts of a residual, largest share first; empty ``parts`` where it is noise.

    ``noise_share`` is the fraction of the residual's variance that no component explains; ``residual_rms``,
    ``noise_rms`` and ``motion_rms`` the root mean squares of the residual, of that rest and of the motion, in ``unit``.
    ``correlation`` is that of the rest over one sample step. ``explanations`` are the sets of components that explain
    the data about equally well, with the probability of each, likeliest first. ``turns``: the motion turns back often
    enough to tell a force from an error of the reading, and the position from the time.
    """

    parts: tuple[Component, ...]
    noise_share: float
    residual_rms: float
    noise_rms: float
    motion_rms: float
    unit: str
    correlation: float
    explanations: tuple[tuple[tuple[ComponentKind, ...], float], ...] = ()
    turns: bool = True

    @property
    def motion_explained(self) -> float:
        """The fraction of the motion's variance that the fitted model explains."""
        return 1.0 - (self.residual_rms / self.motion_rms) ** 2 if self.motion_rms > 0 else float("nan")

    @property
    def side_shares(self) -> dict[ComponentSide, float]:
        """The share of each side, largest first; without those that have none."""
        shares: dict[ComponentSide, float] = {}
        for part in self.parts:
            shares[part.side] = shares.get(part.side, 0.0) + part.share
        return dict(sorted(shares.items(), key=lambda item: -item[1]))

    def named(self, kind: ComponentKind) -> Component | None:
        """The component of that kind; None where there is none."""
        return next((part for part in self.parts if part.kind == kind), None)

    def __repr__(self) -> str:
        parts = [f"{part.kind} {100 * part.share:.0f} %" for part in self.parts]
        return text_of(
            f"Components of a residual of {self.residual_rms:.3g} {self.unit}",
            ", ".join([*parts, f"noise {100 * self.noise_share:.0f} %"]),
        )


FindingWord = Literal["named", "group", "located", "open"]


@dataclass(frozen=True, eq=False, slots=True)
class Finding:
    """The finding on one part of the residual.

    ``named``: the effect and its formula. ``group``: one of ``effects``, which the data do not tell apart. ``located``:
    the component is known, but no formula of the library fits it. ``open``: something is missing, and the data do not
    say where. ``component`` is its kind, None where open; ``effects`` the names, the best first; ``share`` the fraction
    of the residual's variance that it removes in samples that were held out as a whole (NaN where none could be);
    ``reason`` says in a clause why no more than this can be said; empty for ``named``.
    """

    word: FindingWord
    component: ComponentKind | None
    effects: tuple[str, ...]
    share: float
    reason: str = ""

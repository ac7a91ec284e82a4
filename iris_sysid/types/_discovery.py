"""The result of a discovery: the equation, the inclusion of each term, and the matching model of the bank."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from iris_sysid.types._display import Shown, text_of
from iris_sysid.types._model import OdeModel
from iris_sysid.types._numbers import Estimate
from iris_sysid.types._result import FitResult, FitStatus
from iris_sysid.types._verdict import Doubt, Verdict, worst_verdict

EXCHANGEABLE = "A longer clip or a larger motion tells them apart"
STABLE = 0.5  # least inclusion of a term that the resampled data call for as well
UNSURE = "Take a longer clip or a larger motion, or leave the term out of the library"


@dataclass(frozen=True, slots=True)
class DiscoveredTerm:
    """One candidate of the library, in one equation.

    ``coefficient`` is what the trajectory fit makes of it where it is ``selected``, otherwise what it would be if it
    were added to those that are. ``parameter`` names it in the model. ``inclusion`` is the share of resampled data
    sets in which it is selected. ``effect`` is the named effect that adds such a term, empty where there is none.
    """

    equation: str
    term: str
    latex: str
    parameter: str
    coefficient: Estimate
    inclusion: float
    selected: bool
    effect: str = ""


def _weakness(term: DiscoveredTerm) -> str:
    """Why a selected term may not be there; empty where there is no reason."""
    low, high = term.coefficient.interval
    name = f"{term.term} in {term.equation}"
    if term.inclusion < STABLE:
        return f"{name} is selected in {100 * term.inclusion:.0f} % of the resampled data only"
    return f"{name} may be absent: the interval of its coefficient holds zero" if low <= 0.0 <= high else ""


@dataclass(frozen=True, slots=True)
class DiscoveredEquation:
    """One equation as plain text (``lhs``, ``rhs``) and as LaTeX."""

    lhs: str
    rhs: str
    latex: str


@dataclass(frozen=True, slots=True)
class Match:
    """A model of the bank, and what its parameters are if it is the one discovered.

    ``missing`` are terms that the model must have and the discovery has not, ``extra`` those it has beside the
    model's; both are empty for a match. ``same`` names other models of the bank with the same equation.
    """

    model: str
    parameters: Mapping[str, Estimate]
    missing: tuple[str, ...] = ()
    extra: tuple[str, ...] = ()
    same: tuple[str, ...] = ()
    note: str = ""

    @property
    def exact(self) -> bool:
        """Whether the structure is that of the model."""
        return not self.missing and not self.extra


@dataclass(frozen=True, eq=False, slots=True)
class Discovery(Shown):
    """A governing equation found in trajectories.

    ``terms`` holds every candidate of every equation. ``proposed`` names the parameters that the weak-form regression
    proposed, ``model`` is the equation after refinement, ready for the ODE engine, and ``fits`` its fit to each clip.
    ``matched`` is the model of the bank with this structure, ``nearest`` the one that comes nearest where none has.
    ``alternatives`` say which term could be exchanged for which other one without the data telling the difference.
    """

    equations: tuple[DiscoveredEquation, ...]
    terms: tuple[DiscoveredTerm, ...]
    proposed: tuple[str, ...]
    model: OdeModel
    fits: tuple[FitResult, ...]
    matched: Match | None
    nearest: Match | None
    alternatives: tuple[str, ...] = ()
    status: FitStatus = "ok"
    message: str = ""
    origin: Mapping[str, Any] = field(default_factory=dict)

    @property
    def selected(self) -> tuple[DiscoveredTerm, ...]:
        """The terms of the equation."""
        return tuple(term for term in self.terms if term.selected)

    @property
    def verdict(self) -> Verdict:
        """That of the fits; doubtful as well where a term is unsure or could be exchanged for another one."""
        fits = worst_verdict(fitted.verdict for fitted in self.fits)
        unsure = tuple(Doubt("several-names", text, EXCHANGEABLE) for text in self.alternatives)
        weak = (_weakness(term) for term in self.selected)
        unsure += tuple(Doubt("undetermined", text, UNSURE) for text in weak if text)
        return worst_verdict([fits, Verdict("doubtful", unsure)] if unsure else [fits])

    def __repr__(self) -> str:
        bank = f"matches {self.matched.model}" if self.matched is not None else "matches no model of the bank"
        return text_of(
            f"Discovery from {len(self.fits)} clip{'s' * (len(self.fits) > 1)}: {self.verdict.text}",
            "; ".join(f"{equation.lhs} = {equation.rhs}" for equation in self.equations),
            bank,
        )

"""The result of model selection: the models of the bank, ranked by their prediction error."""

from __future__ import annotations

import math
from dataclasses import dataclass

from iris_sysid.types._display import text_of
from iris_sysid.types._result import FitResult
from iris_sysid.types._verdict import Completeness, Doubt, Verdict, worst_verdict

FAR = 2.0  # times the noise: a held-out error of many samples that noise alone does not give
FAR_VALUES = 3.5  # times what the errors of a few fitted values give: of right equations 1 in 25 of 15 samples is above


@dataclass(frozen=True, eq=False, slots=True)
class ModelCandidate:
    """One model of the bank under one observable of the track.

    ``observable`` is the interpretation of the track, e.g. ``angle``. ``heldout`` and ``residual``: root mean square,
    in units of the measurement's noise, of all raw channels over the samples held out and over all of them; ``bic``
    over all samples. ``fit`` is that of all samples, None when it failed; ``adequate`` when its residual is near the
    noise. ``count`` numbers describe the samples: those of the model and of the observable. ``idle``: what the
    model is about is not in these samples (its events, a rest position, gravity), so the data do not test it.
    ``expected`` is the held-out error that the noise and the errors of the fit to the other samples give, 1 where these
    are known well.
    """

    model: str
    observable: str
    heldout: float
    residual: float
    bic: float
    adequate: bool
    fit: FitResult | None
    note: str = ""
    count: int = 0
    idle: bool = False
    expected: float = 1.0

    @property
    def unknowns(self) -> int:
        """Number of fitted values of the equation."""
        return 0 if self.fit is None else len(self.fit.free)


def _poor_prediction(chosen: ModelCandidate) -> Doubt | None:
    """A doubt where the held-out error is far above what the noise explains; None otherwise."""
    usual = math.sqrt(FAR**2 + FAR_VALUES**2 * (chosen.expected**2 - 1.0))
    if not chosen.heldout > usual:
        return None
    finding = f"{chosen.model} predicts what was held out with an error of {chosen.heldout:.3g} times the noise, "
    finding += f"where up to {usual:.2g} would be usual"
    return Doubt("poorly-predicted", finding, "The equation may lack an effect: look at the residual, or diagnose it")


@dataclass(frozen=True, eq=False, slots=True)
class ModelChoice:
    """The ranked models, the best first, and the choice.

    ``chosen`` is None when none of them fits. ``heldout_margin`` is the held-out error of the next model over that of
    the first, ``bic_margin`` how much larger its BIC is.
    """

    chosen: ModelCandidate | None
    ranking: tuple[ModelCandidate, ...]
    heldout_margin: float
    bic_margin: float
    message: str

    @property
    def nearest(self) -> ModelCandidate:
        """The first of the ranking, adequate or not."""
        return self.ranking[0]

    @property
    def verdict(self) -> Verdict:
        """That of the first model's fit; doubtful where it predicts poorly, or where no model fits."""
        fitted = self.nearest.fit
        own = Verdict("failed") if fitted is None else fitted.verdict
        if self.chosen is not None:
            poor = _poor_prediction(self.chosen)
            return own if poor is None else worst_verdict([own, Verdict("doubtful", (poor,))])
        incomplete = Completeness(float("nan") if fitted is None else fitted.explained, complete=False)
        return worst_verdict([own, Verdict("doubtful", (Doubt("incomplete", self.message, ""),), incomplete)])

    def __repr__(self) -> str:
        return text_of(
            f"ModelChoice: {self.chosen.model if self.chosen is not None else 'none of these'}",
            f"ranking: {', '.join(candidate.model for candidate in self.ranking)}",
            self.message,
        )

"""A sentence for every term of a page that one has to know."""

from __future__ import annotations

import re
from collections.abc import Mapping

TERMS: Mapping[str, str] = {
    "residual": "What was measured less what the fitted equation predicts at the same moment.",
    "noise": "Random scatter of the measurement, estimated without the equation; no residual can be smaller.",
    "standard error": "The number after ±: it holds the truth in 2 of 3 measurements, twice it in 19 of 20.",
    "95 % interval": "The range that holds the true value in 19 of 20 such measurements.",
    "usable": "There is no evidence against the number: it can be used with its standard error.",
    "doubtful": "Some evidence says that the number may be wrong, or that the data do not determine it.",
    "equation complete": "The residual is no more than noise, as far as these data can show.",
    "equation incomplete": "The residual is more than noise: the equation lacks something, for which the errors allow.",
    "rms": "Root mean square: the typical size of a quantity that scatters about zero.",
    "held out": "Samples that the fit did not see; predicting them is the test that an effect is real.",
    "held-out": "Of samples that the fit did not see; predicting them is the test that an effect is real.",
    "share": "The part of the residual's variance (mean square) that something explains.",
    "drag": "A force against the motion that grows with the speed; quadratic drag grows with its square, as in air.",
    "damping": "A loss in proportion to the speed; its value is a rate in 1/s.",
    "wander of the zero": "A slow change of what is read at rest: the support, the camera or the sensor moves.",
    "systematic": "Common to all samples of the clip: more samples do not reduce it.",
    "model discrepancy": "How far the value may be off because the equation lacks something.",
    "uncertainty budget": "How much each source of error contributes to a standard error (GUM).",
    "identifiability": "Whether the data tell the parameters apart.",
    "score test": "A quick test of an effect from the first fit alone, without fitting again.",
    "autocorrelation": "How much a sample resembles the one before it; 0 for pure noise.",
    "normalised innovation squared": "How far samples lie from the filter's prediction, in its errors; 1 is right.",
    "nuisance": "An effect that is in the fit because it improves the prediction, but has no name in the result.",
}


def terms_in(text: str) -> dict[str, str]:
    """The terms that occur in a text, each with its sentence."""
    low = text.lower()
    return {term: said for term, said in TERMS.items() if re.search(rf"\b{re.escape(term)}\b", low)}

"""The additive parts of a residual: force, reading, clock, input and noise, estimated together."""

from fitters.components.layout import ClipResidual as ClipResidual
from fitters.components.marginal import marginal as marginal
from fitters.components.over_curves import log_odds_over_curves as log_odds_over_curves
from fitters.components.rank import RankedSet as RankedSet
from fitters.components.rank import ranked_sets as ranked_sets
from fitters.components.split import split as split

"""Whether an effect explains more than a curve of any shape: its formula is evidence then, whatever it can imitate."""

from types import SimpleNamespace

import numpy as np
import pytest

from fitters.components import log_odds_over_curves
from iris_sysid import MODELS
from iris_sysid.diagnosis.diagnose import diagnose
from iris_sysid.diagnosis.evidence import DECISIVE
from iris_sysid.diagnosis.residual_components import clip_residual
from iris_sysid.registry import EFFECTS
from iris_sysid.types import Trajectory
from tests.diagnosis.test_hold_out import table
from tests.diagnosis.test_open_world import motion
from validation.blind_independent import trajectory_of
from validation.independent.cases import draw_case


def log_odds(clip: Trajectory, name: str) -> float:
    """Of one effect, fitted alone, over curves."""
    found = diagnose(clip, "pendulum", effects=[name])
    residuals = [
        [clip_residual(SimpleNamespace(trajectory=clip), fitted) for fitted in fits]
        for fits in (found.bases, found.finals)
    ]
    values = len(found.final.free) - len(found.base.free)
    return log_odds_over_curves(residuals[0], residuals[1], values)


def test_force_of_one_frequency_beats_every_curve_where_it_acts():
    clip = table(motion(lambda t, x, v, base: 0.3 * np.sin(2.3 * t) * np.ones(1)))
    assert 2.0 * log_odds(clip, "periodic-forcing") > DECISIVE


def test_force_of_one_frequency_that_fits_a_part_of_another_force_explains_less_than_a_curve():
    def push(t, x, v, base):
        return 0.4 * np.sin(2.0 * t + 1.5 * np.sin(0.9 * t)) * np.exp(-(((t - 3.0) / 2.0) ** 2)) * np.ones(1)

    assert log_odds(table(motion(push)), "periodic-forcing") < 0.0


def test_each_further_value_costs_half_the_logarithm_of_the_number_of_samples():
    clip = table(motion(lambda t, x, v, base: -0.3 * np.abs(v) * v))
    found = diagnose(clip, "pendulum", effects=["quadratic-drag"])
    before, after = (
        [clip_residual(SimpleNamespace(trajectory=clip), fitted) for fitted in fits]
        for fits in (found.bases, found.finals)
    )
    one, two = (log_odds_over_curves(before, after, values) for values in (1, 2))
    assert one - two == pytest.approx(0.5 * np.log(found.final.used.sum()))


@pytest.mark.parametrize(
    ("seed", "right"), [(57, "radial-distortion"), (69, "dropped-frame")]
)  # throws in which components cannot tell a force from a reading
def test_one_value_that_explains_a_throw_to_the_noise_is_named(seed, right):
    case = draw_case(seed)
    assert case.hidden is not None
    assert right in case.hidden.right
    found = diagnose(trajectory_of(case), MODELS[case.motion.model])
    assert EFFECTS[right].absorbs
    assert [effect.name for effect in found.added] == [right]

"""What a value needs to be known better: against the formula of a mean, and against clips made again."""

import numpy as np
import pytest

from iris_sysid import UnknownNameError, fit, plan
from iris_sysid.diagnosis.planning.precision import Need, needs
from iris_sysid.diagnosis.planning.rivals import Question
from tests.diagnosis.test_planning import PENDULUM, swing


def test_error_of_a_mean_needs_the_square_of_its_ratio():
    """One clip of error 1; n + 1 independent ones have 1 / sqrt(n + 1)."""
    assert needs({"random": 1.0}, 1 / np.sqrt(2), 0.1) == (Need(99),)
    assert needs({"random": 1.0}, 1 / np.sqrt(2), 1.0) == (Need(0),)
    assert needs({"random": 1.0}, 1 / np.sqrt(2), 0.01) == ()


def test_systematic_error_does_not_shrink_with_clips():
    parts = {"random": 0.1, "scale": 1.0, "vertical": 0.1}
    (way,) = needs(parts, 0.1 / np.sqrt(2), 0.5)
    assert (way.clips, way.source) == (0, "scale")
    assert way.factor == pytest.approx(np.sqrt(0.5**2 - 0.1**2 - 0.1**2))
    assert needs(parts, 0.1 / np.sqrt(2), 0.09) == ()


def test_value_without_a_random_error_is_known_well_enough_or_needs_a_better_scale():
    parts = {"random": 0.0, "scale": 1.0}
    assert needs(parts, 0.0, 1.5) == (Need(0),)
    assert needs(parts, 0.0, 0.5) == (Need(0, "scale", 0.5),)
    assert needs(parts, 0.0, 0.001) == ()


def test_both_ways_are_offered_where_either_is_enough():
    few, better = needs({"random": 1.0, "scale": 0.5}, 1 / np.sqrt(2), 0.7)
    assert few == Need(4)  # 1 / 5 + 0.25 < 0.49 < 1 / 4 + 0.25
    assert (better.clips, better.source) == (2, "scale")
    assert better.factor == pytest.approx(2 * np.sqrt(0.49 - 1 / 3))


def test_as_many_clips_as_it_says_give_the_error_that_is_wanted():
    planned = plan(Question(PENDULUM, ()), swing(0.8, drag=0.0))
    today = planned.stderr["length"]
    (way,) = planned.needs("length", today / 2)
    lengths = [fit(swing(0.8, seed=seed, drag=0.0), PENDULUM).estimates["length"] for seed in range(way.clips + 1)]
    together = np.sqrt(1 / sum(length.stderr**-2 for length in lengths))
    assert 0.7 < together / (today / 2) < 1.1  # each error allows for the correlation that its clip happens to show
    assert way.clips in (3, 4)


def test_value_that_clips_do_not_share_is_refused():
    with pytest.raises(UnknownNameError, match="length, damping"):
        plan(Question(PENDULUM, ()), swing(0.8, drag=0.0)).needs("theta_0", 1e-4)

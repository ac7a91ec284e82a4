"""The blind test through video: hidden effects are among those of the scene; outcomes are read back."""

import math

import pytest

from iris_sysid.synthetic import SCENES
from validation import blind_video
from validation.blind import Outcome
from validation.blind_video import LOST, case, secret


@pytest.mark.parametrize("seed", [0, 4, 8])
def test_secret_of_a_clip_is_the_same_each_time_and_can_be_filmed(seed):
    first, again = secret(seed), secret(seed)
    assert first.effects == again.effects
    assert first.factors == again.factors
    assert set(first.effects) <= {LOST, *SCENES[first.scene].effects}
    assert len(first.sizes) == len(first.factors) == len(first.effects) > 0
    assert all(factor > 0 for factor in first.factors)


def test_clip_that_was_diagnosed_is_not_diagnosed_again(monkeypatch, tmp_path):
    outcome = Outcome("pendulum", ("quadratic-drag",), (3.0,), (True,), (math.nan,), ("finite-bob",), (), 1.1)
    chosen = []
    monkeypatch.setattr(blind_video, "_case", lambda seed, folder: chosen.append(seed) or (outcome if seed else None))
    first = [case(tmp_path, seed) for seed in (0, 1)]
    again = [case(tmp_path, seed) for seed in (0, 1)]
    assert chosen == [0, 1]
    assert first[0] is None
    assert again[0] is None
    assert again[1].factors == outcome.factors
    assert again[1].added == outcome.added
    assert math.isnan(again[1].off[0])

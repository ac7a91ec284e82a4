"""The records with hidden effects are those of their equation, and a verdict says what was named."""

from types import SimpleNamespace

import numpy as np
import pytest

from iris_sysid import diagnose, simulate
from validation.driven_hidden import CART, HIDDEN, NOISE_M, VALUES, played, record, word

BY_NAME = {hidden.name: hidden for hidden in HIDDEN}


def test_record_without_an_effect_is_that_of_the_equation():
    clip = record(BY_NAME["nothing"], 7)
    known = {**VALUES, "q_0": 0.0, "q_rate_0": 0.0}
    expected = simulate(CART, clip.t_s, known, inputs=clip.inputs_at(clip.t_s), hold="zero-order").observed
    assert np.std(clip.position - expected) == pytest.approx(NOISE_M, rel=0.1)


@pytest.mark.parametrize("hidden", HIDDEN[1:], ids=lambda hidden: hidden.name)
def test_effect_changes_the_record_by_more_than_its_noise(hidden):
    changed = record(hidden, 7).position - record(BY_NAME["nothing"], 7).position
    assert np.std(changed) > 10 * NOISE_M


def test_play_holds_until_its_side_is_reached():
    assert played(np.array([0.0, 0.4, 1.0, 0.2])) == pytest.approx([0.0, 0.0, 0.5, 0.5])


def found(**rivals):
    """A diagnosis with these names, each with what cannot be told apart from it."""
    names = {name.replace("_", "-"): others for name, others in rivals.items()}
    return SimpleNamespace(added=[SimpleNamespace(name=name) for name in names], indistinguishable=names)


@pytest.mark.parametrize(
    ("hidden", "said", "expected"),
    [
        ("cogging", found(cogging=()), "named"),
        ("cogging", found(impact=("cogging",)), "class"),
        ("cogging", found(impact=()), "extra"),
        ("cogging", found(), "located"),
        ("nothing", found(), "right"),
        ("nothing", found(impact=()), "extra"),
    ],
)
def test_verdict_says_what_was_named(hidden, said, expected):
    assert word(BY_NAME[hidden], said) == expected


@pytest.mark.slow
def test_dry_friction_sharper_than_usual_is_named_and_leaves_the_values():
    said = diagnose(record(BY_NAME["dry friction"], 201), CART)
    assert {effect.name for effect in said.added} == {"coulomb-friction"}
    for name, value in VALUES.items():
        low, high = said.final.estimates[name].interval
        assert low < value < high, name

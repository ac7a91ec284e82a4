"""The class of an effect: the names that hold 99 % of the probability."""

import math
from types import SimpleNamespace

import pytest

from iris_sysid.diagnosis.evidence import CREDIBLE, credible
from iris_sysid.diagnosis.search_report import SearchReport
from iris_sysid.registry import EFFECTS
from validation.blind import hidden_case, outcome


def test_class_holds_the_stated_probability_and_no_name_beyond_it():
    odds = {"drag": 0.90, "friction": 0.085, "tilt": 0.010, "blow": 0.005}
    found = credible({name: -2.0 * math.log(share) for name, share in odds.items()}, "drag")
    assert list(found) == ["drag", "friction", "tilt"]
    assert sum(found.values()) == pytest.approx(1.0)
    assert found["friction"] / found["drag"] == pytest.approx(0.085 / 0.90)


def test_several_unlikely_names_together_belong_to_the_class():
    """Each has odds of 1 to 40, and beyond the class there must be less than 1 %."""
    above = {"drag": 0.0, **{f"rival-{k}": 2.0 * math.log(40.0) for k in range(4)}}
    assert len(credible(above, "drag")) == 5
    assert len(credible({"drag": 0.0, "rival": -2.0 * math.log(0.9 * (1 - CREDIBLE))}, "drag")) == 1


def test_name_that_was_added_is_in_its_class_however_unlikely():
    assert list(credible({"drag": 30.0, "friction": 0.0}, "drag")) == ["friction", "drag"]


def test_criterion_that_is_far_above_has_no_weight_instead_of_a_warning():
    assert credible({"drag": 0.0, "blow": 1e9}, "drag") == {"drag": 1.0}


def test_play_that_is_hardly_seen_is_in_the_class_of_what_explains_it_with_fewer_values():
    made = hidden_case(105, 2)
    assert made.names == ("clearance", "elliptical-swing")
    assert not outcome(made).wrong


def test_effect_that_can_do_exactly_the_same_is_in_the_class_whatever_minimum_its_fit_ended_in():
    """A constant force moves the rest position, as a wrong zero does; beside both the data show neither."""
    library = {name: EFFECTS[name] for name in ("zero-offset", "constant-force", "camera-tilt")}
    rest = SimpleNamespace(parallel=lambda name: ["constant-force", "camera-tilt"])
    report = SearchReport.__new__(SearchReport)
    report._cache = SimpleNamespace(
        library=SimpleNamespace(by_name=library), without=lambda final, effect: None, screening=lambda model: rest
    )
    report._final = SimpleNamespace(fits=[SimpleNamespace(n=100, rms=(1.0,))])
    report._screening = SimpleNamespace(names=["constant-force", "camera-tilt"], visible={"camera-tilt"})
    odds = library["zero-offset"].plausibility / library["constant-force"].plausibility  # each has one value
    assert report._equivalent(library["zero-offset"]) == {"constant-force": pytest.approx(2.0 * math.log(odds))}

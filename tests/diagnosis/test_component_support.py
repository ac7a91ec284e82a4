"""Whether the components of a residual speak for an effect: of its kind, or of one that it can take the place of."""

from dataclasses import replace

import pytest

from iris_sysid.diagnosis.component_support import ComponentSupport, can_cause
from iris_sysid.registry import EFFECTS
from iris_sysid.types import Component, Components

DRAG = EFFECTS["quadratic-drag"]  # force-of-velocity
STIFFNESS = EFFECTS["cubic-stiffness"]  # force-of-position
IMPACT, FORCING = EFFECTS["impact"], EFFECTS["periodic-forcing"]  # these can imitate a piece of anything


def part(kind, share=0.9, most=None, similar=()) -> Component:
    return Component(kind, share, (share, share if most is None else most), 1e-3, 1.0, similar=similar)


def support(*parts, turns=True, driven=False) -> ComponentSupport:
    noise = 1.0 - sum(each.share for each in parts)
    return ComponentSupport(Components(parts, noise, 1e-2, 1e-3, 0.5, "rad", 0.0, turns=turns), driven)


OF_VELOCITY = part("force-of-velocity")
PULSE = part("pulse")


def test_effects_of_these_tests_are_of_the_kinds_they_are_taken_for():
    assert (DRAG.component, STIFFNESS.component) == ("force-of-velocity", "force-of-position")
    assert (IMPACT.component, FORCING.component) == ("pulse", "periodic-force")
    assert not DRAG.absorbs
    assert IMPACT.absorbs
    assert IMPACT.is_flexible


# --------------------------------------------------------------------------- one component and one effect


def test_component_is_caused_by_effects_of_its_kind_alone():
    assert can_cause(DRAG, OF_VELOCITY)
    assert not can_cause(STIFFNESS, OF_VELOCITY)


def test_component_is_caused_by_an_effect_whose_kind_can_take_its_place():
    assert can_cause(STIFFNESS, part("force-of-velocity", similar=("force-of-position",)))


def test_component_of_the_state_is_not_caused_by_what_imitates_anything_though_alike():
    assert not can_cause(IMPACT, part("force-of-velocity", similar=("pulse",)))
    assert can_cause(IMPACT, part("force-of-time", similar=("pulse",)))


# --------------------------------------------------------------------------- unknown components


def test_without_components_nothing_is_shown_and_everything_agrees():
    unknown = ComponentSupport(None, is_driven=False)
    assert not unknown.known
    assert unknown.parts == ()
    assert not unknown.shows(DRAG)
    assert not unknown.is_largest(DRAG)
    assert unknown.evidence(DRAG) == frozenset()
    assert unknown.agrees(DRAG)
    assert unknown.agrees(IMPACT)
    assert (unknown.turns, unknown.never_turns) == (False, False)


def test_driven_motion_has_pieces_of_its_own_so_that_what_absorbs_never_agrees():
    assert not ComponentSupport(None, is_driven=True).agrees(IMPACT)
    assert not support(PULSE, driven=True).agrees(IMPACT)
    assert support(PULSE).agrees(IMPACT)
    assert support(OF_VELOCITY, driven=True).agrees(DRAG)


# --------------------------------------------------------------------------- known components


def test_any_component_of_its_kind_shows_an_effect_however_small():
    small = support(PULSE, part("force-of-velocity", 0.001))
    assert small.known
    assert small.shows(DRAG)
    assert not small.shows(STIFFNESS)


def test_direction_of_the_motion_is_that_of_the_components():
    assert (support(PULSE).turns, support(PULSE).never_turns) == (True, False)
    one_way = support(PULSE, turns=False)
    assert (one_way.turns, one_way.never_turns) == (False, True)


def test_largest_component_alone_counts_as_the_largest_and_only_where_it_is_of_the_state():
    assert support(OF_VELOCITY, part("force-of-position", 0.05)).is_largest(DRAG)
    assert not support(part("force-of-position"), part("force-of-velocity", 0.05)).is_largest(DRAG)
    assert not support(PULSE).is_largest(IMPACT)
    assert not support().is_largest(DRAG)


def test_component_is_evidence_from_a_fifth_of_what_all_components_explain():
    """The share is of the residual without its noise, so that noise makes none of them small."""
    for total in (0.9, 0.3):
        of_velocity, rest = 0.2 * total, 0.8 * total
        just = support(part("force-of-position", rest), part("force-of-velocity", of_velocity * 1.001))
        assert just.evidence(DRAG) == {"force-of-velocity"}
        below = support(part("force-of-position", rest), part("force-of-velocity", of_velocity * 0.99))
        assert below.evidence(DRAG) == frozenset()


def test_share_of_exactly_a_fifth_is_large():
    """Numbers that a double holds exactly: 0.125 of 0.625."""
    parts = support(part("force-of-position", 0.5), part("pulse", 0.125, similar=("force-of-velocity",)))
    assert parts.evidence(DRAG) == {"pulse"}
    by_range = support(part("force-of-position", 0.6), part("pulse", 0.025, most=0.125))
    assert by_range.evidence(IMPACT) == {"pulse"}


def test_component_whose_range_reaches_a_fifth_is_evidence_of_its_own_kind_only():
    """It can be a good part, but what can take its place counts only where its share is large."""
    small = part("force-of-velocity", 0.01, most=0.5, similar=("force-of-position",))
    both = support(part("force-of-time", 0.9), small)
    assert both.evidence(DRAG) == {"force-of-velocity"}
    assert both.evidence(STIFFNESS) == frozenset()
    large = support(part("force-of-time", 0.5), replace(small, share=0.4))
    assert large.evidence(STIFFNESS) == {"force-of-velocity"}


def test_effect_agrees_with_a_small_component_but_one_that_absorbs_needs_a_large_one():
    small = support(part("force-of-position"), part("force-of-velocity", 0.01), part("pulse", 0.01))
    assert small.agrees(DRAG)
    assert not small.agrees(IMPACT)
    assert support(part("force-of-position", 0.5), part("pulse", 0.4)).agrees(IMPACT)


@pytest.mark.parametrize("of_range", [False, True])
def test_range_of_a_share_counts_for_what_absorbs_only_where_the_data_are_explained(of_range):
    wide = support(part("force-of-position"), part("pulse", 0.01, most=0.6))
    assert wide.agrees(IMPACT, of_range=of_range) is of_range


def test_on_a_motion_that_never_turns_any_component_agrees_with_any_effect():
    assert not support(OF_VELOCITY).agrees(STIFFNESS)
    assert support(OF_VELOCITY, turns=False).agrees(STIFFNESS)
    assert not support(turns=False).agrees(STIFFNESS)

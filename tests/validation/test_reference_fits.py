"""The reference fits: integration, the rule of the standard error, and one known effect found."""

import json
from dataclasses import asdict, replace

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from iris_sysid import EFFECTS, MODELS, Estimate, Quantity, Segment
from iris_sysid.types import SIDES
from validation import reference_fits
from validation.reference_fits import (
    Candidate,
    Row,
    base_of,
    blocks_of,
    components,
    exported,
    moving,
    read_row,
    row_of,
    supported,
)
from validation.reference_motions import MOTIONS, Clip, course, shown
from validation.reference_starts import sizes, thinned
from validation.reference_terms import TERMS, physical
from validation.world_tables import NOTHING, Recording, series


def swing(t_s, drag=0.0):
    """Angle and rate of a pendulum with quadratic drag, by another method."""
    right = lambda t, y: (y[1], -20 * np.sin(y[0]) - 0.05 * y[1] - drag * abs(y[1]) * y[1])  # noqa: E731
    return solve_ivp(right, (0, t_s[-1]), (0.8, 0.0), "DOP853", t_s, rtol=1e-10, atol=1e-12).y.T


def a_candidate(errors, *terms):
    return Candidate(terms, 1.0, float(np.sqrt(np.mean(errors))), tuple(errors), {})


def a_row(*candidates):
    return Row("x", "rad", 100, True, tuple(sorted(candidates, key=lambda each: each.heldout)))


def test_integration_agrees_with_another_method():
    t_s = np.linspace(0, 10, 301)
    expected = swing(t_s, drag=0.1)
    clip = Clip(t_s, expected[:, :1], np.zeros(t_s.size))
    scales = sizes(MOTIONS["pendulum"], [clip])
    size = 0.1 * scales.v**2 / scales.force
    p = {name: np.array([value]) for name, value in {"pull": 20.0, "damping": 0.05, "quadratic-drag/0": size}.items()}
    states = course(MOTIONS["pendulum"], clip, ["quadratic-drag"], scales, p, np.array([[0.8], [0.0]]))
    np.testing.assert_allclose(states[:, :, 0], expected, atol=1e-3)


@pytest.mark.parametrize("model", MOTIONS)
def test_every_candidate_term_can_be_integrated(model):
    base = MOTIONS[model]
    forces = [name for name in base.terms if TERMS[name].force is not None]
    clip = Clip(
        np.linspace(0, 1, 5),
        np.array([1, 1.6, 2, 1.7, 1.1])[:, None] * np.ones((1, 2 if model == "projectile" else 1)),
        np.zeros(5),
    )
    p = {label: np.full(3, 0.01) for name in base.terms for label in TERMS[name].names}
    p |= {name: np.ones(3) for name in base.start}
    states = course(base, clip, forces, sizes(base, [clip]), p, np.ones((base.states, 3)))
    assert states.shape == (5, base.states, 3)
    assert np.isfinite(states).all()


def test_terms_name_components_and_effects_of_the_library():
    assert all(term.kinds and term.kinds <= set(SIDES) for term in TERMS.values())
    assert all(term.effects <= set(EFFECTS) for term in TERMS.values())


def test_a_drag_that_drives_is_not_physical():
    assert physical(TERMS["quadratic-drag"], [0.1])
    assert not physical(TERMS["quadratic-drag"], [-0.1])
    assert not physical(TERMS["clock-drift"], [0.05])


def test_the_simplest_set_within_the_standard_error_is_chosen():
    even, uneven = [1.0] * 8, [0.2] * 4 + [1.2] * 4
    row = a_row(
        a_candidate([9.0] * 8), a_candidate(even, "linear-drag"), a_candidate(uneven, "linear-drag", "cubic-force")
    )
    assert row.chosen.terms == ("linear-drag",)
    assert supported(row) == {"linear-drag", "drag-crisis"}
    assert components(row) == {"force-of-velocity"}


def test_a_wander_of_a_constant_is_a_wrong_zero_as_well():
    row = a_row(a_candidate([9.0] * 8), a_candidate([1.0] * 8, "zero-wander"))
    assert "zero-offset" not in supported(row)
    off = replace(row.best, values={"zero-wander/0": 0.05, "zero-wander/1": 0.02})
    assert "zero-offset" in supported(a_row(row.nothing, off))


def test_where_nothing_predicts_better_no_component_is_supported():
    row = a_row(a_candidate([1.0] * 8), a_candidate([0.95] * 8, "linear-drag"))
    assert row.chosen.terms == ()
    assert components(row) == set()


def test_blocks_are_the_parts_after_the_first():
    clip = Clip(np.arange(90.0), np.zeros((90, 2)), np.zeros(90))
    blocks = blocks_of(clip, 8)
    assert len(blocks) == 8
    np.testing.assert_array_equal(np.flatnonzero(blocks[0]), np.arange(20, 40))
    np.testing.assert_array_equal(np.sum(blocks, axis=0), np.arange(180) >= 20)


def test_samples_are_those_of_the_longest_motion():
    z = Quantity("z", "m")
    labels = [("hand", 0, 4), ("motion", 4, 8), ("contact", 8, 10), ("motion", 10, 20)]
    clip = series(np.arange(20.0), np.arange(20.0), z)
    valid = np.arange(20) != 12
    cut = clip.with_(segments=tuple(Segment(*label, "known") for label in labels), valid=valid)
    np.testing.assert_array_equal(np.flatnonzero(moving(cut)), [10, 11, *range(13, 20)])
    np.testing.assert_array_equal(moving(clip), np.ones(20, bool))


def test_a_free_vertical_belongs_to_the_base_model():
    filmed = Recording("x", "here", "that", MODELS["pendulum"], list, "camera", free=("vertical",))
    recorded = series(np.arange(3.0), np.zeros(3), Quantity("theta", "rad"))
    measured = {f"pivot_{name}": Estimate(0.0, 0.01, "1", "measured") for name in ("across", "along")}
    base = base_of(filmed, recorded.with_(geometry=measured))
    assert base.measured == {"across": 0.01, "along": 0.01}
    assert "vertical" in base.start
    assert "zero-offset" not in base.terms
    clip, scales = Clip(np.arange(3.0), np.zeros((3, 1)), np.zeros(3)), sizes(base, [Clip(*three())])
    values = {"vertical": np.array([0.1]), "across": np.array([0.02]), "along": np.array([0.0])}
    np.testing.assert_allclose(shown(base, clip, np.zeros((3, 2, 1)), [], scales, values)[0], 0.08)


def three():
    t_s = np.arange(20.0)
    return t_s, np.sin(t_s)[:, None], np.zeros(20)


def test_a_single_sample_far_from_its_neighbours_is_left_out():
    t_s = np.linspace(0, 5, 200)
    values = np.sin(t_s)[:, None] + np.random.default_rng(1).normal(0, 1e-3, (200, 1))
    values[70] += 0.5
    clip = thinned(t_s, values, np.zeros(200))
    np.testing.assert_array_equal(np.flatnonzero(np.isnan(clip.values[:, 0])), [70])


def test_a_quadratic_drag_is_found(monkeypatch, tmp_path):
    t_s = np.linspace(0, 12, 240)
    angle = swing(t_s, drag=0.15)[:, 0] + np.random.default_rng(2).normal(0, 2e-3, t_s.size)
    few = replace(MOTIONS["pendulum"], terms=("quadratic-drag", "dry-friction", "cubic-force", "zero-line"))
    monkeypatch.setitem(MOTIONS, "pendulum", few)
    monkeypatch.setattr(reference_fits, "TRIPLES", 0)
    read = lambda: [series(t_s, angle, Quantity("theta", "rad"))]  # noqa: E731
    row = row_of(Recording("x", "here", "that", MODELS["pendulum"], read, "camera", NOTHING))
    assert row.chosen.terms == ("quadratic-drag",)
    assert row.chosen.heldout == pytest.approx(2e-3, rel=0.2)
    (tmp_path / "x.json").write_text(json.dumps({**asdict(row), **exported(row)}))
    assert read_row(tmp_path / "x.json") == row

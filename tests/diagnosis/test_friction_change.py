"""Friction that changes at a position: a slide over two surfaces is known in closed form."""

import numpy as np
import pytest

from iris_sysid.diagnosis.diagnose import diagnose
from iris_sysid.registry import EFFECTS, MODELS
from iris_sysid.report.diagnosis_text import diagnosis_sentence
from iris_sysid.types import Quantity, Trajectory

FIRST, SECOND, PLACE_M = 0.3, 0.7, 0.14  # m/s^2 on either surface, and where the seam is
START_M_S = 0.09


def slide(rate_hz: float, noise_m: float, seed: int, *, scale: float = 1.0, unit: str = "m") -> Trajectory:
    """Constant acceleration to the seam, and another after it."""
    t_s = np.arange(0.0, 1.45, 1.0 / rate_hz)
    fast = np.sqrt(START_M_S**2 + 2 * FIRST * PLACE_M)
    crossing = (fast - START_M_S) / FIRST
    later = np.maximum(t_s - crossing, 0.0)
    before = np.minimum(t_s, crossing)
    way = START_M_S * before + FIRST * before**2 / 2 + fast * later + SECOND * later**2 / 2
    way = scale * (way + noise_m * np.random.default_rng(seed).standard_normal(t_s.size))[:, None]
    return Trajectory(t_s, (Quantity("s", unit, "s"),), way, np.full_like(way, np.nan), np.ones(t_s.size, dtype=bool))


@pytest.mark.slow
def test_seam_between_two_surfaces_is_found_with_its_position():
    diagnosis = diagnose(slide(60.0, 1.5e-4, seed=1), MODELS["incline"])
    assert [effect.name for effect in diagnosis.added] == ["friction-change"]
    for name, truth in (("friction_change", FIRST - SECOND), ("change_place", PLACE_M)):
        low, high = diagnosis.sizes[name].interval
        assert low < truth < high
    assert diagnosis.final.estimates["acceleration"].value == pytest.approx(FIRST, rel=0.05)
    assert diagnosis.after.fitted < 2.0 * 1.5e-4
    assert "change place 0.1" in diagnosis_sentence(diagnosis)


def test_seam_that_few_samples_show_is_in_the_fit_whether_or_not_it_is_named():
    diagnosis = diagnose(slide(10.0, 1.5e-4, seed=1), MODELS["incline"])
    assert any("friction-change" in finding.effects for finding in diagnosis.findings)
    assert diagnosis.after.heldout < 0.1 * diagnosis.before.heldout


def test_seam_is_found_in_pixels_too():
    diagnosis = diagnose(slide(60.0, 1.5e-4, seed=2, scale=1000.0, unit="px"), MODELS["incline"])
    assert [effect.name for effect in diagnosis.added] == ["friction-change"]
    assert diagnosis.sizes["change_place"].value == pytest.approx(1000 * PLACE_M, abs=10)


def test_one_surface_gets_no_seam():
    even = slide(60.0, 1.5e-4, seed=3)
    way = START_M_S * even.t_s + FIRST * even.t_s**2 / 2
    noise = 1.5e-4 * np.random.default_rng(3).standard_normal(way.size)
    assert diagnose(even.with_(position=(way + noise)[:, None]), MODELS["incline"]).added == ()


def test_only_what_moves_along_a_line_on_a_surface_has_a_seam():
    seam = EFFECTS["friction-change"]
    assert {name for name, model in MODELS.items() if seam.applies(model)} == {
        "incline",
        "coasting-ball",
        "stopping-block",
    }

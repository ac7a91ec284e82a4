"""The law of an arm is found from its torque in weak form, where chatter of the acceleration would dilute it."""

from dataclasses import replace

import numpy as np
import pytest

from iris_sysid import Quantity, simulate
from tests._project import recording
from validation import driven_arm
from validation.driven import ARM_PUBLISHED, record
from validation.driven_arm import LAW, TERMS, authors_regression, common_law, own_friction, windows_of

TRUE = {"inertia": 0.18, "moment": 0.36, "damping": 0.02, "dry": 0.2, "offset": -0.05}


def swing(seed, **changed):
    """A swing of six seconds under a torque that chatters; the encoder has steps of 4 mrad."""
    rng, t_s = np.random.default_rng(seed), np.arange(1800) / 300
    frequency, phase = rng.uniform(0.3, 1.2, (3, 1)), rng.uniform(0, 6, (3, 1))
    torque = np.sin(2 * np.pi * frequency * t_s + phase).sum(axis=0) + rng.standard_normal(t_s.size)
    values = {**TRUE, **changed, "theta_0": 0.0, "theta_rate_0": 0.0}
    angle = simulate(LAW, t_s, values, inputs=torque[:, None], hold="zero-order").observed[:, 0]
    return record(t_s, np.round(angle / 4e-3) * 4e-3, Quantity("theta", "rad"), torque, Quantity("u", "N m"))


@pytest.fixture
def recordings(monkeypatch):
    clips = {"a": swing(0), "b": swing(1), driven_arm.LOADED: swing(2, inertia=0.4, moment=0.78)}
    monkeypatch.setattr(driven_arm, "ARMS", {name: (name,) for name in clips})
    monkeypatch.setattr(driven_arm, "arm", clips.__getitem__)
    monkeypatch.setattr(driven_arm, "swing_up", lambda clip: clip)
    return [windows_of(name, 0.15) for name in clips]


def test_the_common_law_is_the_truth_within_its_errors(recordings):
    law, errors = common_law(recordings)
    true = np.array(list(TRUE.values()))
    assert np.all(np.abs(law - true) < 4 * errors)
    np.testing.assert_allclose(law[:2], true[:2], rtol=0.05)
    assert law[TERMS.index("dry")] > 5 * errors[TERMS.index("dry")]


def test_a_load_has_its_own_inertia_and_the_friction_of_the_others(recordings):
    loaded = recordings[2]
    law = loaded.with_own_load(common_law(recordings[:2])[0])
    np.testing.assert_allclose(law[:2], [0.4, 0.78], rtol=0.05)
    assert loaded.share(law) > 0.95 > loaded.share(common_law(recordings[:2])[0])
    assert own_friction(loaded, law)[0][1] == pytest.approx(0.2, abs=0.05)


def test_a_friction_that_adds_energy_is_left_out(recordings):
    each = recordings[0]
    assert own_friction(each, np.array([0.18, 0.36, 0.0, 0.0, 0.0]))[1][0] > 0
    driven = replace(each, torque=each.torque - 0.2 * each.terms[:, 2])
    values, errors = own_friction(driven, np.array([0.18, 0.36, 0.0, 0.0, 0.0]))
    assert values[0] == errors[0] == 0.0


def test_the_regression_of_the_authors_gives_the_values_that_they_published(monkeypatch):
    path = recording(f"world/tab-torque-pendulum/{driven_arm.ARMS[driven_arm.AUTHORS_RECORD][0]}")
    monkeypatch.setattr(driven_arm, "ARM_FOLDER", path.parent)
    law, share = authors_regression()
    np.testing.assert_allclose(law, list(ARM_PUBLISHED.values()), rtol=1e-3)
    assert share < 0.5

"""Parts of residuals made for the tests of reports, and a diagnosis that has them."""

from dataclasses import replace

import numpy as np

from iris_sysid import diagnose
from iris_sysid.types import Component, ComponentCurve, Components, Finding, Quantity
from tests.types.test_pickling import dragged

SPEED, TIME, ANGLE = Quantity("omega", "rad/s"), Quantity("t", "s"), Quantity("theta", "rad")
ACCELERATION = Quantity("theta''", "rad/s^2")


def drag_part(share=0.81, share_range=(0.74, 0.86), **changes):
    at = np.linspace(-2.0, 2.0, 41)
    values = -0.08 * at * np.abs(at) + 0.1 * at
    error = 0.01 + 0.02 * (np.abs(at) / 2) ** 4
    curve = ComponentCurve(SPEED, at, (ACCELERATION,), values[:, None], error[:, None])
    part = Component("force-of-velocity", share, share_range, 4.0e-3, 0.99, curve)
    return replace(part, **changes)


def wander_part(share=0.08, share_range=(0.05, 0.12), **changes):
    at = np.linspace(0.0, 60.0, 61)
    values = 1.2e-3 * np.sin(2 * np.pi * at / 11.0)
    curve = ComponentCurve(TIME, at, (ANGLE,), values[:, None], np.full((61, 1), 4e-4))
    return replace(Component("zero-wander", share, share_range, 1.2e-3, 0.9, curve), **changes)


def components(*parts, noise_share=0.11, residual_rms=4.4e-3):
    noise_rms = residual_rms * np.sqrt(noise_share)
    kinds = tuple(part.kind for part in parts)
    explanations = ((kinds, 0.8), (kinds[:1], 0.2)) if parts else ()
    return Components(parts, noise_share, residual_rms, noise_rms, 0.35, "rad", 0.6, explanations)


NAMED = Finding("named", "force-of-velocity", ("quadratic-drag",), 0.8)
GROUP = Finding("group", "force-of-velocity", ("quadratic-drag", "cubic-drag"), 0.74, "the swing hardly decays")
LOCATED = Finding("located", "zero-wander", (), float("nan"), "it has no simple form")
OPEN = Finding("open", None, (), float("nan"), "each part explains it about as well")


def split_diagnosis():
    """A pendulum with quadratic drag, which is found and named, and a zero that wanders."""
    found = diagnose(dragged(), "pendulum", effects=["quadratic-drag"])
    assert [effect.name for effect in found.added] == ["quadratic-drag"]
    before = components(drag_part(), wander_part())
    wander = wander_part(share=0.62, share_range=(0.3, 0.8), similar=("force-of-time",))
    after = components(wander, noise_share=0.38, residual_rms=1.9e-3)
    return replace(found, components=before, remaining=after, findings=(NAMED, LOCATED))

"""The ball and the first two cups in its way, and what describes them."""

import numpy as np
import pytest

from fitters.ode import fit, simulate
from iris_sysid.benchmark.studies.coupling import first_struck
from iris_sysid.errors import DataError
from iris_sysid.registry import MODELS
from iris_sysid.types import Quantity, Segment, Trajectory

T_S = np.arange(120) / 60
START = {"z1_0": -1.0, "z2_0": 0.0, "z3_0": 0.11, "v1_0": 1.5, "v2_0": 0.0, "v3_0": 0.0}
VALUES = {
    "damping_1": 0.4,
    "damping": 0.9,
    "restitution": 0.5,
    "mass_ratio": 0.3,
    "contact_12": 0.12,
    "contact_23": 0.1,
}
NOISE = 2e-4  # m


def body(x, z, seed, valid=None):
    place = np.column_stack([x, np.broadcast_to(z, x.shape)])
    place = place + NOISE * np.random.default_rng(seed).standard_normal(place.shape)
    seen = np.ones(x.size, bool) if valid is None else valid
    return Trajectory(T_S, (Quantity("x", "m"), Quantity("z", "m")), place, np.full_like(place, NOISE), seen)


def struck(sign):
    """A cup on top, the second and first of the row, one that is seen too late, and the ball, in that order."""
    ways = sign * simulate(MODELS["impact-chain"], T_S, VALUES | START).observed
    hit = int(np.argmax(np.abs(ways[:, 1]) > 5 * NOISE))
    late = T_S > 0.5
    places = [(np.full(120, 0.05 * sign), 0.2), (ways[:, 2], 0.05), (ways[:, 1], 0.05), (np.full(120, -0.3), 0.05)]
    bodies = [body(x, z, k, late if k == 3 else None) for k, (x, z) in enumerate(places)]
    bodies.append(body(ways[:, 0], 0.07, 9))
    run_up = body(ways[:, 0], 0.07, 9).with_(segments=(Segment("motion", 0, hit - 1, "it rolls"),))
    return bodies, run_up, ways


@pytest.mark.parametrize("sign", [1, -1])
def test_ball_and_the_first_two_of_the_lowest_row_are_taken_in_the_order_of_the_way(sign):
    bodies, run_up, ways = struck(sign)
    chain = first_struck(bodies, run_up)
    assert [quantity.name for quantity in chain.quantities] == ["z1", "z2", "z3"]
    np.testing.assert_allclose(chain.position, sign * ways, atol=6 * NOISE)
    assert 0.45 < np.ptp(chain.t_s[chain.valid]) < 0.5


def test_impacts_describe_what_the_coupling_cannot():
    bodies, run_up, _ = struck(1)
    chain = first_struck(bodies, run_up)
    impacts, coupled = (fit(chain, MODELS[name]) for name in ("impact-chain", "contact-chain"))
    assert impacts.estimates["restitution"].value == pytest.approx(0.5, abs=0.03)
    assert impacts.rms.max() < 2 * NOISE
    assert coupled.rms.max() > 20 * NOISE


def test_ball_without_two_cups_in_its_way_is_refused():
    bodies, run_up, _ = struck(1)
    with pytest.raises(DataError, match="of 2 bodies 2 are seen while the ball rolls"):
        first_struck([bodies[1], bodies[4]], run_up)

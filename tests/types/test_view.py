"""A view leads from coordinates to the image and back, and refuses what is no picture."""

import numpy as np
import pytest

from iris_sysid import DataError, Quantity, View

ANGLE = (Quantity("theta", "rad"),)
LINE = (Quantity("s", "m"),)
PLANE = (Quantity("x", "m"), Quantity("z", "m"))
SIZE = ((1280.0, 720.0), (640.0, 360.0), 900.0)
RNG = np.random.default_rng(0)


@pytest.mark.parametrize(
    ("view", "observed"),
    [
        (View("angle", (640.0, 100.0), (300.0, 8.0), (-8.0, -290.0), *SIZE), RNG.uniform(-9.0, 9.0, (50, 1))),
        (View("line", (100.0, 600.0), (200.0, -150.0), (-150.0, -200.0), *SIZE), RNG.uniform(-1.0, 2.0, (50, 1))),
        (View("plane", (640.0, 500.0), (200.0, 3.0), (5.0, -210.0), *SIZE), RNG.uniform(-1.0, 2.0, (50, 2))),
    ],
    ids=["angle", "line", "plane"],
)
def test_coordinates_go_to_the_image_and_come_back(view, observed):
    points = view.points_px(observed)
    assert points.shape == (50, 2)
    back = view.coordinates(points, np.array(view.origin_px), near=observed + 0.5)
    np.testing.assert_allclose(back, observed, atol=1e-12)


@pytest.mark.parametrize(("quantities", "kind"), [(ANGLE, "angle"), (LINE, "line"), (PLANE, "plane")])
def test_assumed_picture_holds_the_motion(quantities, kind):
    observed = RNG.uniform(1.0, 2.0, (30, len(quantities)))
    observed[3] = np.nan
    view = View.assumed(quantities, observed)
    points = view.points_px(observed[np.isfinite(observed).all(axis=1)])
    assert view.kind == kind
    assert not view.measured
    away = np.abs(points - view.axis_px)
    assert np.all(away <= np.array(view.size_px) / 2)


@pytest.mark.parametrize("observed", [np.full((5, 1), 0.3), np.full((5, 1), np.nan), np.full((5, 1), 1e300)])
def test_motion_without_an_extent_has_some_picture(observed):
    assert View.assumed(LINE, observed).focal_px > 0


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"origin_px": (np.nan, 0.0)}, "origin_px of a view must be finite"),
        ({"focal_px": np.inf}, "focal_px of a view must be finite"),
        ({"focal_px": -1.0}, "above zero"),
        ({"size_px": (0.0, 720.0)}, "above zero"),
        ({"up_px": (400.0, 0.0)}, "must not be parallel"),
        ({"right_px": (0.0, 0.0)}, "must not be parallel"),
    ],
)
def test_view_of_no_picture_is_refused(change, message):
    fields = {
        "kind": "plane",
        "origin_px": (640.0, 360.0),
        "right_px": (200.0, 0.0),
        "up_px": (0.0, -200.0),
        "size_px": (1280.0, 720.0),
        "axis_px": (640.0, 360.0),
        "focal_px": 900.0,
    }
    with pytest.raises(DataError, match=message):
        View(**(fields | change))


@pytest.mark.parametrize(
    "quantities",
    [(Quantity("intensity", "1"),), (Quantity("h", "V"),), (Quantity("r", "px"),), (*ANGLE, Quantity("phi", "rad"))],
)
def test_what_has_no_place_in_an_image_has_no_view(quantities):
    with pytest.raises(DataError, match="no view is known"):
        View.assumed(quantities, np.ones((5, len(quantities))))

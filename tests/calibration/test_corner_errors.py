"""What the errors of a board's corners in one image say about the error of its scale."""

from dataclasses import replace

import numpy as np
import pytest

from iris_sysid.calibration.board.corner_errors import _common_errors, relative_errors
from iris_sysid.calibration.board.plane_pose import plane_from_board
from tests._board_pictures import BOARD, STRAIGHT, corners, pose, view_of_corners

SIZE = (960, 540)


def view(errors_px, stderr_px=0.02, *, t_s=None, **where):
    """A board whose corners have these errors (54, 2) px, as found with these standard errors."""
    found = view_of_corners(corners(pose(**where), camera=STRAIGHT) + errors_px, SIZE, BOARD)
    return replace(found, stderr_px=np.broadcast_to(stderr_px, 54).copy(), t_s=t_s)


def scale(*arguments, **where):
    return plane_from_board(view(*arguments, **where), BOARD).scale


@pytest.mark.parametrize("apart_px", [10.0, 10.07, 24.5])
def test_common_errors_of_a_board_along_the_pixels_are_a_covariance(apart_px):
    """A Gaussian of the nearest place in the pixel is none: upright boards ended in the root of a negative number."""
    upright = apart_px * np.stack(np.meshgrid(np.arange(9), np.arange(6)), axis=-1).reshape(-1, 2).astype(float)
    for common in _common_errors(upright, encoded=True):
        assert np.linalg.eigvalsh(common).min() > -1e-9
        assert np.diag(common) == pytest.approx(1.0)


def test_corners_that_are_found_less_exactly_move_the_scale_less():
    noise = np.random.default_rng(2).normal(0, 0.01, (54, 2))
    noise[45:, 1] -= 0.3  # a row on the edge of an encoder's block
    stderr = np.full(54, 0.02)
    stderr[45:] = 0.1
    truth = scale(np.zeros((54, 2))).value
    assert abs(scale(noise, stderr).value - truth) < 0.3 * abs(scale(noise).value - truth)


def test_relative_errors_are_those_of_the_usual_corner_at_least():
    assert relative_errors(np.array([0.01, 0.02, 0.02, 0.06, np.nan])) == pytest.approx([1, 1, 1, 3, 1])
    assert relative_errors(np.full(3, np.nan)) == pytest.approx([1, 1, 1])


@pytest.mark.parametrize("kind", ["by the place in the pixel", "of neighbours"])
def test_error_of_the_scale_covers_errors_that_corners_share(kind):
    rng, pulls = np.random.default_rng(4), []
    for _ in range(60):
        where = {"roll": rng.uniform(-0.03, 0.03), "distance": rng.uniform(0.5, 0.7), "tilt": rng.uniform(-0.1, 0.1, 2)}
        exact = corners(pose(**where), camera=STRAIGHT)
        errors = rng.normal(0, 0.03, (54, 2))
        if kind == "by the place in the pixel":
            errors = 0.2 * errors + 0.03 * np.sin(2 * np.pi * (exact + rng.uniform(0, 1, 2)))
        elif kind == "of neighbours":
            far = np.linalg.norm(exact[:, None] - exact, axis=2) / (1.5 * 45)
            errors = np.linalg.cholesky(np.exp(-(far**2) / 2) + 1e-4 * np.eye(54)) @ errors + rng.normal(
                0, 0.02, (54, 2)
            )
        found = scale(errors, 0.01, t_s=0.0, **where)
        pulls.append((found.value - scale(np.zeros((54, 2)), **where).value) / found.stderr)
    assert np.mean(np.abs(pulls) < 1.96) > 0.88
    assert np.std(pulls) > 0.4


def test_error_that_looks_like_another_scale_is_stated_for_a_frame_of_a_clip():
    """Columns from 0.2 to 0.8 of a pixel: an encoder that pulls edges to the middle of a pixel leaves no residual."""
    flat = {"distance": 750 * 0.03 / 45.075, "aside": (0.0, 0.0)}
    exact = corners(pose(**flat), camera=STRAIGHT)
    pulled = 0.1 * np.sin(2 * np.pi * exact)
    noise = np.random.default_rng(3).normal(0, 0.02, (54, 2))
    truth = scale(np.zeros((54, 2)), **flat).value
    image, weak, strong = (
        scale(pulled + noise, stderr, t_s=t_s, **flat) for stderr, t_s in ((0.04, None), (0.001, 0.0), (0.04, 0.0))
    )
    assert weak.value == pytest.approx(image.value)
    assert image.stderr < weak.stderr < 0.8 * strong.stderr
    assert abs(strong.value - truth) < 1.96 * strong.stderr

"""Corners of calibration boards: on OpenCV's own images, and on images whose corners are known."""

import zlib

import cv2
import numpy as np
import pytest
from scipy.special import erf

from iris_sysid.calibration.board import frame_selection
from iris_sysid.calibration.board.board import Board, BoardView
from iris_sysid.calibration.board.corner_equations import corner_equations
from iris_sysid.calibration.board.detect import find_board, find_boards
from iris_sysid.calibration.board.frame_selection import choose_frames
from iris_sysid.errors import CalibrationError, DataError
from iris_sysid.types import Frame
from tests._board_pictures import BOARD, PHONE, SIZE, STRAIGHT, corners, picture, pose, random_pose, view_of_corners
from tests._project import recording
from tests.calibration._windows import find_by_window

OPENCV_BOARD = Board(9, 6, 0.025)
CHARUCO = Board(9, 6, 0.03, marker_m=0.022, dictionary="4x4_50")


def error_px(view, true):
    return float(np.sqrt(np.mean(np.square(view.corners_px - true[view.ids]))))


def opencv_pictures():
    return sorted(recording("opencv_checkerboard").glob("left*.jpg"))


@pytest.fixture(scope="module")
def straight():
    """A sharp image of the board, nearly straight on, with noise of 2 grey levels."""
    return picture(pose((0.05, -0.04), 0.03), camera=STRAIGHT, rng=np.random.default_rng(1))


# --------------------------------------------------------------------------- images whose corners are known


@pytest.mark.parametrize("seed", range(3))
def test_corner_of_a_sharp_image_is_found_to_a_hundredth_px(seed):
    rng = np.random.default_rng(seed)
    where = random_pose(rng)
    seen = picture(where, rng=rng)
    view, true = find_board(seen, BOARD), corners(where)
    assert view.ids.tolist() == list(range(54))
    assert error_px(view, true) < 0.012
    assert error_px(view, true) < 0.5 * error_px(find_by_window(seen, BOARD, 5), true)
    assert 0.4 < np.median(view.stderr_px) / error_px(view, true) < 1.3
    assert view.blur_px == pytest.approx(0.76, abs=0.05)  # 0.7 px of blur and the pixel's own 0.29


def test_corner_of_an_image_blurred_by_motion_is_not_pulled_along():
    where = pose((0.1, 0.2))
    streak = np.full((1, 9), 1 / 9)
    seen = cv2.filter2D(picture(where), -1, streak, borderType=cv2.BORDER_REPLICATE)
    view = find_board(seen, BOARD)
    assert error_px(view, corners(where)) < 0.05
    assert 2.0 < view.blur_px < 4.0  # a streak of 9 px has the standard deviation 2.6


def test_corners_of_one_board_are_numbered_alike_however_it_is_held(straight):
    first = find_board(straight, BOARD)
    turned = find_board(np.ascontiguousarray(straight[::-1, ::-1]), BOARD)
    on_its_side = find_board(np.rot90(straight).copy(), BOARD)
    assert first.oriented
    assert np.allclose(np.array(SIZE) - 1 - turned.corners_px, first.corners_px, atol=0.02)
    back = np.column_stack([SIZE[0] - 1 - on_its_side.corners_px[:, 1], on_its_side.corners_px[:, 0]])
    assert np.allclose(back, first.corners_px, atol=0.02)


def test_board_that_looks_the_same_turned_is_reported_to_have_no_first_corner():
    board = Board(8, 6, 0.03)
    seen = picture(pose((0.1, 0.1), board=board), board=board, camera=STRAIGHT)
    view, turned = find_board(seen, board), find_board(np.ascontiguousarray(seen[::-1, ::-1]), board)
    assert not view.oriented
    assert not turned.oriented
    assert view.corners_px[1, 0] > view.corners_px[0, 0]
    assert turned.corners_px[1, 0] > turned.corners_px[0, 0]


def test_corners_in_a_large_image_are_found_at_a_smaller_scale_and_fitted_at_full_size(straight):
    large = cv2.resize(straight, None, fx=4, fy=4, interpolation=cv2.INTER_CUBIC)
    view = find_board(large, BOARD, thorough=False)
    small = find_board(straight, BOARD)
    assert np.allclose((view.corners_px + 0.5) / 4 - 0.5, small.corners_px, atol=0.02)


# --------------------------------------------------------------------------- markers


def charuco_picture(where, board=CHARUCO, part=1.0):
    """The printed board as a straight camera sees it."""
    squares = board.columns + 1, board.rows + 1
    pattern = cv2.aruco.CharucoBoard(
        squares, board.square_m, board.marker_m, cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_4X4_50)
    )
    side = 100
    print_px = pattern.generateImage((squares[0] * side, squares[1] * side))
    print_px[:, int(part * print_px.shape[1]) :] = 255
    true = corners(where, board, STRAIGHT)
    placed = (board.points_m / board.square_m + 1) * side - 0.5
    factor = 4
    to_picture = cv2.findHomography(placed, (true + 0.5) * factor - 0.5)[0]
    size = SIZE[0] * factor, SIZE[1] * factor
    large = cv2.warpPerspective(print_px, to_picture, size, flags=cv2.INTER_LINEAR, borderValue=255)
    return cv2.GaussianBlur(cv2.resize(large, SIZE, interpolation=cv2.INTER_AREA), (0, 0), 0.7), true


def test_charuco_corner_is_found_to_two_hundredths_px():
    seen, true = charuco_picture(pose((0.2, -0.3), 0.1))
    view = find_board(seen, CHARUCO)
    assert len(view.ids) == 54
    assert error_px(view, true) < 0.02


def test_charuco_board_that_is_half_hidden_gives_the_corners_that_are_seen():
    seen, true = charuco_picture(pose((0.2, -0.3), 0.1), part=0.55)
    view = find_board(seen, CHARUCO)
    assert 15 < len(view.ids) < 40
    assert error_px(view, true) < 0.02
    assert np.allclose(view.outline_px(CHARUCO), true[[0, 8, 53, 45]], atol=0.3)


@pytest.mark.parametrize(
    ("change", "board", "match"),
    [
        (lambda seen: seen[:, ::-1], CHARUCO, "mirrored"),
        (lambda seen: seen, Board(7, 5, 0.03, marker_m=0.022), "do not fit a ChArUco board of 7x5"),
        (lambda seen: np.full_like(seen, 128), CHARUCO, "no ChArUco board with markers of 4x4_50"),
        (lambda seen: seen, Board(9, 6, 0.03, marker_m=0.022, dictionary="9x9"), "no dictionary of markers is named"),
    ],
)
def test_charuco_image_that_cannot_be_used_says_why(change, board, match):
    seen, _ = charuco_picture(pose((0.1, -0.1)))
    with pytest.raises(CalibrationError, match=match):
        find_board(np.ascontiguousarray(change(seen)), board)


# --------------------------------------------------------------------------- OpenCV's images


def test_opencv_images_show_the_board_in_one_orientation():
    search = find_boards(opencv_pictures(), OPENCV_BOARD)
    assert len(search.views) == 13
    assert not search.missing
    assert all(view.oriented and len(view.ids) == 54 for view in search.views)


def test_large_window_pulls_the_corners_of_left02_away_and_ours_does_not():
    path = recording("opencv_checkerboard") / "left02.jpg"
    ours = find_board(path, OPENCV_BOARD).corners_px
    small = find_by_window(path, OPENCV_BOARD, 5).corners_px
    large = find_by_window(path, OPENCV_BOARD, 11).corners_px
    assert np.abs(ours - small).max() < 0.5
    assert np.abs(ours - large).max() > 3


# --------------------------------------------------------------------------- bad input


def blurred(seen, sigma):
    return cv2.GaussianBlur(seen, (0, 0), sigma)


def cut_at(seen, side):
    x, y = find_board(seen, BOARD).corners_px.T
    across = int(np.median(x)), int(np.median(y))
    return {"left": seen[:, across[0] :], "bottom": seen[: across[1] + 20], "right": seen[:, : across[0] + 20]}[side]


@pytest.mark.parametrize(
    ("change", "board", "match"),
    [
        (lambda seen: np.full_like(seen, 90), BOARD, "no checkerboard is seen"),
        (lambda seen: np.random.default_rng(0).integers(0, 255, seen.shape).astype(np.uint8), BOARD, "no checkerboard"),
        (lambda seen: seen, Board(8, 6, 0.03), "9x6.*not 8x6|beyond 8x6 inner corners: it has at least 9x6"),
        (lambda seen: seen, Board(7, 5, 0.03), "9x6.*not 7x5|beyond 7x5"),
        (lambda seen: seen, Board(10, 7, 0.03), "has 9x6 inner corners, not 10x7: write the inner corners"),
        (lambda seen: cut_at(seen, "left"), BOARD, "cut off at the left edge of the image"),
        (lambda seen: cut_at(seen, "right"), BOARD, "cut off at the right edge of the image"),
        (lambda seen: cut_at(seen, "bottom"), BOARD, "cut off at the bottom edge of the image"),
        (lambda seen: blurred(seen, 9), BOARD, "blurred: edges of the board are .* px wide"),
        (
            lambda seen: cv2.resize(seen, None, fx=0.13, fy=0.13, interpolation=cv2.INTER_AREA),
            BOARD,
            "only 4.* px wide",
        ),
        (lambda seen: seen[:20, :20], BOARD, "too small for a board"),
        (lambda seen: seen.astype(float), BOARD, "must be uint8"),
        (lambda seen: seen[None, None], BOARD, "must be uint8"),
    ],
)
def test_image_that_cannot_be_used_says_why_and_what_to_do(straight, change, board, match):
    changed = change(straight)
    with pytest.raises(CalibrationError, match=match):
        find_board(np.ascontiguousarray(changed), board)


@pytest.mark.parametrize("size", ["8x6", "7x5", "9x5", "6x6"])
@pytest.mark.parametrize("name", ["left02.jpg", "left09.jpg"])
def test_part_of_a_larger_board_is_never_taken_for_the_board(name, size):
    # OpenCV 5 finds 48 of the 54 corners when asked for 8x6, and every second column when asked for 7x5
    with pytest.raises(CalibrationError, match=r"9x6"):
        find_board(recording("opencv_checkerboard") / name, Board(*map(int, size.split("x")), 0.025))


def test_file_that_is_no_image_is_refused(tmp_path):
    (tmp_path / "a.png").write_bytes(b"not a picture")
    with pytest.raises(CalibrationError, match="is not an image that can be read"):
        find_board(tmp_path / "a.png", BOARD)
    with pytest.raises(CalibrationError, match="No such file"):
        find_board(tmp_path / "b.png", BOARD)


def test_images_without_a_board_are_named_with_the_reason(straight):
    done = []
    search = find_boards(
        {"good": straight, "empty": np.full_like(straight, 9)}, BOARD, progress=lambda *now: done.append(now)
    )
    assert [view.name for view in search.views] == ["good"]
    assert "no checkerboard" in search.missing["empty"]
    assert done == [(1, 2), (2, 2)]
    with pytest.raises(CalibrationError, match="none of 1 images shows the board; empty: no checkerboard"):
        find_boards({"empty": np.full_like(straight, 9)}, BOARD)


@pytest.mark.parametrize(
    ("values", "match"),
    [
        ((2, 6, 0.025), "at least 3x3 inner corners, not 2x6"),
        ((9, 6, 0.0), "must be above zero"),
        ((9, 6, 0.025, 0.03), "which cannot be"),
        ((9, 6, 0.025, 0.0, 0.03), "a marker must be smaller than its square"),
    ],
)
def test_board_that_makes_no_sense_is_refused(values, match):
    with pytest.raises(CalibrationError, match=match):
        Board(*values)


def test_view_refuses_corners_that_cannot_be():
    with pytest.raises(DataError, match="different corner numbers"):
        BoardView("v", SIZE, [0, 0], np.zeros((2, 2)), np.zeros(2), 1.0, True)
    with pytest.raises(DataError, match="not finite"):
        BoardView("v", SIZE, [0, 1], np.full((2, 2), np.nan), np.zeros(2), 1.0, True)
    with pytest.raises(CalibrationError, match="found with another board"):
        view_of_corners(corners(pose()), SIZE, BOARD).points_m(Board(5, 4, 0.03))


# --------------------------------------------------------------------------- frames of a clip


class Clip:
    """Frames in memory, as a video gives them."""

    def __init__(self, pictures, promises=None):
        self.pictures = pictures
        self.width, self.height = SIZE
        self.n_expected = len(pictures) if promises is None else promises

    def frames(self):
        for k, luma in enumerate(self.pictures):
            yield Frame(k, k / 30, luma, lambda: None)

    def sample(self, count):
        return list(self.frames())[:count]


@pytest.fixture(scope="module")
def clip():
    """The board at rest for five frames, one of them blurred, then in five other positions, one blurred by motion."""
    rng = np.random.default_rng(4)
    still = picture(pose((0.1, 0.1)), rng=rng)
    others = [picture(random_pose(rng), rng=rng) for _ in range(5)]
    others[2] = blurred(others[2], 4)
    rest = [np.clip(still + rng.normal(0, 2, still.shape), 0, 255).astype(np.uint8) for _ in range(4)]
    return Clip([rest[0], blurred(still, 1.2), *rest[1:], *others, np.full_like(still, 100)])


@pytest.mark.parametrize("promises", [None, 0])
def test_frames_are_chosen_sharp_and_different(clip, promises):
    done = []
    chosen = choose_frames(Clip(clip.pictures, promises), BOARD, lambda *now: done.append(now))
    assert (chosen.n_examined, chosen.n_seen) == (11, 10)
    assert len(chosen.views) == 5
    assert chosen.n_blurred == 1
    assert chosen.n_alike == 4
    frames = [int(view.name.split()[1]) for view in chosen.views]
    assert frames[1:] == [5, 6, 8, 9]
    assert frames[0] in (0, 2, 3, 4)
    assert [view.t_s for view in chosen.views] == [frame / 30 for frame in frames]
    assert done[-1][0] == 11
    assert chosen.summary.startswith("5 frames chosen of 11 examined")


def test_fewer_frames_are_chosen_so_that_they_differ_most(monkeypatch, clip):
    monkeypatch.setattr(frame_selection, "MAX_VIEWS", 3)
    assert len(choose_frames(clip, BOARD).views) == 3


def test_fewer_frames_are_examined_than_the_clip_has(monkeypatch, clip):
    monkeypatch.setattr(frame_selection, "EXAMINED", 11)
    assert choose_frames(Clip(clip.pictures * 4), BOARD).n_examined == 11


@pytest.mark.parametrize(
    ("pictures", "board", "match"),
    [
        ([], BOARD, "no frame to look for"),
        ([np.full((540, 960), 90, np.uint8)] * 3, BOARD, "none of 3 frames can be used.*no checkerboard is seen"),
        ("two", Board(10, 7, 0.03), "none of 2 frames can be used.*has 9x6 inner corners, not 10x7"),
    ],
)
def test_clip_without_the_board_says_why(clip, pictures, board, match):
    with pytest.raises(CalibrationError, match=match):
        choose_frames(Clip(clip.pictures[:2] if pictures == "two" else pictures), board)


def test_distorted_and_straight_cameras_see_different_corners():
    # the fixture itself: a lens that does nothing would make every test of distortion empty
    assert np.abs(corners(pose(), camera=PHONE) - corners(pose(), camera=STRAIGHT)).max() > 1


def test_normal_equations_of_a_corner_are_those_of_its_model():
    rng = np.random.default_rng(0)
    pixels = np.stack(np.meshgrid(np.arange(-9.0, 10.0), np.arange(-9.0, 10.0)), axis=-1).reshape(-1, 2)
    params = np.array([0.3, -0.2, 0.1, 1.6, 1.2, 0.6, 120.0, 60.0, 0.1, 0.2])
    levels = corner_levels(pixels, params) + rng.standard_normal(len(pixels))
    steps = 1e-5 * np.eye(10)
    jacobian = np.array(
        [(corner_levels(pixels, params + step) - corner_levels(pixels, params - step)) / 2e-5 for step in steps]
    ).T
    residual = levels - corner_levels(pixels, params)
    normal, gradient = np.empty((10, 10)), np.empty(10)
    assert corner_equations(pixels, levels, params, normal, gradient) == pytest.approx(residual @ residual)
    assert np.allclose(normal, jacobian.T @ jacobian, rtol=1e-6, atol=1e-4)
    assert np.allclose(gradient, jacobian.T @ residual, rtol=1e-6, atol=1e-4)


def corner_levels(pixels, params):
    """The corner as its formula says, m + c E(d1, s1) E(d2, s2) + g (x - x0): E is the mean of erf over a pixel."""
    offset = pixels - params[:2]
    distance = offset[:, :1] * np.sin(params[2:4]) - offset[:, 1:] * np.cos(params[2:4])
    nodes, weights = np.polynomial.legendre.leggauss(20)
    within = distance[..., np.newaxis] + nodes / 2
    steps = erf(within / (np.sqrt(2) * params[4:6, np.newaxis])) @ (weights / 2)
    return params[6] + params[7] * np.prod(steps, axis=1) + offset @ params[8:]


def test_image_larger_than_the_slow_search_can_hold_is_searched_smaller(monkeypatch):
    searched = []
    for name in ("findChessboardCornersSB", "findChessboardCornersSBWithMeta", "findChessboardCorners"):
        real = getattr(cv2, name)
        monkeypatch.setattr(
            cv2,
            name,
            lambda image, *rest, real=real, **more: searched.append(image.shape) or real(image, *rest, **more),
        )
    with pytest.raises(CalibrationError, match="no checkerboard is seen"):
        find_board(np.full((300, 8160), 128, np.uint8), BOARD)
    assert max(max(shape) for shape in searched) == 4096


@pytest.mark.parametrize("shape", [(40, 8160), (32, 33), (1, 1)])
def test_picture_of_a_few_rows_shows_no_board(tmp_path, shape):
    cv2.imwrite(str(tmp_path / "a.png"), np.full(shape, 128, np.uint8))
    with pytest.raises(CalibrationError, match=r"no checkerboard is seen|too small for a board"):
        find_board(tmp_path / "a.png", BOARD)


def test_picture_that_claims_more_than_any_has_is_refused(tmp_path):
    header = b"IHDR" + (60000).to_bytes(4) * 2 + b"\x08\0\0\0\0"
    (tmp_path / "a.png").write_bytes(
        b"\x89PNG\r\n\x1a\n\0\0\0\r" + header + zlib.crc32(header).to_bytes(4) + bytes(500)
    )
    with pytest.raises(CalibrationError, match="is not an image that can be read"):
        find_board(tmp_path / "a.png", BOARD)


def test_piece_of_a_picture_that_claims_more_than_the_file_has_is_refused_before_memory_is_taken(tmp_path, monkeypatch):
    _, made = cv2.imencode(".png", np.full((64, 64), 128, np.uint8))
    data, at = made.tobytes(), made.tobytes().index(b"IDAT") - 4
    (tmp_path / "a.png").write_bytes(data[:at] + b"\xff\xff\xff\x00" + data[at + 4 :])
    (tmp_path / "longer.png").write_bytes(data + b"what a program puts behind the end \xff")
    with pytest.raises(CalibrationError, match="no checkerboard is seen"):
        find_board(tmp_path / "longer.png", BOARD)
    monkeypatch.setattr("cv2.imdecode", lambda *_: pytest.fail("given to OpenCV"))
    with pytest.raises(CalibrationError, match="is not an image that can be read"):
        find_board(tmp_path / "a.png", BOARD)

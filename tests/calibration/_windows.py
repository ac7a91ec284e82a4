"""Corners of a board by OpenCV's windows, as its calibration sample finds them: what ours are compared with."""

from dataclasses import replace

import numpy as np

from iris_sysid.calibration.board.corner_refinement import refine_by_window
from iris_sysid.calibration.board.detect import find_board, grey_image


def find_by_window(image, board, half_px):
    """The view of a board with its corners where the gradients in windows of that half side, px, point away from."""
    view = find_board(image, board)
    corners_px = refine_by_window(grey_image(image), view.corners_px, half_px)
    unknown = np.full(len(view.ids), np.nan)
    return replace(view, corners_px=corners_px, stderr_px=unknown, blur_px=np.nan)

"""Open a review in a notebook."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from iris_sysid.errors import DataError
from iris_sysid.registry import PHENOMENA
from iris_sysid.review.opening import is_result, open_clip, open_result
from iris_sysid.review.request import ReviewRequest
from iris_sysid.types import Calibration

if TYPE_CHECKING:
    from iris_sysid.review.widget import ReviewWidget


def review_widget(
    source: str | Path,
    phenomenon: str | None = None,
    *,
    output: str | Path | None = None,
    calibration: Calibration | None = None,
) -> ReviewWidget:
    """Correct a track by hand in a notebook, frame by frame: the page of ``iris-sysid review`` as a widget.

    Parameters
    ----------
    source
        Clip, or the folder of a run or of an earlier review.
    phenomenon
        What moves in a clip; None lets the widget ask. A folder says it itself.
    output
        Folder for log and results of a clip; None takes ``CLIP-review``, where an earlier review goes on.
    calibration
        From px to m; of a folder, where its run used a camera or a plane from a file.

    Returns
    -------
    ReviewWidget
        Shows itself as the last line of a cell. ``tracks`` and ``run`` are the results as edited; ``close()`` ends it.

    Raises
    ------
    DataError
        When anywidget is not installed, or a file is damaged.
    VideoError
        When the clip cannot be read.
    """
    try:
        from iris_sysid.review.widget import ReviewWidget
    except ImportError as error:
        raise DataError(f"{error}; install it: pip install 'iris-sysid[notebook]'") from error
    source = Path(source)
    folder = source if is_result(source) else Path(output or f"{source.stem}-review")
    if is_result(folder):
        if phenomenon is not None:
            raise DataError(f"the phenomenon is recorded in {folder} already; change it in the widget")
        return ReviewWidget(open_result(folder, None if source == folder else source, calibration))
    chosen = None if phenomenon is None else PHENOMENA.named(phenomenon)
    session = open_clip(source, folder, ReviewRequest(phenomenon=chosen, calibration=calibration))
    session.track()
    return ReviewWidget(session)

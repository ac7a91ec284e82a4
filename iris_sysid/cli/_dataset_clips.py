"""The clips of a data set that ``diagnose`` is given: measured first, with a line of progress."""

from __future__ import annotations

from pathlib import Path

from iris_sysid.benchmark.dataset_clips import clips_of_dataset
from iris_sysid.benchmark.groundtruth.direct import with_board
from iris_sysid.cli import _parsing, _terminal
from iris_sysid.errors import DataError
from iris_sysid.io.schemas.groundtruth import MeasuredDocument
from iris_sysid.types import Trajectory


def measured_clips(
    folder: Path,
    phenomenon: str | None,
    work: Path,
    *,
    corners: str | None,
    square: str | None,
    trials: int | None,
    workers: int | str,
) -> list[Trajectory]:
    """Measure the clips of one phenomenon of a data set, once, and read their trajectories.

    Parameters
    ----------
    folder
        The data set.
    phenomenon
        As typed; without one there is a DataError.
    work
        Folder of the measurements.
    corners, square
        Of the data set's checkerboards, as typed; None where not.
    trials
        At most this many clips of each setting; None for all.
    workers
        Number of parallel processes, or the address or file of a scheduler.
    """
    if phenomenon is None:
        raise DataError(f"{folder} is a data set: choose its clips, e.g. --phenomenon pendulum")
    board = MeasuredDocument()
    if corners is not None or square is not None:
        board = with_board(board, _parsing.board(corners, square))
    with _terminal.progress("measuring clips") as report_progress:
        return clips_of_dataset(
            folder,
            phenomenon,
            work,
            board=board,
            trials=trials,
            workers=workers,
            tell=_terminal.tell,
            progress=report_progress,
        )

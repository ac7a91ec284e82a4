"""The clips of a data set that ``diagnose`` is given: measured first, with a line of progress."""

from __future__ import annotations

from pathlib import Path

from iris_sysid.benchmark.groundtruth.clip import Conditions
from iris_sysid.benchmark.groundtruth.direct import with_board
from iris_sysid.benchmark.groundtruth.measure import measure
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
    """Measure the clips of one phenomenon that were not measured before, and read the fitted trajectory of each.

    ``work`` is the folder of the measurements; ``corners`` and ``square`` are those of the data set's checkerboards, as
    typed. At most ``trials`` clips of each setting are measured. DataError where no phenomenon is stated, or none of
    its clips could be fitted.
    """
    if phenomenon is None:
        raise DataError(f"{folder} is a data set: choose its clips, e.g. --phenomenon pendulum")
    board = MeasuredDocument()
    if corners is not None or square is not None:
        board = with_board(board, _parsing.board(corners, square))
    conditions = Conditions(trials=trials, phenomenon=phenomenon)
    with _terminal.progress("measuring clips") as show:
        done = measure(
            folder,
            work,
            measured=board,
            conditions=conditions,
            workers=workers,
            progress=show,
            tell=_terminal.tell,
        )
    trajectories = [clip.trajectory() for clip in done.clips if clip.document.usable]
    usable = [trajectory for trajectory in trajectories if trajectory is not None]
    if not usable:
        raise DataError(f"{folder} has no clip of {phenomenon} that could be fitted; {len(done.clips)} were tried")
    return usable

"""Every reader of the project as a function of bytes, which raises IrisError or nothing."""

from __future__ import annotations

import tempfile
from collections.abc import Callable, Mapping
from pathlib import Path

import pytest

from iris_sysid.calibration.board.detect import grey_image
from iris_sysid.calibration.calibration_json import read_calibration
from iris_sysid.cli import _own_equation, _parsing
from iris_sysid.cli._terminal import one_line
from iris_sysid.errors import IrisError
from iris_sysid.io.csv_columns import parse_column
from iris_sysid.io.csv_read import read_track, read_trajectory, side_car_of
from iris_sysid.io.json_documents import read_document
from iris_sysid.io.osp_tracker import marked_tracks, read_osp
from iris_sysid.io.private_cache import VARIABLE
from iris_sysid.io.schemas import DOCUMENTS
from iris_sysid.io.schemas.groundtruth import GROUND_TRUTH
from iris_sysid.io.table_headers import parse_columns
from iris_sysid.registry import MODELS, TRACKERS
from iris_sysid.video.reader import open_video

Target = Callable[[bytes], None]
MAX_FRAMES = 20  # that are decoded of a clip: the rest of it is more of the same
TABLE = "t_s,theta_rad\n0,0.1\n0.1,0.2\n0.2,0.1\n"
OPTIONS: tuple[Callable[[str], object], ...] = (
    lambda text: _parsing.settings([text]),
    lambda text: _parsing.settings([text], {"length": "m"}),
    _parsing.transfer,
    _parsing.fraction,
    _parsing.region,
    lambda text: _parsing.marks([text]),
    lambda text: _parsing.body_marks([text]),
    lambda text: _parsing.plumb_line([text]),
    _parsing.size,
    lambda text: _parsing.board(text, "25mm"),
    lambda text: _parsing.board("9x6", text),
    _parsing.length,
    lambda text: _parsing.effects([text]),
    lambda text: _parsing.calibration_of(text, None, None),
    lambda text: _parsing.calibration_of(None, text, None),
    lambda text: _own_equation.parsed_bounds([text]),
    parse_columns,
    parse_column,
    MODELS.named,
    TRACKERS.named,
)


def readers_of(name: str, *readers: Callable[[Path], object]) -> Target:
    """A target that writes the bytes to a file of that name and gives it to each reader."""

    def target(data: bytes) -> None:
        with tempfile.TemporaryDirectory(prefix="iris-fuzz-") as folder:
            path = Path(folder) / name
            path.write_bytes(data)
            for reader in readers:
                _refusing(reader, path)

    return target


def _refusing(reader: Callable[[Path], object], path: Path) -> None:
    try:
        reader(path)
    except IrisError as error:
        one_line(str(error)).encode()  # it can be shown


def _frames(path: Path, *, keep_partial: bool = False) -> None:
    video = open_video(path, fps=30.0, keep_partial=keep_partial)
    for _, frame in zip(range(MAX_FRAMES), video.frames(), strict=False):
        frame.bgr()
    str(video.warning).encode()


def _sampled(path: Path) -> None:
    open_video(path, keep_partial=True).sample(3)


def _beside(path: Path) -> None:
    table = path.with_name("t.csv")
    table.write_text(TABLE)
    path.rename(side_car_of(table))
    read_trajectory(table)


def _documents(path: Path) -> None:
    for kind in {**DOCUMENTS, **GROUND_TRUTH}.values():
        _refusing(lambda file, kind=kind: read_document(file, kind), path)


def _marks(path: Path) -> None:
    for track in marked_tracks(read_osp(path), fps=30.0):
        assert len(track.t_s)


def _options(data: bytes) -> None:
    text = data.decode("utf-8", "surrogateescape")
    for reader in OPTIONS:
        _refusing(lambda _, reader=reader: reader(text), Path())


def _equation(data: bytes) -> None:
    from fitters.own_model.equation import model_from_equation

    text = data.decode("utf-8", "surrogateescape")
    _refusing(lambda _: model_from_equation(text), Path())


def _machine_code(data: bytes) -> None:
    """What lies damaged in the cache of machine code is never executed."""
    from fitters.integrator import machine_code

    name = "0" * 64
    with tempfile.TemporaryDirectory(prefix="iris-fuzz-") as folder, pytest.MonkeyPatch.context() as patch:
        Path(folder, name).write_bytes(data)
        Path(folder, name).chmod(0o600)
        patch.setenv(VARIABLE, folder)
        assert machine_code._loaded(name) is None


FUZZ_TARGETS: Mapping[str, Target] = {
    "csv": readers_of("table.csv", read_trajectory, read_track),
    "excel": readers_of("table.xlsx", read_trajectory),
    "documents": readers_of("document.json", _documents, read_calibration),
    "side-car": readers_of("beside.json", _beside),
    "osp-tracker": readers_of("project.trk", _marks),
    "archive": readers_of("project.trz", _marks, _frames),
    "png": readers_of("1.png", lambda path: _frames(path.parent), grey_image),
    "jpeg": readers_of("1.jpg", lambda path: _frames(path.parent), grey_image),
    "tiff": readers_of("1.tiff", lambda path: _frames(path.parent), grey_image),
    "video": readers_of("clip.mp4", _frames, lambda path: _frames(path, keep_partial=True), _sampled),
    "option": _options,
    "equation": _equation,
    "machine-code": _machine_code,
}

"""Direct measurements: the file for ``--measured``, and a template with the published values."""

from __future__ import annotations

import math
from pathlib import Path

from iris_sysid.benchmark.sources.published import truths
from iris_sysid.calibration.board.board import Board
from iris_sysid.errors import DataError
from iris_sysid.io.json_documents import read_document
from iris_sysid.io.schemas.groundtruth import ANY, BoardEntry, MeasuredDocument, MeasuredValue
from iris_sysid.pipeline.clip_folders import benchmark_classes

TEXT = "app:direct_measurement"  # where the publication says how it measured
CALIPERS = 1e-5  # m: "resolution 0.01 mm"
RADII_M = {"big": 0.11, "mid": 0.07, "small": 0.04}  # balls of the falling ball, in the list of phenomena
GRAVITY = (9.81, 0.02)  # m/s^2; "standard local value": that of latitudes 0 to 60 degrees lies within these limits
INSTRUMENTS = {"m": "tape measure, mean of three", "deg": "protractor or inclinometer"}


def read_measured(path: str | Path) -> MeasuredDocument:
    """Read and check a file of direct measurements; DataError when it is not one, or gives a value twice."""
    document = read_document(path, MeasuredDocument)
    seen = set()
    for value in document.values:
        key = (value.class_name, value.setting, value.parameter)
        if key in seen:
            raise DataError(f"{path}: {' '.join(key)} is given twice; give it once")
        seen.add(key)
    return document


def with_board(document: MeasuredDocument, board: Board) -> MeasuredDocument:
    """The ``document`` with the ``board`` for all classes without their own board."""
    values = {"class": ANY, "inner_corners": (board.columns, board.rows), "square_m": board.square_m}
    entry = BoardEntry.model_validate({**values, "stderr_m": board.square_stderr_m})
    return document.model_copy(update={"boards": [*document.boards, entry]})


def template() -> MeasuredDocument:
    """The published direct measurements with their uncertainties, for the user to correct and complete."""
    published = truths()
    direct = published[(published["dataset"] == "iris") & (published["measurement_type"] == "direct")]
    values = [
        _value(
            row["phenomenon"],
            row["setting"],
            benchmark_classes()[row["phenomenon"]][1].parameters.get(row["parameter"], row["parameter"]),
            row["value"],
            row["uncertainty"],
            row["unit"],
            instrument=INSTRUMENTS[row["unit"]],
            source=row["source"],
        )
        for row in direct.to_dict("records")
    ]
    radii = [
        _value(
            "Falling_ball", setting, "ball_radius", radius, CALIPERS, "m", instrument="digital calipers", source=TEXT
        )
        for setting, radius in RADII_M.items()
    ]
    gravity = _value(ANY, ANY, "gravity", *GRAVITY, "m/s^2", source=TEXT, measurement_type="assumed")
    return MeasuredDocument(values=[gravity, *radii, *values])


def _value(
    class_name: str, setting: str, parameter: str, value: float, uncertainty: float, unit: str, **more: str
) -> MeasuredValue:
    half_width = 0.0 if math.isnan(uncertainty) else uncertainty
    return MeasuredValue.model_validate(
        {"class": class_name, "setting": setting, "parameter": parameter, "value": value, "uncertainty": half_width}
        | {"unit": unit, **more}
    )

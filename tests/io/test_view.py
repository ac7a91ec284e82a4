"""Sensor and view of a trajectory in the file beside its table, which may come from anywhere."""

import json

import numpy as np
import pytest

from iris_sysid.errors import DataError
from iris_sysid.io.csv_write import read_trajectory, write_trajectory
from iris_sysid.types import Quantity, Trajectory, View

VIEW = View(
    "angle", (640.5, 80.25), (500.0, 1.5), (-1.5, -500.0), (1280.0, 720.0), (639.5, 359.5), 925.125, pivot="arc"
)


def written(tmp_path, **fields):
    values = np.arange(4.0)[:, None]
    clip = Trajectory(
        np.arange(4) / 60, (Quantity("theta", "rad"),), values, 0 * values + 0.1, np.ones(4, bool), **fields
    )
    return write_trajectory(clip, tmp_path / "trajectory.csv")


def rewrite(path, change):
    beside = path.with_name(path.name + ".origin.json")
    content = json.loads(beside.read_text())
    change(content)
    beside.write_text(json.dumps(content))


def test_sensor_and_view_are_read_back(tmp_path):
    read = read_trajectory(written(tmp_path, sensor="camera", view=VIEW))
    assert (read.sensor, read.view) == ("camera", VIEW)


def test_table_without_a_file_beside_it_has_no_known_sensor(tmp_path):
    path = written(tmp_path, sensor="encoder")
    path.with_name(path.name + ".origin.json").unlink()
    read = read_trajectory(path)
    assert (read.sensor, read.view) == ("unknown", None)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"focal_px": 0.0}, "focal_px"),
        ({"size_px": [0.0, 720.0]}, "size_px"),
        ({"axis_px": [1e300, 0.0]}, "axis_px"),
        ({"up_px": [500.0, 1.5]}, "must not be parallel"),
        ({"kind": "plane"}, "plane is not what this table holds"),
        ({"kind": "sphere"}, "kind"),
        ({"origin_px": [1.0, 2.0, 3.0]}, "origin_px"),
    ],
)
def test_view_that_cannot_be_is_refused_with_its_key(tmp_path, change, message):
    path = written(tmp_path, sensor="camera", view=VIEW)
    rewrite(path, lambda content: content["view"].update(change))
    with pytest.raises(DataError, match=message):
        read_trajectory(path)


def test_sensor_that_does_not_exist_is_refused(tmp_path):
    path = written(tmp_path)
    rewrite(path, lambda content: content.update(sensor="radar"))
    with pytest.raises(DataError, match="sensor"):
        read_trajectory(path)

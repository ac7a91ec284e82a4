"""A class of drops: the rulers of a fall tell a wrong clock from a wrong scale, and a tilted camera from both."""

import numpy as np
import pytest

from iris_sysid.classroom.groups import Group, GroupRequest, sources_in
from iris_sysid.classroom.measure import measure_groups, page_of
from iris_sysid.classroom.summary import summary_of
from iris_sysid.registry import PHENOMENA
from tests.classroom._tables import write_table

FAULTS = {"g2": "clock", "g5": "scale", "g7": "tilt"}


@pytest.fixture(scope="module")
def drops(tmp_path_factory):
    folder, rng = tmp_path_factory.mktemp("drops"), np.random.default_rng(3)
    (folder / "tables").mkdir()
    for k in range(1, 10):
        fault = FAULTS.get(f"g{k}")
        t_s, turn = np.arange(0, 0.6, 1 / 120), np.radians(9.0 if fault == "tilt" else rng.normal(0, 0.5))
        fallen = 9.81 / 2 * t_s**2 * (1.3 if fault == "scale" else 1 + 0.003 * rng.standard_normal())
        position = np.column_stack([np.sin(turn) * fallen, 2.0 - np.cos(turn) * fallen])
        position += 1e-3 * rng.standard_normal(position.shape)
        write_table(folder / "tables" / f"g{k}.csv", 4 * t_s if fault == "clock" else t_s, position)
    request = GroupRequest(PHENOMENA["dropping-ball"])
    groups = [Group(source, request) for source in sources_in(folder / "tables")]
    documents, _ = measure_groups(groups, folder / "out")
    return summary_of(documents, [page_of(group) for group in groups])


def test_clock_scale_and_tilt_of_a_fall_are_told_apart(drops):
    assert {group.name: [cause.kind for cause in group.causes] for group in drops.named} == {
        name: [kind] for name, kind in FAULTS.items()
    }


def test_slow_motion_is_named_with_both_frame_rates(drops):
    said = {group.name: group.cause for group in drops.groups}
    assert said["g2"].startswith("a 30 fps file of a 120 fps recording: all its times are 4")


def test_gravity_of_the_class_is_that_of_the_others(drops):
    assert drops.value == "gravity"
    assert abs(drops.pooled.mean.value - 9.81) < 3 * drops.pooled.mean.stderr + 0.02

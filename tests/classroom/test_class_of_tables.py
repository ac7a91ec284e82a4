"""A class of tables: five planted faults are named and no other, and the value of all is right."""

import numpy as np
import pytest

from iris_sysid.classroom.groups import Group, GroupRequest, sources_in
from iris_sysid.classroom.measure import measure_groups, page_of
from iris_sysid.classroom.summary import summary_of
from iris_sysid.errors import DataError, UnknownNameError
from iris_sysid.registry import PHENOMENA
from iris_sysid.types import Estimate
from tests._motions import on_arc, pendulum_angle
from tests.classroom._tables import FAULTS, write_class, write_table

PENDULUM = PHENOMENA["pendulum"]
MOON = {"gravity": Estimate(1.62, 0.0, "m/s^2", "direct", "given")}


def groups_of(folder, column=None, **known):
    requests = {name: GroupRequest(PENDULUM, settings=settings) for name, settings in known.items()}
    common = GroupRequest(PENDULUM)
    return [Group(source, requests.get(source.group, common)) for source in sources_in(folder, column)]


def result_of(groups, folder, **options):
    documents, _ = measure_groups(groups, folder)
    return summary_of(documents, [page_of(group) for group in groups], **options)


@pytest.fixture(scope="module")
def faulty(tmp_path_factory):
    folder = tmp_path_factory.mktemp("class")
    write_class(folder / "tables")
    groups = groups_of(folder / "tables", group10=MOON)
    return result_of(groups, folder / "out", known={"length": Estimate(0.5, 0.001, "m")}), folder / "out"


def test_five_planted_faults_are_named_and_no_other(faulty):
    result, _ = faulty
    assert {group.name: [cause.kind for cause in group.causes] for group in result.named} == {
        name: [kind] for name, kind in FAULTS.items()
    }


def test_causes_are_told_in_plain_words_with_numbers(faulty):
    said = {group.name: group.cause for group in faulty[0].groups}
    assert said["group12"].startswith("a 30 fps file of a 240 fps recording: all its times are ")
    assert said["group7"].startswith("camera tilted: it rests 8")
    assert said["group3"].startswith("wrong scale: all its lengths are 1.5")
    assert "1.62 m/s^2" in said["group10"]
    assert said["group1"] == ""


def test_value_of_the_class_is_that_of_the_groups_that_do_not_stand_out(faulty):
    result, _ = faulty
    left_out = {group.name for group in result.groups if not group.pooled}
    assert left_out == {"group5", "group10", "group12"}  # a swing needs neither scale nor vertical
    assert abs(result.pooled.mean.value - 0.5) < 3 * result.pooled.mean.stderr
    assert 0.001 < result.pooled.between.value < 0.004
    assert abs(result.every.mean.value - 0.5) > 0.1
    (known,) = result.comparisons
    assert known.text.startswith("agrees with what is known, 0.5000 ± 0.0010 m")


def test_every_group_has_a_page_of_its_own(faulty):
    result, folder = faulty
    assert all((folder / group.page).is_file() for group in result.groups)


def test_a_class_without_faults_names_nobody(tmp_path):
    write_class(tmp_path / "tables", 8, seed=5, faults={})
    result = result_of(groups_of(tmp_path / "tables"), tmp_path / "out")
    assert result.named == []
    assert all(group.pooled for group in result.groups)


def test_a_second_run_measures_only_what_changed(tmp_path):
    write_class(tmp_path / "tables", 4, faults={})
    groups = groups_of(tmp_path / "tables")
    first, now = measure_groups(groups, tmp_path / "out")
    assert now == 4
    table = tmp_path / "tables" / "group2.csv"
    table.write_text("\n".join(table.read_text().splitlines()[:-1]) + "\n")
    (tmp_path / "out" / page_of(groups[2])).unlink()  # as an interrupted run leaves it
    second, now = measure_groups(groups, tmp_path / "out")
    assert now == 2
    assert second[0] == first[0]
    assert second[1] != first[1]


def test_a_group_that_cannot_be_read_is_named_with_the_reason(tmp_path):
    write_class(tmp_path / "tables", 4, faults={})
    (tmp_path / "tables" / "group2.csv").write_text("t_s,x_m,z_m\n0,1,2\n0.1,a,3\n")
    told = []
    groups = groups_of(tmp_path / "tables")
    documents, _ = measure_groups(groups, tmp_path / "out", tell=told.append)
    result = summary_of(documents, [page_of(group) for group in groups])
    (named,) = result.named
    assert named.name == "group2"
    assert "line 3" in named.cause
    assert "is not a number" in told[0]


def test_teacher_is_compared_and_in_no_mean(tmp_path):
    write_class(tmp_path / "tables", 5, faults={})
    groups = groups_of(tmp_path / "tables")
    documents, _ = measure_groups(groups, tmp_path / "out")
    pages = [page_of(group) for group in groups]
    result = summary_of(documents[1:], pages[1:], teacher=(documents[0], pages[0]))
    assert len(result.groups) == 4
    assert not result.teacher.pooled
    assert "the teacher's own" in result.comparisons[0].text
    own = result.comparisons[0].reference
    assert own.interval == pytest.approx((own.value - 1.96 * own.stderr, own.value + 1.96 * own.stderr), rel=1e-3)


def test_one_table_of_many_groups_is_a_class(tmp_path):
    write_class(tmp_path / "tables", 4, faults={})
    rows = ["team;t_s;x_m;z_m"]
    for k in range(1, 5):
        lines = (tmp_path / "tables" / f"group{k}.csv").read_text().splitlines()[1:]
        rows += [f"T{k};{line.replace(',', ';')}" for line in lines]
    (tmp_path / "all.csv").write_text("\n".join(rows) + "\n")
    groups = groups_of(tmp_path / "all.csv")
    assert [group.name for group in groups] == ["T1", "T2", "T3", "T4"]
    apart = result_of(groups_of(tmp_path / "tables"), tmp_path / "apart")
    together = result_of(groups, tmp_path / "together")
    values = [[group.value.value for group in result.groups] for result in (apart, together)]
    np.testing.assert_allclose(*values, rtol=1e-9)


def test_longer_pendulum_is_no_fault_of_the_measurement(tmp_path):
    write_class(tmp_path / "tables", 7, faults={})
    t_s = np.arange(0, 4, 1 / 60)
    position = on_arc(pendulum_angle(t_s, 0.35, 0.8), 0.8)
    position += 5e-4 * np.random.default_rng(1).standard_normal(position.shape)
    write_table(tmp_path / "tables" / "group4.csv", t_s, position)
    result = result_of(groups_of(tmp_path / "tables"), tmp_path / "out")
    (named,) = result.named
    assert (named.name, [cause.kind for cause in named.causes]) == ("group4", ["another-length"])


def test_unknown_and_held_values_are_refused_with_what_there_is(faulty):
    documents = [group.document for group in faulty[0].groups]
    pages = [group.page for group in faulty[0].groups]
    with pytest.raises(UnknownNameError, match="no group has a value 'mass'; they have length, damping"):
        summary_of(documents, pages, value="mass")
    with pytest.raises(DataError, match="gravity is held in every group, not measured"):
        summary_of(documents, pages, known={"gravity": Estimate(9.81, 0.0, "m/s^2")})

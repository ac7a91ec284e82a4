"""The schedule on paper: the clips of the publication, and the time until the last of them is done."""

import pytest

from validation.scaling import OTHER_MS, PENDULUM_MS, makespan, paper_table, published_clips


def test_clips_are_those_of_the_publication():
    assert len(published_clips()) == 240
    assert sum(frames for _, frames in published_clips()) == 372_600


@pytest.mark.parametrize(("workers", "hours"), [(1, 7.0), (2, 5.0), (3, 4.0), (9, 3.0)])
def test_jobs_begin_in_their_order_with_the_first_free_worker(workers, hours):
    assert makespan([1.0, 1.0, 1.0, 1.0, 3.0], workers) == hours


def test_many_machines_wait_for_the_longest_clip():
    table = paper_table(each_s=0.0, ratio=1.0)
    longest_s = max(n * (PENDULUM_MS if name == "pendulum" else OTHER_MS) for name, n in published_clips()) / 1e3
    assert float(table["64 machines, h"][0]) == pytest.approx(longest_s / 3600, abs=0.01)
    assert float(table["1 machine, h"][1]) == pytest.approx(float(table["core hours"][1]) / 8, rel=0.01)

"""Jobs in several processes: all are done, and one that kills its process does not end the others."""

from __future__ import annotations

import os
import resource
from pathlib import Path

import pytest

from iris_sysid.errors import DataError
from iris_sysid.pipeline.batch import Batch
from iris_sysid.pipeline.parallel import JOBS_A_PROCESS, check_workers, run_parallel
from iris_sysid.video.sandbox import MAX_BYTES
from tests.pipeline._jobs import crowded, minus_one, most_memory, noted_square, squared

BATCH = Batch(Path(), squared, minus_one)


def test_without_workers_the_jobs_are_done_in_turn_in_this_process():
    this = Batch(Path(), lambda folder, number: (number, os.getpid()), minus_one)  # no process could import it
    assert list(run_parallel(this, [2, 1], 0)) == [(2, (2, os.getpid())), (1, (1, os.getpid()))]


def test_crash_of_the_only_job_costs_that_job_alone():
    assert list(run_parallel(BATCH, [3], 1)) == [(3, -1)]


def test_job_that_ends_its_process_is_lost_and_all_others_are_done():
    done = dict(run_parallel(BATCH, [1, 2, 3, 4], 2))
    assert done == {1: 1, 2: 4, 3: -1, 4: 16}


def test_crash_leaves_the_process_beside_it_at_work(tmp_path):
    done = dict(run_parallel(Batch(tmp_path, noted_square, minus_one), [3, *range(4, 12)], 2))
    assert done == {3: -1, **{number: number**2 for number in range(4, 12)}}
    processes = {number: (tmp_path / str(number)).read_text() for number in (4, 5, 6)}
    assert processes[4] in (processes[5], processes[6])


def test_process_is_replaced_before_it_grows(tmp_path):
    jobs = list(range(4, 15))
    assert dict(run_parallel(Batch(tmp_path, noted_square, minus_one), jobs, 1)) == {n: n**2 for n in jobs}
    assert len({(tmp_path / str(number)).read_text() for number in jobs}) == -(-len(jobs) // JOBS_A_PROCESS)


def test_job_without_enough_memory_is_lost_and_its_process_goes_on(tmp_path):
    assert dict(run_parallel(Batch(tmp_path, crowded, minus_one), [3, 4], 1)) == {3: -1, 4: 4}
    assert (tmp_path / "3").read_text() == (tmp_path / "4").read_text()


def test_other_processes_have_limits_and_this_one_has_not(tmp_path):
    batch = Batch(tmp_path, most_memory, minus_one)
    assert list(run_parallel(batch, [1], 1)) == [(1, MAX_BYTES)]
    assert list(run_parallel(batch, [1], 0)) == [(1, resource.RLIM_INFINITY)]


def test_jobs_that_are_equal_are_each_done():
    assert list(run_parallel(BATCH, [2, 2], 2)) == [(2, 4), (2, 4)]


@pytest.mark.parametrize("workers", [-1, 257, 1.5, " "])
def test_number_of_workers_is_checked(workers):
    with pytest.raises(DataError, match="workers must be a whole number from 0 to 256"):
        check_workers(workers)

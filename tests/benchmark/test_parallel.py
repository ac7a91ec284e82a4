"""Jobs in several processes: all are done, and one that kills its process does not end the others."""

from __future__ import annotations

import os

import pytest

from iris_sysid.benchmark.parallel import check_workers, side_by_side
from iris_sysid.errors import DataError


def squared(number: int) -> int:
    """The square of a number; 3 ends the process as a lack of memory does."""
    if number == 3:
        os._exit(9)
    return number**2


def minus_one(number: int) -> int:
    """What stands for a job that was lost."""
    return -1


def test_one_worker_does_the_jobs_in_turn_in_this_process():
    assert list(side_by_side(squared, [2, 1], 1, minus_one)) == [(2, 4), (1, 1)]


def test_job_that_ends_its_process_is_lost_and_all_others_are_done():
    done = dict(side_by_side(squared, [1, 2, 3, 4], 2, minus_one))
    assert done == {1: 1, 2: 4, 3: -1, 4: 16}


def test_jobs_that_are_equal_are_each_done():
    assert list(side_by_side(squared, [2, 2], 2, minus_one)) == [(2, 4), (2, 4)]


@pytest.mark.parametrize("workers", [0, -1, 257, 1.5, "2"])
def test_number_of_workers_is_checked(workers):
    with pytest.raises(DataError, match="workers must be a whole number from 1 to 256"):
        check_workers(workers)

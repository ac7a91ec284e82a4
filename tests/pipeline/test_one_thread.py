"""Fits and searches run on one thread of linear algebra, and leave the number of threads as it was."""

import numpy as np
import pytest
import scipy.linalg  # noqa: F401  # has a library of its own
from threadpoolctl import threadpool_info, threadpool_limits

from iris_sysid import MODELS, diagnose, fit, fit_clips, plan, select_model
from iris_sysid.calibration.board.calibrate import calibrate_board
from iris_sysid.io.one_thread import on_one_thread


def blas_threads():
    return [library["num_threads"] for library in threadpool_info() if library["user_api"] == "blas"]


@pytest.fixture
def two_threads():
    with threadpool_limits(limits=2, user_api="blas"):
        yield blas_threads()


def test_function_sees_one_thread_and_the_number_before_comes_back(two_threads):
    inside = on_one_thread(blas_threads)()
    assert inside == [1] * len(two_threads)
    assert blas_threads() == two_threads


def test_number_of_threads_comes_back_after_an_error(two_threads):
    with pytest.raises(np.linalg.LinAlgError):
        on_one_thread(np.linalg.inv)(np.zeros((2, 2)))
    assert blas_threads() == two_threads


@pytest.mark.parametrize("entry", [fit, fit_clips, select_model, diagnose, plan, calibrate_board])
def test_entries_of_the_library_are_limited(entry, two_threads):
    found = []

    class Stop(Exception):
        pass

    class Clips:
        def __iter__(self):
            found.append(blas_threads())
            raise Stop

        def __getattribute__(self, name):
            return iter(self)

    with pytest.raises(Stop):
        entry(Clips(), *([Clips()] if entry is plan else [MODELS["pendulum"]]))
    assert found[0] == [1] * len(two_threads)

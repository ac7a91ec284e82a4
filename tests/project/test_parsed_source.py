"""Python source is parsed in several threads at once, as a review's page and its fit do."""

import gc
import time
from pathlib import Path
from threading import Thread

import pytest

from iris_sysid.registry import parsed

SOURCES = [path.read_bytes() for path in Path(__file__).parent.glob("*.py")]


class Dropped:
    """Garbage whose end lets another thread run, in the middle of whatever collects it."""

    def __init__(self):
        self.own = self

    def __del__(self):
        time.sleep(0)


@pytest.fixture
def eager_collector():
    before = gc.get_threshold()
    gc.set_threshold(50, 1, 1)
    yield
    gc.set_threshold(*before)


def test_threads_that_parse_at_once_do_not_disturb_each_other(eager_collector):
    failures = []

    def parse_all(depth):
        if depth:
            return parse_all(depth - 1)
        for source in SOURCES:
            Dropped()
            try:
                parsed(source)
            except SystemError as error:
                failures.append(str(error))
        return None

    threads = [Thread(target=parse_all, args=(depth,)) for depth in (0, 7)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert failures == []

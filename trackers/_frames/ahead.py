"""Work on several frames at once, in threads: the kernels of numba and OpenCV let each other run."""

from __future__ import annotations

import os
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from typing import TypeVar

import cv2

Item = TypeVar("Item")
Result = TypeVar("Result")
MAX_WORKERS = 4  # of more, most wait for the interpreter


def ahead(work: Callable[[Item], Result], items: Iterable[Item]) -> Iterator[Result]:
    """The results of some work on each item, in order; the next items are made and worked on meanwhile.

    The work on one item must not depend on that on another. At most one item more than there are workers is held.
    """
    workers, own_threads = min(MAX_WORKERS, os.cpu_count() or 1), cv2.getNumThreads()
    cv2.setNumThreads(1)  # OpenCV's own wait for each other longer than small images take
    waiting: deque[Future[Result]] = deque()
    pool = ThreadPoolExecutor(workers)
    try:
        for item in items:
            waiting.append(pool.submit(work, item))
            if len(waiting) > workers:
                yield waiting.popleft().result()
        while waiting:
            yield waiting.popleft().result()
    finally:
        pool.shutdown(cancel_futures=True)
        cv2.setNumThreads(own_threads)

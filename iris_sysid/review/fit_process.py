"""A fit in a separate process: the page goes on as fast as without it, and a fit that an edit made old is ended."""

from __future__ import annotations

import multiprocessing
from collections.abc import Callable
from dataclasses import replace
from multiprocessing.connection import Connection

from iris_sysid.errors import FitError
from iris_sysid.types import Run
from iris_sysid.video.reader import Video

LOOK_S = 0.05  # between two questions whether the fit is still wanted


class AbandonedError(Exception):
    """The fit was ended before it was done, since a newer one is wanted."""


def fitted_apart(fit: Callable[[Video], Run], video: Video, is_old: Callable[[], bool]) -> Run:
    """The run that ``fit(video)`` gives, computed in another process, where the clip is opened anew.

    ``fit`` can be pickled, and so can what it raises, which is raised here. The process is ended, with AbandonedError,
    once ``is_old`` says True; FitError when it died, as without enough memory.
    """
    context = multiprocessing.get_context("spawn")  # a fork would copy locks that threads of the decoder hold
    here, there = context.Pipe(duplex=False)
    process = context.Process(target=_send, args=(fit, video, there), name="fit of all frames", daemon=True)
    process.start()
    there.close()
    try:
        while not here.poll(LOOK_S):
            if is_old():
                raise AbandonedError
        run = here.recv()
    except EOFError:
        raise FitError("the process that fits all frames has died; is there enough memory?") from None
    finally:
        process.kill()
        process.join()
        here.close()
    if isinstance(run, Exception):
        raise run
    return replace(run, video=video)


def _send(fit: Callable[[Video], Run], video: Video, there: Connection) -> None:
    try:
        answer: Run | Exception = fit(video)
    except Exception as error:  # for the other process, which says it
        answer = error
    there.send(answer)

"""Progress of long work: one generator that reports it, for every loop over frames, clips or studies."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from typing import TypeVar

Progress = Callable[[int, int], None]  # called with (items done, items expected); 0 expected: the number is unknown
Item = TypeVar("Item")


def with_progress(
    items: Iterable[Item], progress: Progress | None, expected: int, *, every: int = 1, done: int = 0
) -> Iterator[Item]:
    """Yield the items, and report each time ``every`` more of them are done, and after the last.

    An item counts as done when the next one is requested, that is, at the end of the loop's body.

    Parameters
    ----------
    items
        The items of the loop.
    progress
        Called with (items done, items expected); None reports nothing.
    expected
        Expected number of items; 0 where that is unknown. A container may declare fewer than it holds.
    every
        Report after this many items.
    done
        Number of items done before this loop; they are reported at once.
    """
    start = done
    if progress is not None and start:
        progress(done, _at_least(expected, done))
    for item in items:
        yield item
        done += 1
        if progress is not None and (done - start) % every == 0:
            progress(done, _at_least(expected, done))
    if progress is not None and (done - start) % every:
        progress(done, _at_least(expected, done))


def part_of_progress(progress: Progress | None, part: int, parts: int) -> Progress | None:
    """Progress of the ``part``-th, from 0, of several parts of equal length, reported as progress of the whole."""
    if progress is None:
        return None
    return lambda done, expected: progress((done + part * expected) // parts, expected)


def _at_least(expected: int, done: int) -> int:
    return max(expected, done) if expected else 0

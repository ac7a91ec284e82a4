"""Whether two halves of a real recording, fitted apart, give the same values within their standard errors.

A real recording has no known truth, and every equation lacks something there; but what belongs to the set-up is the
same in both halves, although amplitude and speed are not.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from contextlib import suppress

import numpy as np
import pandas as pd

from fitters.validation_record import cut_record
from iris_sysid import FitResult, Trajectory, fit
from iris_sysid.errors import IrisError
from iris_sysid.types import NORMAL_975
from validation import pages
from validation.world_recordings import chosen
from validation.world_tables import Recording

MIN_SAMPLES = 40  # of a half
MAX_CLIPS = 4  # of a recording


def pairs(recording: Recording) -> Iterator[tuple[FitResult, FitResult]]:
    """The fits of the two halves of each clip that is long enough, where both are usable."""
    for clip in recording.clips()[:MAX_CLIPS]:
        count = int(clip.valid.sum()) // 2
        if count >= MIN_SAMPLES:
            first, second = cut_record(clip, count)
            assert first is not None
            with suppress(IrisError):  # one that is not usable, for want of motion
                yield _fitted(recording, first), _fitted(recording, second)


def _fitted(recording: Recording, half: Trajectory) -> FitResult:
    return fit(half, recording.model, fixed=recording.fixed, free=recording.free)


def rows(recording: Recording) -> Iterator[dict[str, object]]:
    """One row for each value of the set-up that both halves determine."""
    for first, second in pairs(recording):
        starts = set(first.model.initial_names)
        for name in first.free:
            one, other = first.estimates[name], second.estimates[name]
            error = float(np.hypot(one.stderr, other.stderr))
            if name not in starts and np.isfinite(error) and error > 0:
                yield {
                    "recording": recording.name,
                    "value": name,
                    "first half": f"{one.value:.4g} ± {one.stderr:.2g}",
                    "second half": f"{other.value:.4g} ± {other.stderr:.2g}",
                    "unit": one.unit,
                    "difference / standard error": round((one.value - other.value) / error, 2),
                    "standard error / value, %": round(100 * error / max(abs(one.value), 1e-300), 3),
                }


def main() -> None:
    """Print the table, and how often halves agree."""
    parser = argparse.ArgumentParser(description=__doc__)
    pages.add_option(parser)
    options = parser.parse_args()
    with pages.table("halves", options.write_docs):
        found = [row for recording in chosen(without="piston") for row in rows(recording)]
        table = pd.DataFrame(found)
        agree = table["difference / standard error"].abs() < NORMAL_975
        error = table["standard error / value, %"].groupby(table["value"]).median()
        print(pages.markdown(table))
        print(f"\n{agree.sum()} of {len(table)} values agree. Median error of a length {error['length']:.2g} %.")


if __name__ == "__main__":
    main()

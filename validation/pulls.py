"""Standard errors of tracks on synthetic clips: error over standard error, frame by frame.

``python -m validation.pulls --dataset DATASET [--number 2 5]`` tracks some clips of each setting of a data set that
``iris-sysid render`` wrote, each with its phenomenon's tracker, and prints a row a body: the standard deviation of the
errors, the stated standard error, the standard deviation of error over standard error (ideally 1), and the share of
frames beyond 1.96 standard errors of their mean (ideally 5 %). Frames in which a hand holds the body do not count.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Iterator, Sequence
from itertools import groupby
from pathlib import Path

import numpy as np
from scipy.optimize import linear_sum_assignment

from iris_sysid import open_video
from iris_sysid.benchmark.dataset import Clip, list_clips
from iris_sysid.errors import IrisError
from iris_sysid.registry import PHENOMENA, TRACKERS
from iris_sysid.synthetic import Truth, read_truth
from iris_sysid.types import Array, Track, TrackOptions
from validation import pages

FAR = 1.0  # of the radius: a track with a larger median error belongs to another body


def clips_of(dataset: Path, numbers: Sequence[int]) -> Iterator[Clip]:
    """The clips with these numbers (from 1) of each class and setting."""
    for _, same in groupby(list_clips(dataset).clips, key=lambda clip: (clip.class_name, clip.setting)):
        yield from (clip for number, clip in enumerate(same, start=1) if number in numbers)


def tracked(truth: Truth, clip: Clip) -> list[Track]:
    """The tracks of a clip by its phenomenon's tracker."""
    options = TrackOptions(bodies=truth.table["body"].nunique())
    return TRACKERS[PHENOMENA[clip.phenomenon].tracker].track(open_video(clip.path), options)


def matched(truth: Truth, tracks: Sequence[Track]) -> Iterator[tuple[Track, Array, float]]:
    """Each track with the true positions (n, 2) of its body, px, NaN where a hand holds it, and the body's radius."""
    bodies = [truth.body(name) for name in truth.table["body"].unique()]
    places = []
    for body in bodies:
        xy = body[["x_px", "y_px"]].to_numpy(copy=True)
        xy[body["phase"].to_numpy() == "hand"] = np.nan
        places.append(xy)
    away = np.array([[np.nanmedian(np.hypot(*(track.xy_px - xy).T)) for xy in places] for track in tracks])
    for track, own in zip(*linear_sum_assignment(np.nan_to_num(away, nan=1e9)), strict=True):
        yield tracks[int(track)], places[int(own)], float(bodies[int(own)]["radius_px"].median())


def row(track: Track, true_px: Array, radius_px: float) -> str | None:
    """One row of the table; None where the track belongs to another body."""
    free = track.valid & np.isfinite(true_px[:, 0])
    if track.hand is not None:
        free &= ~track.hand
    error, sigma = (track.xy_px - true_px)[free], track.sigma_px[free]
    if not free.any() or np.median(np.hypot(*error.T)) > FAR * radius_px:
        return None
    # less their weighted mean: no fit depends on a constant shift
    pull = (error - np.average(error, axis=0, weights=sigma**-2)) / sigma
    numbers = (
        error.std(axis=0),
        np.median(sigma, axis=0),
        np.sqrt(np.mean(pull**2, axis=0)),
        (np.abs(pull) > 1.96).mean(axis=0),
    )
    return " | ".join([str(np.count_nonzero(free)), *(f"{across:.3f}, {down:.3f}" for across, down in numbers)])


def main() -> None:
    """Print a row a body."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--dataset", type=Path, required=True, help="synthetic data set")
    parser.add_argument("--number", type=int, nargs="+", default=[1], help="clips of each setting, from 1")
    parser.add_argument("--classes", nargs="+", help="only these folders of the data set")
    pages.add_option(parser)
    options = parser.parse_args()
    with pages.table("pulls", options.write_docs):
        print(
            "| clip | body | frames | sd of errors, px | told, px | pull sd | beyond 1.96 |\n"
            "|---|---|---|---|---|---|---|"
        )
        for clip in clips_of(options.dataset, options.number):
            if options.classes and clip.class_name not in options.classes:
                continue
            truth = read_truth(clip.path)
            try:
                tracks = tracked(truth, clip)
            except IrisError as error:
                print(f"{clip.place}: {error}", file=sys.stderr, flush=True)
                continue
            for track, true_px, radius in matched(truth, tracks):
                line = row(track, true_px, radius)
                print(f"| {clip.place} | {track.body} | {line or 'not that body'} |", flush=True)


if __name__ == "__main__":
    main()

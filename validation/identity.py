"""Identity of tracked bodies: switches, coverage, HOTA, IDF1 and error over synthetic clips.

``python -m validation.identity`` renders clips of the phenomena with several bodies, the settings of the benchmark's
table in turn, each clip with its own seed, follows the bodies, and compares with the truth beside each clip.
``--scores FILE`` keeps the score of each clip, so that an interrupted run continues. ``--dataset DATASET --tracks
FOLDER`` compares the tracks that ``iris-sysid gt`` or ``validation.groundtruth`` kept of a synthetic data set
instead.
"""

from __future__ import annotations

import argparse
import json
import sys
import tempfile
import time
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np
from scipy.optimize import linear_sum_assignment

from iris_sysid import open_video
from iris_sysid.benchmark.dataset import list_clips
from iris_sysid.errors import IrisError
from iris_sysid.io.csv_read import read_track
from iris_sysid.pipeline.clip_folders import benchmark_classes
from iris_sysid.registry import PHENOMENA, TRACKERS
from iris_sysid.synthetic import SCENES, Truth, read_truth, render_clip
from iris_sysid.types import Track, TrackOptions
from validation import pages

CLASSES = ("two-moving-pendulums", "two-moving-pendulum-one-static", "hitting-cones")
SECONDS = 5.0  # of each clip: in half of that a hand, or a pile that stands, covers a body for too much of it
THRESHOLDS = np.arange(0.05, 0.96, 0.05)  # of similarity, as in the definition of HOTA
MATCHED = 0.5  # of similarity, for switches, IDF1 and the error
SIZE = (640, 360)  # px


@dataclass(frozen=True, slots=True)
class Score:
    """Score of one clip, or of several pooled."""

    clips: int
    switches: int
    seen: int
    usable: int
    hota: float
    idf1: float
    rmse_px: float


def similarity(true_px: np.ndarray, found_px: np.ndarray, radius_px: np.ndarray) -> np.ndarray:
    """1 where a body is found at its centre, 0 from its radius on: (n, bodies, tracks); 0 where either is absent.

    ``true_px`` (n, bodies, 2) and ``found_px`` (n, tracks, 2) are NaN where absent; ``radius_px`` (bodies,).
    """
    apart = np.linalg.norm(true_px[:, :, np.newaxis] - found_px[:, np.newaxis], axis=-1)
    return np.nan_to_num(np.clip(1 - apart / radius_px[:, np.newaxis], 0, 1), nan=0.0)


def matches(alike: np.ndarray, threshold: float, prior: np.ndarray | None = None) -> np.ndarray:
    """Pairs that match in each frame (n, bodies, tracks), at most one per body and track, of largest total similarity.

    ``prior`` (bodies, tracks) multiplies the similarity as a weight of the pairs.
    """
    overlapping = np.zeros(alike.shape, dtype=bool)
    for k, likeness in enumerate(alike):
        allowed = likeness >= max(threshold, 1e-9)
        weight = 1.0 + likeness if prior is None else prior * likeness
        rows, columns = linear_sum_assignment(np.where(allowed, weight, 0.0), True)
        overlapping[k, rows, columns] = allowed[rows, columns]
    return overlapping


def hota(alike: np.ndarray, n_true: np.ndarray, n_found: np.ndarray) -> float:
    """Higher order tracking accuracy (Luiten et al., IJCV 129, 2021, equations 8 to 11), mean over 19 thresholds.

    Per threshold sqrt(sum of A(c) over the true positives c / (TP + FN + FP)), with
    A(c) = TPA / (TPA + FNA + FPA) of the body and the track that c joins. ``n_true`` (bodies,) and ``n_found``
    (tracks,) count the frames in which each is present. Matches are made as in the authors' TrackEval, by the alignment
    of the whole tracks times the similarity in the frame.
    """
    overlap = alike / np.maximum(alike.sum(1, keepdims=True) + alike.sum(2, keepdims=True) - alike, 1e-12)
    common = overlap.sum(axis=0)
    prior = common / np.maximum(n_true[:, np.newaxis] + n_found - common, 1e-12)
    values = []
    for threshold in THRESHOLDS:
        joined = matches(alike, threshold - 1e-9, prior).sum(axis=0)
        jaccard = joined / np.maximum(n_true[:, np.newaxis] + n_found - joined, 1)
        hits = joined.sum()
        values.append(np.sqrt((joined * jaccard).sum() / max(1, n_true.sum() + n_found.sum() - hits)))
    return float(np.mean(values))


def idf1(alike: np.ndarray, n_true: np.ndarray, n_found: np.ndarray) -> float:
    """Share of the frames in which the one track that suits a body best has it (Ristani et al. 2016, equation 11)."""
    common = (alike >= MATCHED).sum(axis=0)
    rows, columns = linear_sum_assignment(common, maximize=True)
    return float(2 * common[rows, columns].sum() / max(1, n_true.sum() + n_found.sum()))


def switches(alike: np.ndarray) -> int:
    """Number of times that a body changes its track (Bernardin and Stiefelhagen 2008)."""
    joined, changes = matches(alike, MATCHED), 0
    for body in range(alike.shape[1]):
        frames, tracks = np.nonzero(joined[:, body])
        del frames
        changes += int(np.count_nonzero(np.diff(tracks)))
    return changes


def usable_truth(truth: Truth, names: Sequence[str]) -> tuple[np.ndarray, np.ndarray]:
    """Mean position over the exposure (n, bodies, 2) px where a body is wholly in the frame and no hand holds any."""
    bodies = [truth.body(name) for name in names]
    radius = np.array([float(body["radius_px"].median()) for body in bodies])
    xy = np.stack([body[["x_mean_px", "y_mean_px"]].to_numpy(copy=True) for body in bodies], axis=1)
    margin = 1.3 * radius[:, np.newaxis]  # a turned cup reaches so far
    wholly = ((xy > margin) & (xy < np.array(truth.size) - 1 - margin)).all(axis=-1)
    free = bodies[0]["phase"].to_numpy() != "hand"
    xy[~(wholly & free[:, np.newaxis])] = np.nan
    return xy, radius


def score(truth: Truth, tracks: Sequence[Track]) -> Score:
    """Compare the tracks of a clip with its truth, in the frames that are usable."""
    names = list(truth.table["body"].unique())
    true_px, radius = usable_truth(truth, names)
    found_px = np.stack([track.xy_px for track in tracks], axis=1)
    full = similarity(true_px, found_px, radius)
    # a track that follows a body which is not usable (cut by the edge, held) is neither right nor wrong
    every = np.stack([truth.body(name)[["x_mean_px", "y_mean_px"]].to_numpy() for name in names], axis=1)
    ignored = similarity(np.where(np.isnan(true_px), every, np.nan), found_px, 2 * radius).max(axis=1) > 0
    found_px = np.where((ignored & (full.max(axis=1) == 0))[..., np.newaxis], np.nan, found_px)
    alike = similarity(true_px, found_px, radius)
    n_true, n_found = (np.isfinite(xy_px[..., 0]).sum(axis=0) for xy_px in (true_px, found_px))
    frames, bodies, owners = np.nonzero(matches(alike, MATCHED))
    error = true_px[frames, bodies] - found_px[frames, owners]
    return Score(
        clips=1,
        switches=switches(alike),
        seen=len(frames),
        usable=int(n_true.sum()),
        hota=hota(alike, n_true, n_found),
        idf1=idf1(alike, n_true, n_found),
        rmse_px=float(np.sqrt((error**2).sum(axis=-1).mean())) if len(frames) else np.nan,
    )


def run_clip(phenomenon: str, number: int, size: tuple[int, int], duration_s: float, folder: Path) -> Score:
    """Render one clip, follow its bodies, and compare; a clip that cannot be tracked counts as not seen."""
    settings = list(SCENES[phenomenon].settings)
    clip = folder / "clip.mp4"
    truth = render_clip(
        phenomenon,
        clip,
        size=size,
        setting=settings[number % len(settings)],
        seed=1000 + number,
        duration_s=duration_s,
        overwrite=True,
    )
    try:
        tracker = TRACKERS[PHENOMENA[benchmark_classes()[SCENES[phenomenon].folder][0]].tracker]
        tracks = tracker.track(open_video(clip), TrackOptions(bodies=truth.table["body"].nunique()))
    except IrisError as error:
        print(f"{phenomenon}, clip {number}: {error}", file=sys.stderr, flush=True)
        usable = int(np.isfinite(usable_truth(truth, list(truth.table["body"].unique()))[0][..., 0]).sum())
        return Score(1, 0, 0, usable, 0.0, 0.0, np.nan)
    return score(truth, tracks)


def together(scores: Sequence[Score]) -> Score:
    """Sums of counts, means of HOTA and IDF1, and the root mean square of the errors."""
    weights = np.array([score.seen for score in scores], dtype=float)
    squares = np.nan_to_num([score.rmse_px**2 for score in scores])
    return Score(
        clips=len(scores),
        switches=sum(score.switches for score in scores),
        seen=sum(score.seen for score in scores),
        usable=sum(score.usable for score in scores),
        hota=float(np.mean([score.hota for score in scores])),
        idf1=float(np.mean([score.idf1 for score in scores])),
        rmse_px=float(np.sqrt((weights * squares).sum() / weights.sum())) if weights.sum() else np.nan,
    )


def rendered(options: argparse.Namespace, phenomenon: str) -> Iterator[Score]:
    """Scores of clips, rendered and tracked now or read from an earlier run, up to a number or a time limit."""
    start, film = time.monotonic(), [phenomenon, list(options.size), options.seconds]
    lines = options.scores.read_text().splitlines() if options.scores and options.scores.exists() else []
    known = {line["clip"]: Score(**line["score"]) for line in map(json.loads, lines) if line["film"] == film}
    with tempfile.TemporaryDirectory() as folder:
        for number in range(options.clips):
            if number in known:
                yield known[number]
            elif time.monotonic() - start < 60 * options.minutes:
                outcome = run_clip(phenomenon, number, tuple(options.size), options.seconds, Path(folder))
                if options.scores:
                    with options.scores.open("a") as file:
                        file.write(json.dumps({"film": film, "clip": number, "score": asdict(outcome)}) + "\n")
                yield outcome


def kept(phenomenon: str, dataset: Path, tracks: Path) -> Iterator[Score]:
    """Scores of the tracks kept of a synthetic data set; a clip without a track is left out."""
    for clip in list_clips(dataset).clips:
        path = tracks / f"{clip.place}.track.csv"
        if path.exists() and (truth := read_truth(clip.path)).phenomenon == phenomenon:
            result = score(truth, read_track(path))
            if result.switches or result.seen < result.usable:
                print(
                    f"{clip.place}: {result.switches} switches, {result.seen} of {result.usable}",
                    file=sys.stderr,
                    flush=True,
                )
            yield result


def main() -> None:
    """Print one row a phenomenon."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--clips", type=int, default=100, help="clips of each phenomenon")
    parser.add_argument("--phenomenon", choices=CLASSES, action="append", help="only this one; may be repeated")
    parser.add_argument("--seconds", type=float, default=SECONDS, help="length of each clip")
    parser.add_argument("--scores", type=Path, help="file that keeps the score of each clip, to go on from")
    parser.add_argument("--size", type=int, nargs=2, default=SIZE, metavar=("WIDTH", "HEIGHT"), help="px")
    parser.add_argument("--minutes", type=float, default=np.inf, help="begin no clip of a phenomenon after so long")
    parser.add_argument("--dataset", type=Path, help="synthetic data set whose tracks were kept")
    parser.add_argument("--tracks", type=Path, help="folder of the tracks that were kept")
    pages.add_option(parser)
    options = parser.parse_args()
    if (options.dataset is None) != (options.tracks is None):
        parser.error("--dataset and --tracks go together")
    with pages.table("identity" if options.dataset is None else "identity-dataset", options.write_docs):
        print(
            "| phenomenon | clips | identity switches | coverage | HOTA | IDF1 | RMSE px |\n"
            "|---|---|---|---|---|---|---|"
        )
        for phenomenon in options.phenomenon or CLASSES:
            if options.dataset is None:
                scores = list(rendered(options, phenomenon))
            else:
                scores = list(kept(phenomenon, options.dataset, options.tracks))
            if scores:
                all_of = together(scores)
                print(
                    f"| {phenomenon} | {all_of.clips} | {all_of.switches} | {all_of.seen / all_of.usable:.4f} "
                    f"| {all_of.hota:.4f} | {all_of.idf1:.4f} | {all_of.rmse_px:.3f} |",
                    flush=True,
                )


if __name__ == "__main__":
    main()

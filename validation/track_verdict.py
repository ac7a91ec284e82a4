"""The probability that a track is on its body: fitted to clips with marks, tested on recordings left out.

``python -m validation.track_verdict --measure`` follows every open clip of :mod:`validation.real_marks`, drawn phone
clips and rendered clips in every way that ``auto`` knows, and writes a row for each track into
``validation/track_verdict.csv``: the evidence against it, and the share of the body's marks that it meets.
``python -m validation.track_verdict`` fits the weights to that table and prints what they are worth on recordings that
were left out; ``--write`` puts them into ``trackers/_auto/verdict_weights.py``.
"""

from __future__ import annotations

import argparse
import tempfile
import warnings
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from itertools import pairwise, product
from pathlib import Path

import numpy as np
import pandas as pd
from scipy.optimize import minimize
from scipy.special import expit, xlogy

from iris_sysid.errors import IrisError
from iris_sysid.pipeline.one_clip import track
from iris_sysid.synthetic import render_clip
from iris_sysid.types import Array, FrameSource, TrackCandidate, TrackOptions
from iris_sysid.video.reader import open_video
from tests._phone_clips import CLIPS
from trackers._auto.choose import FILLED, no_worse_filled
from trackers._auto.verdict import OFF, WORDS
from validation import pages, receding
from validation.real_marks import MAX_ELSEWHERE, MIN_ON_BODY, compared, marked_clips

TABLE = Path(__file__).with_suffix(".csv")
WEIGHTS = pages.ROOT / "trackers" / "_auto" / "verdict_weights.py"
# too rare in the table to be fitted: what makes a track without other evidence against it just doubtful is two bodies
# in one place in 30 % of the frames, and a gap of all bodies as long as names may change in
FIXED = {"two on one": 8.5, "lost together": 3.0}
NAMES = tuple(name for name in WORDS if name not in (*OFF, *FIXED))
DRAWN, RENDERED = "drawn ", "rendered "  # begin the names of recordings that are no real ones
SCENES = ("pendulum", "sliding-cone", "dropping-ball", "falling-ball")
RATIOS, SEED = (1.0, 1.3, 2.0), 7100  # of the radii of drawn discs; seeds that no other table uses
MADE_UP = 0.2  # weight of a drawn or rendered recording beside a real one: there are many, all alike
RIDGES = (0.0003, 0.001, 0.003, 0.01, 0.03, 0.1)  # on the weights, over the number of recordings
DOUBTFUL, SURE = 0.85, 0.9  # on recordings left out a wrong track that is called good counts as three needless doubts
BINS = (0.0, 0.2, 0.4, 0.6, 0.8, 0.9, 1.0)


@dataclass(frozen=True, slots=True)
class Recording:
    """A clip and its marks; ``bodies`` is their number."""

    name: str
    video: Callable[[], FrameSource]
    marks: Callable[[], pd.DataFrame]
    bodies: int


def recordings(folder: Path) -> Iterator[Recording]:
    """All that the weights are fitted to; rendered clips are made in a folder."""
    for clip in marked_clips("open"):
        if clip.expect == "follow":
            yield Recording(clip.name, partial(open_video, clip.path), clip.marks, clip.bodies)
    for make in CLIPS:
        drawn = make()
        yield _known(DRAWN + make.__name__, drawn.clip, drawn.truth, np.full(drawn.truth.shape[:2], drawn.radius))
    for number, (ratio, wall) in enumerate(product(RATIOS, receding.WALLS)):
        scene = receding.Scene(ratio, wall, 30, nearer=False, seed=SEED + number)
        centre, radius = scene.path()
        clip = receding.Drawn(scene.images(), scene.fps)
        yield _known(f"{DRAWN}disc on {wall} wall, {ratio:g} times smaller", clip, centre[None], radius[None])
    for number, name in enumerate(SCENES):
        truth = render_clip(name, folder / f"{name}.mp4", size=(640, 480), duration_s=3.0, seed=SEED + number)
        rows = [truth.body(body) for body in truth.table["body"].unique()]
        free = [row["inside"] & (row["phase"] == "motion") for row in rows]
        xy_px = np.array([row[["x_px", "y_px"]] for row in rows])
        radius_px = np.where(free, [row["radius_px"] for row in rows], np.nan)
        yield _known(RENDERED + name, open_video(folder / f"{name}.mp4"), xy_px, radius_px)


def _known(name: str, video: FrameSource, xy_px: Array, radius_px: Array) -> Recording:
    return Recording(name, lambda: video, lambda: marks_of(xy_px, radius_px), len(xy_px))


def marks_of(xy_px: Array, radius_px: Array) -> pd.DataFrame:
    """Marks of bodies at (bodies, frames, 2) px with radii (bodies, frames) px.

    A position NaN is out of the image; a radius NaN is where the body is not free, which counts for nothing.
    """
    bodies, frames = radius_px.shape
    body, frame = (index.ravel() for index in np.indices((bodies, frames)))
    x, y = xy_px.reshape(-1, 2).T
    state = np.where(np.isfinite(x), np.where(np.isfinite(radius_px.ravel()), "free", "held"), "out")
    return pd.DataFrame(
        {"frame": frame, "body": body + 1, "x_px": x, "y_px": y, "radius_px": radius_px.ravel(), "state": state}
    )


def measured(recording: Recording) -> pd.DataFrame:
    """One row for each track of each candidate: the evidence, and the ``share`` of the marks that it meets."""
    candidates: list[TrackCandidate] = []
    options = TrackOptions(bodies=recording.bodies, explain=candidates.extend)
    video = recording.video()
    try:
        track(video, options=options)
    except IrisError:
        return pd.DataFrame()
    return rows_of(recording, candidates, video.width)


def rows_of(recording: Recording, candidates: Sequence[TrackCandidate], width: int) -> pd.DataFrame:
    """The rows of the tracks of some candidates; ``width`` of the image, px."""
    marks, rows = recording.marks(), []
    for candidate in candidates:
        for body, counts in compared(candidate.tracks, marks, width).items():
            asked = counts["free"] + counts["tracked_absent"]
            rows.append(
                {
                    "recording": recording.name,
                    "candidate": candidate.name,
                    "body": body,
                    "share": round(counts["on_body"] / asked, 4) if counts["free"] else 0.0,
                    "elsewhere": round((counts["elsewhere"] + counts["tracked_absent"]) / max(asked, 1), 4),
                    **{name: round(candidate.tracks[body].quality.evidence[name], 5) for name in WORDS},
                }
            )
    return pd.DataFrame(rows)


def fitted(rows: pd.DataFrame, ridge: float) -> tuple[float, Array]:
    """Intercept and weights (k,) of :func:`trackers._auto.verdict.probability_of` by penalised likelihood.

    Weights are not negative: ``sum_r c_r (mean_r (-log likelihood) + ridge |w|^2 / 2)`` over recordings is least, with
    ``c_r`` 1 for a real one and ``MADE_UP`` for one that was drawn or rendered.
    """
    x, y, shown, fixed = rows[list(NAMES)].to_numpy(), rows["share"].to_numpy(), on_body(rows), by_fixed(rows)
    made_up = rows["recording"].str.startswith((DRAWN, RENDERED)).to_numpy()
    each = np.where(made_up, MADE_UP, 1.0) / rows.groupby("recording")["share"].transform("size").to_numpy()
    penalty = ridge * each.sum()

    def loss(values: Array) -> tuple[float, Array]:
        same = expit(values[0] - x @ values[1:] - fixed)
        p = np.clip(shown * same, 1e-9, 1 - 1e-9)
        off = each * (p - y) * (1 - same) / (1 - p)
        value = -(each * (xlogy(y, p) + xlogy(1 - y, 1 - p))).sum() + penalty * (values[1:] ** 2).sum() / 2
        return float(value), np.concatenate([[off.sum()], -off @ x + penalty * values[1:]])

    start = np.concatenate([[2.0], np.ones(x.shape[1])])
    bounds = [(None, None), *[(0.0, None)] * x.shape[1]]
    result = minimize(loss, start, jac=True, method="L-BFGS-B", bounds=bounds, options={"maxiter": 2000})
    return float(result.x[0]), np.where(result.x[1:] < 1e-3, 0.0, result.x[1:])


def on_body(rows: pd.DataFrame) -> Array:
    """Share of the samples (n,) in which nothing shows that the track is off the body."""
    return np.asarray((1 - rows[list(OFF)]).prod(axis=1))


def by_fixed(rows: pd.DataFrame) -> Array:
    """What the evidence with a fixed weight takes from the log odds (n,)."""
    return np.asarray(rows[list(FIXED)] @ pd.Series(FIXED))


def left_out(rows: pd.DataFrame, ridge: float) -> Array:
    """The probability of each row from weights fitted to all other recordings."""
    said = np.empty(len(rows))
    for name in rows["recording"].unique():
        here = (rows["recording"] == name).to_numpy()
        intercept, weights = fitted(rows[~here], ridge)
        same = expit(intercept - rows.loc[here, list(NAMES)].to_numpy() @ weights - by_fixed(rows[here]))
        said[here] = on_body(rows[here]) * same
    return said


def log_loss(rows: pd.DataFrame, said: Array) -> pd.Series:
    """Cross entropy of shares and probabilities, the mean over the tracks of each real recording."""
    said, rows = said[rows.index.isin(real(rows).index)], real(rows)
    p, y = np.clip(said, 1e-9, 1 - 1e-9), rows["share"].to_numpy()
    entropy = pd.Series(-(xlogy(y, p) + xlogy(1 - y, 1 - p)), index=rows.index)
    return entropy.groupby(rows["recording"]).mean()


def ridge_of(losses: Mapping[float, pd.Series]) -> float:
    """The largest ridge whose loss is within one standard error of the smallest (Breiman et al. 1984, CART, 3.4.3).

    The standard error is that of the difference: the same recordings are left out with either ridge.
    """
    best = min(losses.values(), key=pd.Series.mean)
    return max(ridge for ridge, loss in losses.items() if (loss - best).mean() <= (loss - best).sem())


def chosen(rows: pd.DataFrame) -> pd.DataFrame:
    """The candidate of each recording whose least sure track has the highest probability ``said``, one row each.

    With its gaps filled where ``auto`` would take that.
    """
    tracks = rows.groupby(["recording", "candidate"], sort=False)
    by_candidate = tracks.agg({"said": "min", "share": "mean", "elsewhere": "mean"})
    said, taken = by_candidate["said"], []
    for name, way in said.groupby("recording", sort=False).idxmax():
        filled = (name, way + FILLED)
        is_taken = filled in said.index and no_worse_filled(said[name, way], said[filled])
        taken.append(filled if is_taken else (name, way))
    return by_candidate.loc[taken].reset_index()


def real(rows: pd.DataFrame) -> pd.DataFrame:
    """The rows of real recordings."""
    return rows[~rows["recording"].str.startswith((DRAWN, RENDERED))]


def report(rows: pd.DataFrame) -> Iterator[str]:
    """Tables of the weights that are fitted, and of recordings that were left out of the fit."""
    best = chosen(real(rows))
    followed, doubted = best["share"] >= MIN_ON_BODY, best["said"] < DOUBTFUL
    wrong = (best["elsewhere"] > MAX_ELSEWHERE) | (best["share"] == 0)
    yield f"Real recordings, each left out of the fit: {len(best)}; followed {followed.sum()}; "
    yield f"wrong and called good {(wrong & ~doubted).sum()} ({', '.join(best.loc[wrong & ~doubted, 'recording'])}); "
    yield f"followed and doubted {(followed & doubted).sum()} ({', '.join(best.loc[followed & doubted, 'recording'])})."
    yield ""
    yield "| said | tracks | said, mean | found, mean |\n|---|---:|---:|---:|"
    for low, high in pairwise(BINS):
        inside = real(rows)[real(rows)["said"].between(low, high, inclusive="both" if high == 1 else "left")]
        if len(inside):
            means = f"{inside['said'].mean():.2f} | {inside['share'].mean():.2f}"
            yield f"| {low:.1f} to {high:.1f} | {len(inside)} | {means} |"


def written(rows: pd.DataFrame, ridge: float) -> str:
    """The module of the weights."""
    intercept, weights = fitted(rows, ridge)
    kept = FIXED | {name: float(weight) for name, weight in zip(NAMES, weights, strict=True) if weight > 0}
    lines = [f'    "{name}": {weight:.3f},' for name, weight in sorted(kept.items(), key=lambda item: -item[1])]
    of_real = real(rows)
    return "\n".join(
        [
            '"""Weights of the evidence against a track, fitted by ``python -m validation.track_verdict --write``.',
            "",
            f"Fitted to {len(rows)} tracks of {rows['recording'].nunique()} recordings "
            f"({of_real['recording'].nunique()} real ones with {len(of_real)} tracks),",
            f"``validation/track_verdict.csv``, with a ridge of {ridge:g}. Not edited by hand.",
            '"""',
            "",
            f"INTERCEPT = {intercept:.3f}  # log odds of a track against which nothing speaks",
            f"DOUBTFUL = {DOUBTFUL}  # the program states a smaller probability with its reasons",
            f"SURE = {SURE}  # with this probability no other way is tried",
            "WEIGHTS = {  # what each evidence takes from the log odds",
            *lines,
            "}",
            "",
        ]
    )


def main(arguments: Sequence[str] | None = None) -> None:
    """Measure the evidence, or fit the weights to it."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--measure", action="store_true", help="follow all clips again; needs the recordings")
    parser.add_argument("--write", action="store_true", help="write the weights into the package")
    parser.add_argument("--only", default="", help="measure only recordings whose name contains this")
    pages.add_option(parser)
    options = parser.parse_args(arguments)
    if options.measure:
        warnings.simplefilter("ignore")
        with tempfile.TemporaryDirectory() as folder:
            for recording in recordings(Path(folder)):
                if options.only in recording.name:
                    keep(measured(recording), recording.name)
    rows = pd.read_csv(TABLE)
    losses = {ridge: log_loss(rows, left_out(rows, ridge)) for ridge in RIDGES}
    ridge = ridge_of(losses)
    with pages.table("track-verdict", options.write_docs):
        print(
            "Loss left out, by ridge:", ", ".join(f"{key:g}: {loss.mean():.3f}" for key, loss in losses.items()), "\n"
        )
        print("\n".join(report(rows.assign(said=left_out(rows, ridge)))))
    if options.write:
        WEIGHTS.write_text(written(rows, ridge), encoding="utf-8")


def keep(found: pd.DataFrame, name: str) -> None:
    """Put the rows of a recording into the table, in place of those that were there."""
    known = pd.read_csv(TABLE) if TABLE.exists() else pd.DataFrame({"recording": []})
    pd.concat([known[known["recording"] != name], found]).to_csv(TABLE, index=False)
    print(f"{name}: {len(found)} tracks", flush=True)


if __name__ == "__main__":
    main()

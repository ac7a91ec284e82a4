"""The fit of the probability that a track is on its body."""

import numpy as np
import pandas as pd
import pytest

from trackers._auto import verdict, verdict_weights
from validation import track_verdict as fit


def simulated(recordings=120, each=4, seed=1):
    """Tracks whose evidence says with known weights how likely they are on their bodies."""
    rng = np.random.default_rng(seed)
    n = recordings * each
    rows = pd.DataFrame(dict.fromkeys(verdict.WORDS, np.zeros(n)))
    rows["rival"], rows["kinks"], rows["missed"] = rng.uniform(0, 1, (3, n)) * [[1], [1], [0.3]]
    odds = 3.0 - 5.0 * rows["rival"] - 2.0 * rows["kinks"]
    rows["share"] = (1 - rows["missed"]) * (rng.uniform(size=n) < 1 / (1 + np.exp(-odds)))
    rows["recording"] = [f"clip {k // each}" for k in range(n)]
    rows["candidate"] = [f"way {k % each}" for k in range(n)]
    rows["elsewhere"] = 1 - rows["share"]
    return rows


def test_weights_of_simulated_tracks_are_found_again():
    intercept, weights = fit.fitted(simulated(), 1e-4)
    found = dict(zip(fit.NAMES, weights, strict=True))
    assert intercept == pytest.approx(3.0, abs=1.0)
    assert found["rival"] == pytest.approx(5.0, abs=1.2)
    assert found["kinks"] == pytest.approx(2.0, abs=1.2)
    assert max(weight for name, weight in found.items() if name not in ("rival", "kinks")) == 0.0


def test_what_is_said_of_recordings_left_out_is_found():
    rows = simulated(40)
    said = fit.left_out(rows, 1e-3)
    high = said > np.median(said)
    assert rows["share"][high].mean() == pytest.approx(said[high].mean(), abs=0.1)
    assert rows["share"][~high].mean() == pytest.approx(said[~high].mean(), abs=0.1)


def test_candidate_whose_least_sure_track_is_surest_is_chosen():
    rows = pd.DataFrame(
        [("a", "x", 0.9, 1.0), ("a", "x", 0.2, 0.0), ("a", "y", 0.6, 1.0), ("a", "y", 0.7, 1.0), ("b", "x", 0.1, 0.0)],
        columns=["recording", "candidate", "said", "share"],
    ).assign(elsewhere=0.0)
    assert fit.chosen(rows)[["recording", "candidate", "said"]].to_numpy().tolist() == [
        ["a", "y", 0.6],
        ["b", "x", 0.1],
    ]


def test_weights_in_the_package_are_those_of_the_table():
    rows = pd.read_csv(fit.TABLE)
    ridge = float(verdict_weights.__doc__.partition("ridge of ")[2].partition(". ")[0])
    known = {}
    exec(fit.written(rows, ridge), known)
    for name, weight in verdict_weights.WEIGHTS.items():
        assert known["WEIGHTS"][name] == pytest.approx(weight, abs=0.02)
    assert known["INTERCEPT"] == pytest.approx(verdict_weights.INTERCEPT, abs=0.02)

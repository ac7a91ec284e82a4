"""Weights of the evidence of each detector; written by ``python -m validation.detection_odds --write``."""

from __future__ import annotations

from collections.abc import Mapping

INTERCEPTS: Mapping[str, float] = {
    "appearance": 1.937,
    "disc": -6.729,
    "motion": 2.989,
}
WEIGHTS: Mapping[str, Mapping[str, float]] = {
    "appearance": {
        "likeness": 1.747,
        "beside": 0.514,
        "rank": -0.180,
        "smallness": -1.558,
    },
    "disc": {
        "still": -1.766,
        "contrast": 0.873,
        "smallness": 1.093,
    },
    "motion": {
        "elongation": -1.646,
        "contrast": 0.988,
        "softness": -0.537,
        "darker": 0.208,
        "held": -1.623,
        "smallness": -1.306,
    },
}

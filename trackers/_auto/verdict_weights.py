"""Weights of the evidence against a track, fitted by ``python -m validation.track_verdict --write``.

Fitted to 280 tracks of 62 recordings (38 real ones with 193 tracks),
``validation/track_verdict.csv``, with a ridge of 0.001. Not edited by hand.
"""

INTERCEPT = 3.938  # log odds of a track against which nothing speaks
DOUBTFUL = 0.8  # a smaller probability is said with the reasons
SURE = 0.9  # with this probability no other way is tried
WEIGHTS = {  # what each evidence takes from the log odds
    "beside": 3.678,
    "rival": 3.025,
    "disc not followed": 2.581,
    "nothing moves": 2.369,
    "held": 1.577,
    "ragged": 1.081,
    "scenery": 0.990,
    "guessed": 0.986,
    "faint": 0.849,
    "part": 0.831,
    "other colours": 0.714,
    "changing size": 0.532,
    "kinks": 0.530,
    "gaps": 0.421,
    "leaps": 0.236,
    "hardly moves": 0.207,
}

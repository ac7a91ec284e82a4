"""Weights of the evidence against a track, fitted by ``python -m validation.track_verdict --write``.

Fitted to 307 tracks of 66 recordings (42 real ones with 220 tracks),
``validation/track_verdict.csv``, with a ridge of 0.001. Not edited by hand.
"""

INTERCEPT = 3.927  # log odds of a track against which nothing speaks
DOUBTFUL = 0.9  # a smaller probability is said with the reasons
SURE = 0.9  # with this probability no other way is tried
WEIGHTS = {  # what each evidence takes from the log odds
    "two on one": 8.500,
    "beside": 3.651,
    "rival": 3.012,
    "lost together": 3.000,
    "nothing moves": 2.199,
    "disc not followed": 1.905,
    "held": 1.486,
    "alone": 1.401,
    "ragged": 1.204,
    "guessed": 1.128,
    "other colours": 1.114,
    "scenery": 1.061,
    "faint": 0.730,
    "kinks": 0.657,
    "gaps": 0.529,
    "changing size": 0.498,
    "leaps": 0.222,
    "hardly moves": 0.172,
}

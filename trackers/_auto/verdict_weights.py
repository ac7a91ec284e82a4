"""Weights of the evidence against a track, fitted by ``python -m validation.track_verdict --write``.

Fitted to 408 tracks of 73 recordings (49 real ones with 314 tracks),
``validation/track_verdict.csv``, with a ridge of 0.001. Not edited by hand.
"""

INTERCEPT = 4.262  # log odds of a track against which nothing speaks
DOUBTFUL = 0.85  # the program states a smaller probability with its reasons
SURE = 0.9  # with this probability no other way is tried
WEIGHTS = {  # what each evidence takes from the log odds
    "two on one": 8.500,
    "rival": 3.021,
    "lost together": 3.000,
    "beside": 2.845,
    "nothing moves": 2.608,
    "ragged": 2.172,
    "barely moves": 1.800,
    "disc not followed": 1.567,
    "guessed": 1.193,
    "scenery": 0.978,
    "at the edge": 0.687,
    "faint": 0.636,
    "kinks": 0.440,
    "held": 0.382,
}

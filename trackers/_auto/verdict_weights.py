"""Weights of the evidence against a track, fitted by ``python -m validation.track_verdict --write``.

Fitted to 352 tracks of 72 recordings (48 real ones with 264 tracks),
``validation/track_verdict.csv``, with a ridge of 0.003. Not edited by hand.
"""

INTERCEPT = 3.699  # log odds of a track against which nothing speaks
DOUBTFUL = 0.85  # the program states a smaller probability with its reasons
SURE = 0.9  # with this probability no other way is tried
WEIGHTS = {  # what each evidence takes from the log odds
    "two on one": 8.500,
    "beside": 3.139,
    "lost together": 3.000,
    "rival": 2.526,
    "nothing moves": 1.914,
    "disc not followed": 1.413,
    "guessed": 1.192,
    "scenery": 0.935,
    "ragged": 0.798,
    "faint": 0.601,
    "barely moves": 0.583,
    "held": 0.405,
    "kinks": 0.393,
    "at the edge": 0.027,
}

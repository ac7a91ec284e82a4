"""Weights of the evidence against a track, fitted by ``python -m validation.track_verdict --write``.

Fitted to 416 tracks of 73 recordings (49 real ones with 317 tracks),
``validation/track_verdict.csv``, with a ridge of 0.001. Not edited by hand.
"""

INTERCEPT = 4.288  # log odds of a track against which nothing speaks
DOUBTFUL = 0.85  # the program states a smaller probability with its reasons
SURE = 0.9  # with this probability no other way is tried
WEIGHTS = {  # what each evidence takes from the log odds
    "two on one": 8.500,
    "beside": 3.008,
    "lost together": 3.000,
    "rival": 2.700,
    "ragged": 2.499,
    "nothing moves": 2.054,
    "disc not followed": 1.837,
    "guessed": 1.345,
    "barely moves": 1.226,
    "scenery": 1.178,
    "at the edge": 0.682,
    "faint": 0.584,
    "kinks": 0.450,
    "held": 0.298,
}

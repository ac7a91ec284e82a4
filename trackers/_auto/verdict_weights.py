"""Weights of the evidence against a track, fitted by ``python -m validation.track_verdict --write``.

Fitted to 352 tracks of 72 recordings (48 real ones with 264 tracks),
``validation/track_verdict.csv``, with a ridge of 0.0003. Not edited by hand.
"""

INTERCEPT = 4.896  # log odds of a track against which nothing speaks
DOUBTFUL = 0.85  # the program states a smaller probability with its reasons
SURE = 0.9  # with this probability no other way is tried
WEIGHTS = {  # what each evidence takes from the log odds
    "two on one": 8.500,
    "beside": 4.334,
    "disc not followed": 3.255,
    "lost together": 3.000,
    "rival": 2.833,
    "nothing moves": 2.450,
    "scenery": 2.203,
    "guessed": 1.789,
    "ragged": 1.778,
    "held": 1.354,
    "barely moves": 1.016,
    "changing size": 0.899,
    "kinks": 0.827,
    "leaps": 0.743,
    "shadow": 0.012,
}

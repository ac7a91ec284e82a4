"""Weights of the evidence against a track, fitted by ``python -m validation.track_verdict --write``.

Fitted to 307 tracks of 66 recordings (42 real ones with 220 tracks),
``validation/track_verdict.csv``, with a ridge of 0.001. Not edited by hand.
"""

INTERCEPT = 4.208  # log odds of a track against which nothing speaks
DOUBTFUL = 0.85  # the program states a smaller probability with its reasons
SURE = 0.9  # with this probability no other way is tried
WEIGHTS = {  # what each evidence takes from the log odds
    "two on one": 8.500,
    "beside": 3.943,
    "rival": 3.167,
    "lost together": 3.000,
    "nothing moves": 2.278,
    "disc not followed": 2.050,
    "alone": 1.365,
    "guessed": 1.303,
    "ragged": 1.291,
    "held": 0.938,
    "scenery": 0.934,
    "faint": 0.470,
    "kinks": 0.426,
    "gaps": 0.307,
    "barely moves": 0.237,
    "changing size": 0.228,
    "leaps": 0.173,
    "at the edge": 0.085,
}

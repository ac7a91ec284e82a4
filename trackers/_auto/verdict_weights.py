"""Weights of the evidence against a track, fitted by ``python -m validation.track_verdict --write``.

Fitted to 408 tracks of 72 recordings (48 real ones with 309 tracks),
``validation/track_verdict.csv``, with a ridge of 0.003. Not edited by hand.
"""

INTERCEPT = 3.910  # log odds of a track against which nothing speaks
DOUBTFUL = 0.85  # the program states a smaller probability with its reasons
SURE = 0.9  # with this probability no other way is tried
WEIGHTS = {  # what each evidence takes from the log odds
    "two on one": 8.500,
    "lost together": 3.000,
    "beside": 2.618,
    "rival": 2.447,
    "ragged": 1.642,
    "nothing moves": 1.414,
    "disc not followed": 1.226,
    "size changes": 1.073,
    "guessed": 1.061,
    "barely moves": 0.915,
    "faint": 0.631,
    "scenery": 0.605,
    "at the edge": 0.493,
    "kinks": 0.388,
    "held": 0.189,
}

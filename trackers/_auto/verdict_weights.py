"""Weights of the evidence against a track, fitted by ``python -m validation.track_verdict --write``.

Fitted to 353 tracks of 72 recordings (48 real ones with 266 tracks),
``validation/track_verdict.csv``, with a ridge of 0.003. Not edited by hand.
"""

INTERCEPT = 3.805  # log odds of a track against which nothing speaks
DOUBTFUL = 0.85  # the program states a smaller probability with its reasons
SURE = 0.9  # with this probability no other way is tried
WEIGHTS = {  # what each evidence takes from the log odds
    "two on one": 8.500,
    "lost together": 3.000,
    "beside": 2.928,
    "rival": 2.338,
    "ragged": 1.720,
    "nothing moves": 1.408,
    "guessed": 1.175,
    "disc not followed": 1.047,
    "faint": 0.978,
    "barely moves": 0.800,
    "scenery": 0.702,
    "at the edge": 0.483,
    "kinks": 0.350,
    "held": 0.249,
}

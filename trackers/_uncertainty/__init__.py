"""Standard errors of tracks: noise correlated in space and time."""

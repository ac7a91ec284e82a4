"""Standard errors of tracks: noise that is correlated in space and time."""

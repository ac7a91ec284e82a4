"""A force of unknown form on a fitted motion: its estimate with an error band, and the simple form that it has."""

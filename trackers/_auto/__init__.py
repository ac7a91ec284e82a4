"""Choice of the tracker: what a clip shows, how far a track can be trusted, and bodies followed by appearance."""

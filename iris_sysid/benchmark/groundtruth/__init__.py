"""Ground truth from the clips of a data set: each measured once, then pooled over the trials of a setting."""

"""Working images of the trackers: region of interest, reduced size, with or without colour."""

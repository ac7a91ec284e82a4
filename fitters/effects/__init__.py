"""Effects that a governing equation may be missing, one a file."""

"""The phenomena of the benchmark, one a file: how a track becomes what its model observes."""

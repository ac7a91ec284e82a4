"""The phenomena of the benchmark, one per file: how a track becomes the observable of its model."""

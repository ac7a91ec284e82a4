"""Studies of measured clips, each a function from a clip to rows of the benchmark."""

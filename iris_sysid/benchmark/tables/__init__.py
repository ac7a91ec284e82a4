"""Tables and pages of the benchmark, made from its rows alone."""

"""The audit of the published benchmark: each printed number derived again from the result files."""

"""Rows of the benchmark from every source: published result files, latent runs, predictions, null baselines."""

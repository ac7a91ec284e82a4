"""Measurement noise: its size, its autocorrelation, and the covariance of estimates under it."""

"""Trajectories: segment the motion, smooth it, and form the observable that a model predicts."""

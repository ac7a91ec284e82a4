"""Parameters of a differential equation estimated from trajectories."""

from fitters.ode.single_clip import fit, sensitivity, simulate

__all__ = ["fit", "sensitivity", "simulate"]

"""Parameters of a differential equation estimated from trajectories."""

from fitters.ode.request import FitOptions, FitRequest
from fitters.ode.simulation import sensitivity, simulate
from fitters.ode.single_clip import fit, solve, with_rest

__all__ = ["FitOptions", "FitRequest", "fit", "sensitivity", "simulate", "solve", "with_rest"]

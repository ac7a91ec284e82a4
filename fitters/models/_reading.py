"""What is read of the states of a model: positions in a plane, in the scale of the image, or from another zero."""

from __future__ import annotations

from iris_sysid.types import Array, Quantity

PLANE = (Quantity("x", "m", "x"), Quantity("z", "m", "z"))  # x to the right, z upwards
PLANE_STATES = (*PLANE, Quantity("vx", "m/s", "v_x"), Quantity("vz", "m/s", "v_z"))


def magnified(count: int, index: int, t_s: Array, states: Array, params: Array) -> Array:
    """The first states as the scale shows them: times the magnification, which is 1 by definition of the scale.

    Parameters
    ----------
    count, index
        How many states are observed, and the place of the magnification among the parameters.
    t_s
        (n,) s.
    states
        (n, s); what is observed is (n, count), both in the units that the model declares.
    params
        (p,).
    """
    return states[:, :count] * params[index]


def shifted(count: int, index: int, t_s: Array, states: Array, params: Array) -> Array:
    """The first states as counted from another place than the zero of the equation.

    Parameters
    ----------
    count, index
        How many states are observed, and the place of the first of as many zeros among the parameters.
    t_s
        (n,) s.
    states, params
        (n, s) and (p,), as for :func:`magnified`.
    """
    return states[:, :count] + params[index : index + count]

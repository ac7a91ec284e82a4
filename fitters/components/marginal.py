"""Fitted values and their errors where the components of the residual act as well: what the data leave of a value.

The fitted values p and the coefficients w of the components are estimated together, w with the prior variances that
were likeliest for the residual; the covariance of p is that of the joint posterior, w integrated out.
"""

from __future__ import annotations

import numpy as np

from fitters.components.layout import ClipResidual
from fitters.components.noisy_residual import white_noise_series
from fitters.components.split import searched
from iris_sysid.types import Array


def marginal(clip: ClipResidual) -> tuple[Array, Array] | None:
    """By how much the fitted values would move (p,), and their covariance (p, p), beside the likeliest components.

    None where the residual has no component.

    Parameters
    ----------
    clip
        The residual of one fit.
    """
    found = searched([clip])
    if not found.search.top():
        return None
    variances = found.search.variances(found.search.top())
    residual, columns = found.layout.clips[0].residual, variances.columns
    parts = (residual.jacobian, found.layout.responses[0][:, :, columns])
    scaled = [part / residual.noise[:, :, None] for part in parts]
    jacobian, responses = (white_noise_series(each, residual.t_s, found.rho) for each in scaled)
    values = white_noise_series((residual.values / residual.noise)[:, :, None], residual.t_s, found.rho)[:, 0]
    size = np.maximum(np.linalg.norm(jacobian, axis=0), 1e-300)
    design = np.concatenate([jacobian / size, responses], axis=1)
    information = design.T @ design
    count = size.size
    information[count:, count:] += np.diag(1.0 / np.maximum(variances.prior, 1e-300))
    inverse = np.linalg.pinv(information, rcond=1e-12)
    shift = (inverse @ (design.T @ values))[:count] / size
    return shift, variances.noise * inverse[:count, :count] / np.outer(size, size)

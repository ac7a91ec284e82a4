"""Coefficients of the method of order 8 of Dormand and Prince, those of SciPy's ``DOP853``.

Hairer, Norsett and Wanner (1993), Solving Ordinary Differential Equations I, section II.5.
"""

import numpy as np
from scipy.integrate import DOP853

STAGES = 12
NODES = np.array(DOP853.C)  # times of the stages, in steps

# (stage, earlier stage): weight of its slope; row 12 gives the step itself
WEIGHTS = np.vstack((DOP853.A, DOP853.B))

# Weights of the slopes, that at the end of the step last, in the errors of order 5 and of order 3 (section II.10).
ERROR_5 = np.array(DOP853.E5)
ERROR_3 = np.array(DOP853.E3)

# The continuous extension of order 7 (section II.6): three more stages after the slope at the end of the step, then
# rows of weights of all slopes, the coefficients of its polynomial from the fourth on.
EXTENDED = 16
EXTENSION_NODES = np.array(DOP853.C_EXTRA)
EXTENSION = np.array(DOP853.A_EXTRA)
POLYNOMIAL = np.array(DOP853.D)

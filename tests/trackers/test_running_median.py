"""Running medians: those of SciPy's filter."""

import numpy as np
import pytest
from scipy.ndimage import median_filter

from trackers._uncertainty.running_median import running_median


@pytest.mark.parametrize(("beyond", "mode"), [("reflect", "mirror"), ("edge", "nearest")])
@pytest.mark.parametrize("count", [1, 3, 9, 15, 16, 40])
def test_running_median_is_that_of_scipy(count, beyond, mode):
    values = np.random.default_rng(count).normal(size=count)
    for size in (5, 31):
        assert np.array_equal(running_median(values, size, beyond), median_filter(values, size, mode=mode))

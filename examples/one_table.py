"""From a table of angles, with uneven times and a gap, to a pendulum's length and the effect that its equation lacks.

Any CSV with the columns ``t_s`` and ``<quantity>_<unit>`` can be fitted and diagnosed, from any source.
Run it: python examples/one_table.py
"""

import tempfile
from pathlib import Path

import numpy as np
import pandas as pd
from scipy.integrate import solve_ivp

from iris_sysid import diagnose, diagnosis_sentence, estimates_frame, fit, read_trajectory


def write_measured_angles(path: Path) -> None:
    """Make a table as a lab would: a pendulum of 0.40 m whose air drag grows with the square of the speed."""
    rng = np.random.default_rng(4)
    t_s = np.sort(rng.uniform(0.0, 12.0, 700))

    def slopes(_: float, state: tuple[float, float]) -> tuple[float, float]:
        theta, omega = state
        return omega, -0.02 * omega - 0.15 * abs(omega) * omega - 9.80665 / 0.40 * np.sin(theta)

    motion = solve_ivp(slopes, (0.0, 12.0), (0.9, 0.0), t_eval=t_s, rtol=1e-9, atol=1e-9)
    theta_rad = motion.y[0] + rng.normal(0.0, 0.003, t_s.size)
    theta_rad[300:320] = np.nan
    pd.DataFrame({"t_s": t_s, "theta_rad": theta_rad}).to_csv(path, index=False)


def main() -> None:
    """Fit, then diagnose."""
    with tempfile.TemporaryDirectory() as folder:
        table = Path(folder) / "angles.csv"
        write_measured_angles(table)
        trajectory = read_trajectory(table)

    result = fit(trajectory, "pendulum")
    print(estimates_frame(result)[["value", "stderr", "unit"]])
    print(result.verdict.text)
    print(diagnosis_sentence(diagnose(trajectory, "pendulum")))


if __name__ == "__main__":
    main()

"""The paper's identifiability table for synthetic clips: gradient norms, ODE residual R, condition numbers.

``python -m validation.identifiability`` fits one synthetic trajectory a row (nothing is rendered; the noise is the
tracker's) and prints the norm of the gradient at the first, middle and last iteration, R of the equation from sample to
sample and the R of the noise alone, and the condition numbers of the Fisher information and of the Hessian. The
paper's loss is in latent units, ours in units of the noise, by relative values: compare slopes and
floors, not sizes.
"""

from __future__ import annotations

import argparse
from dataclasses import dataclass

import numpy as np

from fitters.ode import fit
from fitters.ode.identifiability import identifiability
from iris_sysid.registry import MODELS
from iris_sysid.synthetic.plan import plan_clip
from iris_sysid.types import Trajectory
from validation import pages

MAX_DURATION_S = 8.0
COUPLED = "coupled-pendulums"  # settings of the paper; the clips have impacts, which R shows


@dataclass(frozen=True, slots=True)
class Row:
    """One row: a scene and its setting, the model, the columns of the truth it observes, their noise."""

    scene: str
    setting: str
    model: str
    column: str
    noise: float
    published: str


# Noise: 0.05 px of a centre at 1920 px image width, over the radius of the arc for angles.
ROWS = (
    Row("pendulum", "pendulum_45", "pendulum", "theta_rad", 1e-4, "G 2.4e-2 8.1e-3 1.2e-4, R 0.83e-3"),
    Row("rotating-cone", "mid", "angular-oscillator", "phi_rad", 1e-4, "G 1.8e-2 5.3e-3 9.7e-5, R 0.41e-3"),
    Row("sliding-cone", "cone_60", "incline", "s_m", 5e-5, "G 3.1e-2 1.4e-4 2.0e-6, R 0.02e-3"),
    Row("dropping-ball", "drop_100", "free-fall", "height_m", 5e-5, "G 1.5e-2 4.7e-3 3.8e-4, R 1.92e-3"),
    Row("two-moving-pendulums", "pendulum_45", COUPLED, "theta_rad", 1e-4, "G 3.8e-2 2.1e-2 7.4e-3, R 12.6e-3"),
    Row(
        "two-moving-pendulum-one-static", "pendulum_45", COUPLED, "theta_rad", 1e-4, "G 4.2e-2 1.9e-2 5.1e-3, R 9.83e-3"
    ),
)


def trajectory_of(row: Row, seed: int = 0) -> Trajectory:
    """The observable from the let-go to the first event of the clip, or to its end for several bodies."""
    plan = plan_clip(row.scene, setting=row.setting, seed=seed, duration_s=MAX_DURATION_S)
    table = plan.truth.table
    bodies = [part for _, part in table.groupby("body", sort=False)]
    t_s = bodies[0]["t_s"].to_numpy(copy=True)
    started = (bodies[0]["phase"] != "hand").to_numpy()
    first = plan.truth.events[0][0] if plan.truth.events and len(bodies) == 1 else np.inf
    used = started & (t_s < first)
    seen = np.column_stack([part[row.column].to_numpy()[used] for part in bodies])
    seen = seen + row.noise * np.random.default_rng(seed).standard_normal(seen.shape)
    quantities = MODELS[row.model].observed
    return Trajectory(t_s[used], quantities, seen, np.full_like(seen, np.nan), np.ones(int(used.sum()), bool))


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    pages.add_option(parser)
    options = parser.parse_args()
    with pages.table("identifiability", options.write_docs):
        print_table()


def print_table() -> None:
    """Print a row for each clip, with the combination of values that is least determined."""
    columns = ("phenomenon", "setting", "G first", "G middle", "G last", "R", "R of the noise", "condition (Fisher)")
    columns += ("condition (Hessian)", "least determined", "status", "paper (latent units)")
    print(f"| {' | '.join(columns)} |\n{'|---' * len(columns)}|")
    for row in ROWS:
        clip = trajectory_of(row)
        result = fit(clip, MODELS[row.model])
        identified = identifiability(result, clip)
        path = identified.gradients
        steps = [path[0], path[len(path) // 2], path[-1]]
        numbers = [*steps, *(np.sum(residual) for residual in (identified.ode_residual, identified.ode_residual_noise))]
        numbers += [identified.condition, identified.hessian_condition]
        text = " | ".join(f"{number:.2e}" for number in numbers)
        weak = "; ".join(filter(None, [*identified.undetermined, identified.weakest]))
        print(f"| {row.scene} | {row.setting} | {text} | {weak} | {result.status} | {row.published} |", flush=True)


if __name__ == "__main__":
    main()

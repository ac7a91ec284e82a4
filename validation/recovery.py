"""Recovery of the parameters of all settings from synthetic trajectories, compared with the best latent error."""

from __future__ import annotations

import argparse
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from fitters.models.contact_chain import contact_chain
from fitters.ode import fit
from iris_sysid.errors import IrisError
from iris_sysid.registry import MODELS, PHENOMENA
from iris_sysid.synthetic import SCENES
from iris_sysid.synthetic.plan import plan_clip
from iris_sysid.synthetic.truth import Truth
from iris_sysid.types import FitResult, OdeModel, Quantity, Segment, Trajectory
from tests._experiments import EXPERIMENTS, NOISE, clip
from validation import pages
from validation.audit.printed import all_values

SIZE = (3840, 2160)  # the benchmark's clips
NOISE_PX = 0.1  # of a tracked centre; rendered clips of any size give 0.03 to 0.1
GREY_LEVELS = 255.0
NOISE_GREY = 0.3  # of a lamp's mean brightness over its disc
ERRORS = ("one-step", "multi-step", "baseline", "corrected", "per-clip", "multi-clip")  # columns that hold errors
CHAIN_COUPLING = 2.0  # 1/s^2: the cups with the benchmark's own spring in place of impacts


@dataclass(frozen=True)
class Clip:
    """One trajectory to fit: its model, the known parameters, and the truth by our names."""

    trajectory: Trajectory
    model: OdeModel
    truth: Mapping[str, float]
    fixed: Mapping[str, float] = field(default_factory=dict)
    free: tuple[str, ...] = ()


Make = Callable[[Truth, np.random.Generator], Clip]


def bodies(truth: Truth, rng: np.random.Generator, names: str = "1", until: str = "motion") -> list[Trajectory]:
    """World trajectories with a tracker's noise, cut where the motion ends."""
    sigma, world = NOISE_PX / truth.pixels_per_metre, []
    for name in names:
        body = truth.body(name)
        moving = np.flatnonzero(body.phase.isin(["motion"] if until == "motion" else ["motion", "contact", "rest"]))
        impacts = [t for t, _ in truth.events]
        stop = len(body) if until != "motion" or not impacts else int(np.searchsorted(body.t_s, impacts[0]))
        position = body[["x_m", "z_m"]].to_numpy() + sigma * rng.standard_normal((len(body), 2))
        segments = (Segment("hand", 0, int(moving[0])), Segment("motion", int(moving[0]), stop))
        quantities = (Quantity("x", "m"), Quantity("z", "m"))
        valid = np.ones(len(body), dtype=bool)
        spread = np.full(position.shape, sigma)
        world.append(Trajectory(body.t_s.to_numpy(), quantities, position, spread, valid, segments=segments))
    return world


def column(truth: Truth, name: str, observed: Quantity, sigma: float, rng: np.random.Generator) -> Trajectory:
    """One column of the truth with noise, from the release to the first impact."""
    body = truth.body()
    stop = int(np.searchsorted(body.t_s, truth.events[0][0])) if truth.events else len(body)
    part = body.iloc[: max(stop, 1)].query("phase != 'hand'")
    values = part[name].to_numpy()[:, None] + sigma * rng.standard_normal((len(part), 1))
    return Trajectory(
        part.t_s.to_numpy(), (observed,), values, np.full_like(values, sigma), np.ones(len(part), dtype=bool)
    )


def through_phenomenon(name: str, parameters: Mapping[str, str], names: str = "1", until: str = "motion") -> Make:
    """Observe as the phenomenon does, and fit its model; ``parameters`` maps our names to the scene's."""

    def make(truth: Truth, rng: np.random.Generator) -> Clip:
        chosen = PHENOMENA[name]
        trajectory = chosen.observe(bodies(truth, rng, names, until), {})
        exact = {ours: truth.exact(theirs).value for ours, theirs in parameters.items()}
        return Clip(trajectory, MODELS[chosen.model], exact, free=chosen.free)

    return make


def rotating(truth: Truth, rng: np.random.Generator) -> Clip:
    """The angle of the arm, from the position of its cup."""
    model = MODELS["angular-oscillator"]
    sigma = NOISE_PX / truth.pixels_per_metre / truth.parameters["arm_length"].value
    exact = {name: truth.exact(name).value for name in ("stiffness", "damping")}
    return Clip(column(truth, "phi_rad", model.observed[0], sigma, rng), model, exact)


def falling(truth: Truth, rng: np.random.Generator) -> Clip:
    """The apparent radius; the ball's radius times the focal length is known, which determines gravity."""
    model = MODELS["apparent-radius"]
    known = truth.parameters["ball_radius"].value * float(truth.camera["focal_px"][0])
    trajectory = column(truth, "radius_px", model.observed[0], NOISE_PX, rng)
    return Clip(trajectory, model, {"gravity": truth.exact("gravity").value}, {"r0_f": known}, ("gravity",))


def lamp(truth: Truth, rng: np.random.Generator) -> Clip:
    """The brightness of the lamp."""
    model = MODELS["exponential-decay"]
    exact = {"decay_rate": truth.exact("decay_rate").value}
    return Clip(column(truth, "intensity_1", model.observed[0], NOISE_GREY / GREY_LEVELS, rng), model, exact)


def tank(truth: Truth, rng: np.random.Generator) -> Clip:
    """The level of the water."""
    model = MODELS["torricelli"]
    sigma = NOISE_PX / truth.pixels_per_metre
    return Clip(column(truth, "h_m", model.observed[0], sigma, rng), model, {"outflow": truth.exact("outflow").value})


def chain(truth: Truth, rng: np.random.Generator) -> Clip:
    """Ball and cups under the benchmark's continuous coupling, all sixteen."""
    count = truth.table["body"].nunique()
    model, columns = contact_chain(count), []
    for name in range(1, count + 1):
        body = truth.body(str(name)).query("phase != 'hand'")
        columns.append(body["displacement_m"].to_numpy())
    values = np.column_stack(columns)
    sigma = NOISE_PX / truth.pixels_per_metre
    values = values + sigma * rng.standard_normal(values.shape)
    valid = np.ones(len(values), dtype=bool)
    trajectory = Trajectory(body.t_s.to_numpy(), model.observed, values, np.full_like(values, sigma), valid)
    return Clip(trajectory, model, {name: truth.exact(name).value for name in ("coupling", "damping")})


PAIR = {name: name for name in ("length_1", "length_2", "damping_1", "damping_2", "restitution")}
ROWS: Mapping[str, Make] = {
    "pendulum": through_phenomenon("pendulum", {"length": "length", "damping": "damping"}),
    "dropping-ball": through_phenomenon("dropping-ball", {"gravity": "gravity"}),
    "falling-ball": falling,
    "sliding-cone": through_phenomenon("sliding-cone", {"angle": "angle", "friction": "friction"}),
    "rotating-cone": rotating,
    "two-moving-pendulums": through_phenomenon("two-moving-pendulums", PAIR, "12", "end"),
    "two-moving-pendulum-one-static": through_phenomenon("two-moving-pendulum-one-static", PAIR, "12", "end"),
    "hitting-cones": chain,
    "led": lamp,
    "torricelli": tank,
}
DURATION_S = {"pendulum": 20.0, "two-moving-pendulum-one-static": 8.0, "hitting-cones": 3.0, "torricelli": 15.0}


def errors_of(scene: str, setting: str, seeds: Sequence[int]) -> tuple[dict[str, float], dict[str, list[float]]]:
    """Truth of each parameter, and its errors over the trials of one setting."""
    truths: dict[str, float] = {}
    errors: dict[str, list[float]] = {}
    overrides = {"contact": 0.0, "coupling": CHAIN_COUPLING} if scene == "hitting-cones" else {}
    for seed in seeds:
        plan = plan_clip(
            scene, setting=setting, size=SIZE, duration_s=DURATION_S.get(scene), seed=seed, overrides=overrides
        )
        clip = ROWS[scene](plan.truth, np.random.default_rng(seed))
        result = fit(clip.trajectory, clip.model, fixed=clip.fixed, free=clip.free)
        values = {**clip.trajectory.geometry, **result.estimates}
        truths = dict(clip.truth)
        for name, true in truths.items():
            errors.setdefault(name, []).append(values[name].value - true)
    return truths, errors


def best_latent(folder: str, setting: str, parameter: str) -> float:
    """Smallest error that the paper's tables give for this row, NaN where they have none."""
    plain = parameter.rstrip("12").rstrip("_")
    errors = []
    for value in all_values():
        same = value.phenomenon.lower() == folder.lower() and value.setting == setting
        if same and value.parameter in (plain, parameter) and value.column in ERRORS:
            errors.append(_number(value.printed))
    return min(filter(np.isfinite, errors), default=np.nan)


def _number(text: str) -> float:
    try:
        return float(text)
    except ValueError:
        return np.nan


def table_row(scene: str, setting: str, seeds: Sequence[int]) -> list[str]:
    """Fit the trials of one setting and format a line for each parameter."""
    folder = SCENES[scene].folder
    try:
        truths, errors = errors_of(scene, setting, seeds)
    except IrisError as error:
        return [f"| {scene} | {setting} | failed: {error} | | | | |"]
    lines = []
    for name, true in truths.items():
        size = float(np.median(np.abs(errors[name])))
        latent = best_latent(folder, setting, name)
        latent *= np.pi / 180 if name == "angle" else 1.0
        times = f"{latent / size:.0f}" if latent > 0 else "-"
        shown = f"{latent:.3g}" if np.isfinite(latent) else "-"
        lines.append(
            f"| {scene} | {setting} | {name} | {true:.6g} | {100 * size / abs(true):.4f} | {shown} | {times} |"
        )
    return lines


def one_unknown_scale() -> str:
    """Gravity of the falling ball in a fit that knows neither its size nor its height."""
    plan = plan_clip("falling-ball", setting="mid", size=SIZE)
    clip = falling(plan.truth, np.random.default_rng(0))
    result = fit(clip.trajectory, clip.model, free=("gravity",))
    return f"falling ball, nothing known: status {result.status}"


def finds_the_truth(result: FitResult, truth: Mapping[str, float], rms: np.ndarray) -> bool:
    """Whether a fit ended in the global minimum: its residual is the noise."""
    del truth
    return bool(np.all(np.isfinite(result.rms)) and np.all(np.abs(result.rms / rms - 1) < 0.3))


def from_starts_half_off(name: str, count: int) -> int:
    """Number of fits of one model that end in the global minimum, from starts 50 % off in every value."""
    model, (values, t_s) = MODELS[name], EXPERIMENTS[name]
    size = NOISE * np.std(clip(model, 0.0).position, axis=0)
    recovered = 0
    for seed in range(count):
        rng = np.random.default_rng(seed)
        trajectory = clip(model, size * rng.standard_normal((t_s.size, size.size)))
        start = {key: value * rng.choice([0.5, 1.5]) for key, value in values.items()}
        recovered += finds_the_truth(fit(trajectory, model, start=start), values, size)
    return recovered


def main() -> None:
    """Print the tables as Markdown."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--trials", type=int, default=10, help="clips of each setting")
    parser.add_argument("--starts", type=int, default=100, help="starts 50 %% off for each model; 0 for none")
    parser.add_argument("--scenes", nargs="*", default=list(ROWS), help="names of scenes")
    pages.add_option(parser)
    arguments = parser.parse_args()
    with pages.table("recovery", arguments.write_docs):
        print(f"Median error of {arguments.trials} trials, {SIZE[0]} x {SIZE[1]}, {NOISE_PX} px noise")
        print("| scene | setting | parameter | truth | median error / % | best latent error | times smaller |")
        print("|---|---|---|---|---|---|---|")
        for scene in arguments.scenes:
            for setting in SCENES[scene].settings:
                print("\n".join(table_row(scene, setting, range(arguments.trials))), flush=True)
        print(f"\n{one_unknown_scale()}")
        if arguments.starts:
            print("\n| model | global minimum found, starts 50 % off |\n|---|---|")
            for name in EXPERIMENTS:
                print(f"| {name} | {from_starts_half_off(name, arguments.starts)} of {arguments.starts} |", flush=True)


if __name__ == "__main__":
    np.seterr(all="ignore")
    main()

"""Discovery of the equation itself: exact structure, errors and degradation beside pysindy; real recordings; speed.

``python -m validation.discovery`` prints the tables of ``docs/discovery.md``; ``--part`` chooses one, ``--seeds`` how
many random motions each row has, ``--curve-seeds`` each point of a curve, ``--picture`` where the curves are drawn.
"""

from __future__ import annotations

import argparse
import time
import warnings
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pysindy
from threadpoolctl import threadpool_limits

from fitters.ode import simulate
from fitters.sindy import discover
from fitters.sindy.library import Library, evaluated, library_of, value_of
from iris_sysid.errors import IrisError
from iris_sysid.registry import MODELS
from iris_sysid.report.text import discovery_sentence
from iris_sysid.types import Discovery, Quantity, Trajectory
from tests import _real_data as real
from validation import pages

PX_PER_M = 500.0  # a 4K frame of about 8 m, or 720p of 2.5 m
ARM_M = 0.5  # from pivot to bob: 0.2 px are 0.8 mrad
NOISE_PX = 0.2


@dataclass(frozen=True)
class Motion:
    """One model with a range for each value, the terms it has, and how it is filmed."""

    model: str
    values: dict[str, tuple[float, float]]
    terms: tuple[str, ...]
    duration_s: float
    fps: float = 60.0
    noise: float = NOISE_PX / PX_PER_M  # unit of the observable, at NOISE_PX


ANGLE = NOISE_PX / PX_PER_M / ARM_M
RADIUS_PX = 0.05  # scatter of the disc tracker's radius in flight on synthetic clips at 960x540: 0.02 to 0.06 px
MOTIONS = (
    Motion(
        "pendulum",
        {"length": (0.3, 1.0), "damping": (0.02, 0.2), "theta_0": (0.6, 1.4), "omega_0": (-0.5, 0.5)},
        ("theta_sin", "theta_rate"),
        10.0,
        noise=ANGLE,
    ),
    Motion(
        "linear-pendulum",
        {"length": (0.3, 1.0), "damping": (0.02, 0.2), "theta_0": (0.6, 1.4), "omega_0": (-0.5, 0.5)},
        ("theta_linear", "theta_rate"),
        10.0,
        noise=ANGLE,
    ),
    Motion(
        "angular-oscillator",
        {"stiffness": (10, 40), "damping": (0.05, 0.5), "phi_0": (0.5, 1.2), "omega_0": (-1, 1)},
        ("phi_linear", "phi_rate"),
        10.0,
        noise=ANGLE,
    ),
    Motion(
        "linear-oscillator",
        {"stiffness": (10, 40), "damping": (0.05, 0.5), "z_0": (0.1, 0.3), "vz_0": (-0.3, 0.3)},
        ("z_linear", "z_rate"),
        10.0,
    ),
    Motion("free-fall", {"gravity": (9.7, 9.9), "z_0": (1.8, 2.2), "vz_0": (-0.3, 0.3)}, ("z_constant",), 0.6),
    Motion(
        "projectile",
        {"gravity": (9.7, 9.9), "x_0": (-1, 0), "z_0": (0.5, 1), "vx_0": (1, 2), "vz_0": (2, 4)},
        ("z_constant",),
        0.8,
    ),
    Motion("incline", {"acceleration": (1, 4), "s_0": (0, 0.1), "v_0": (0, 0.2)}, ("s_constant",), 0.8),
    Motion(
        "apparent-radius",
        {"r0_f": (60, 120), "h_0": (0.8, 1.2), "v_0": (0, 0.5)},  # gravity is known: only r0_f / gravity shows
        ("r_constant",),
        0.6,
        noise=RADIUS_PX,
    ),
    Motion(
        "exponential-decay", {"decay_rate": (0.3, 2), "intensity_0": (80, 200)}, ("intensity_linear",), 5.0, noise=0.5
    ),
    Motion("torricelli", {"outflow": (0.01, 0.03), "h_0": (0.2, 0.4)}, ("h_root",), 20.0, fps=30.0),
    Motion(
        "coupled-pendulums",
        {
            "length_1": (0.4, 0.6),
            "length_2": (0.4, 0.6),
            "damping_1": (0.1, 0.3),
            "damping_2": (0.1, 0.3),
            "coupling": (2, 6),
            "theta1_0": (0.7, 1.2),
            "theta2_0": (-0.6, 0.3),
            "omega1_0": (-1, 1),
            "omega2_0": (-1, 1),
        },
        ("theta1_sin", "theta1_rate", "theta1_to_theta2", "theta2_sin", "theta2_rate", "theta2_to_theta1"),
        10.0,
        noise=ANGLE,
    ),
    Motion(
        "coupled-oscillators",
        {
            "stiffness_1": (5, 20),
            "stiffness_2": (5, 20),
            "damping_1": (0.1, 0.3),
            "damping_2": (0.1, 0.3),
            "coupling_1": (10, 40),
            "coupling_2": (10, 40),
            "z1_0": (-0.1, 0.1),
            "z2_0": (0.2, 0.3),
            "v1_0": (-0.3, 0.3),
            "v2_0": (-0.3, 0.3),
        },
        ("z1_linear", "z1_rate", "z1_to_z2", "z2_linear", "z2_rate", "z2_to_z1"),
        10.0,
    ),
    # At rest at the start all bodies would move in step, and which pulls at which could not be told.
    Motion(
        "contact-chain",
        {
            "coupling": (5, 15),
            "damping": (0.3, 0.8),
            "z1_0": (-0.4, -0.2),
            "z2_0": (-0.1, 0.1),
            "z3_0": (0.3, 0.5),
            "v1_0": (0.5, 1.0),
            "v2_0": (-1.5, -1.0),
            "v3_0": (0.8, 1.5),
        },
        tuple(f"z{a}_{b}" for a in (1, 2, 3) for b in ("rate", *(f"to_z{c}" for c in (1, 2, 3) if c != a))),
        6.0,
    ),
)


def drawn(motion: Motion, seed: int, *, noise: float = 1.0, fps: float | None = None, length: float = 1.0):
    """A random motion with white noise, and its true values.

    Parameters
    ----------
    motion
        What moves.
    seed
        Of the values and the noise.
    noise, length
        Relative to those of the motion.
    fps
        Frame rate in 1/s; the motion's own when not given.
    """
    rng = np.random.default_rng([seed, len(motion.model)])
    values = {name: float(rng.uniform(*limits)) for name, limits in motion.values.items()}
    model, rate = MODELS[motion.model], fps or motion.fps
    t_s = np.arange(max(int(motion.duration_s * length * rate), 2)) / rate
    exact = simulate(model, t_s, values).observed
    seen = exact + noise * motion.noise * rng.standard_normal(exact.shape)
    return Trajectory(t_s, model.observed, seen, np.full_like(seen, np.nan), np.ones(t_s.size, bool)), values


# --------------------------------------------------------------------------- ours and pysindy's


def ours(trajectory: Trajectory) -> tuple[set[str], Discovery | None]:
    """Parameters of the terms that discovery selects, and the discovery; nothing where it states that it cannot."""
    try:
        found = discover(trajectory, resampled=20)
    except IrisError:
        return set(), None
    return {term.parameter for term in found.selected}, found


def plain_states(trajectory: Trajectory, library: Library) -> tuple[np.ndarray, np.ndarray]:
    """Values and rates (n, d) as one would make them: as measured, and by finite differences."""
    values = np.column_stack([value_of(v, trajectory.position[:, k]) for k, v in enumerate(library.variables)])
    return values, np.gradient(values, trajectory.t_s, axis=0)


def with_our_library(trajectory: Trajectory, optimizer: Callable[[], object]) -> set[str]:
    """Terms that an optimizer of pysindy finds among ours, with pysindy's own finite difference."""
    library = library_of(trajectory.quantities)
    values, rates = plain_states(trajectory, library)
    left = rates
    if library.variables[0].order == 2:
        left = np.asarray(pysindy.FiniteDifference()._differentiate(rates, trajectory.t_s))
    terms, found = evaluated(library, values, rates, None), set()
    for equation in range(len(library.variables)):
        own = library.of_equation(equation)
        fitted = optimizer()
        fitted.fit(terms[:, own], left[:, [equation]])
        found |= {library.names[k] for k, c in zip(own, np.ravel(fitted.coef_), strict=True) if c != 0}
    return found


def defaults(trajectory: Trajectory) -> set[str]:
    """Terms of ``pysindy.SINDy()`` as it is: quadratic polynomials of values and rates, written in our names."""
    library = library_of(trajectory.quantities)
    values, rates = plain_states(trajectory, library)
    second = library.variables[0].order == 2
    names = [v.quantity.name for v in library.variables]
    model = pysindy.SINDy()
    features = [*names, *(f"v_{name}" for name in names)] if second else names
    model.fit(np.hstack([values, rates]) if second else values, t=trajectory.t_s, feature_names=features)
    coefficients, found = model.coefficients()[-len(names) :], set()
    for name, row in zip(names, coefficients, strict=True):
        spelled = {
            "1": f"{name}_constant",
            name: f"{name}_linear",
            f"v_{name}": f"{name}_rate",
            f"{name}^2": f"{name}_square",
        }
        found |= {spelled.get(f, f"{name}: {f}") for f, c in zip(model.get_feature_names(), row, strict=True) if c != 0}
    return found


def ensemble() -> pysindy.EnsembleOptimizer:
    """Bagging of pysindy's default optimizer, 20 models, the median coefficient."""
    return pysindy.EnsembleOptimizer(pysindy.STLSQ(), bagging=True, n_models=20)


METHODS: dict[str, Callable[[Trajectory], set[str]]] = {
    "defaults": defaults,
    "defaults, our library": lambda motion: with_our_library(motion, pysindy.STLSQ),
    "ensemble, our library": lambda motion: with_our_library(motion, ensemble),
}


def quietly(method: Callable[[Trajectory], set[str]], trajectory: Trajectory) -> set[str]:
    """What a method finds; nothing where it fails."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        try:
            return method(trajectory)
        except (ValueError, np.linalg.LinAlgError):
            return {"failed"}


# --------------------------------------------------------------------------- tables


def worst_error(found: Discovery | None, values: dict[str, float]) -> float:
    """Largest relative error of the matched model's parameters."""
    if found is None or found.matched is None:
        return np.nan
    made = found.matched.parameters
    errors = [
        abs(made[n].value / v - 1) for n, v in values.items() if n in made and made[n].measurement_type == "fitted"
    ]
    return max(errors) if errors else np.nan


def print_structure(motions: Sequence[Motion], seeds: int, others_seeds: int) -> None:
    """Print how often each method finds exactly the right terms; pysindy's on the first ``others_seeds`` motions."""
    print("| model | samples | exact, ours | matched | worst parameter within 1 % | median worst error | CPU s | "
          + " | ".join(METHODS) + " |")  # fmt: skip
    print("|---|---" + "|---" * (5 + len(METHODS)) + "|")
    for motion in motions:
        exact, matched, errors, spent, others = 0, 0, [], [], dict.fromkeys(METHODS, 0)
        for seed in range(seeds):
            trajectory, values = drawn(motion, seed)
            began = time.process_time()
            terms, found = ours(trajectory)
            spent.append(time.process_time() - began)
            exact += terms == set(motion.terms)
            right = found is not None and found.matched is not None
            matched += right and motion.model in (found.matched.model, *found.matched.same)
            errors.append(worst_error(found, fitted_values(values)))
            np.random.seed(seed)  # noqa: NPY002 - EnsembleOptimizer knows no other
            for name, method in METHODS.items() if seed < others_seeds else ():
                others[name] += quietly(method, trajectory) == set(motion.terms)
        known = np.array([error for error in errors if np.isfinite(error)])
        row = [motion.model, trajectory.n, f"{exact}/{seeds}", f"{matched}/{seeds}",
               f"{np.sum(known < 0.01)}/{seeds}", f"{100 * np.median(known):.3f} %" if known.size else "-",
               f"{np.median(spent):.2f}", *(f"{n}/{min(seeds, others_seeds)}" for n in others.values())]  # fmt: skip
        print("| " + " | ".join(map(str, row)) + " |", flush=True)


def fitted_values(values: dict[str, float]) -> dict[str, float]:
    """The parameters among the values, without initial states."""
    return {name: value for name, value in values.items() if not name.endswith("_0")}


SWEEPS = {
    "noise (px)": ((0.01, 0.03, 0.1, 0.3, 1.0, 3.0, 10.0, 30.0), lambda x: {"noise": x / NOISE_PX}),
    "frame rate (1/s)": ((10, 15, 30, 60, 120, 240), lambda x: {"fps": x}),
    "length (s)": ((0.5, 1, 2, 5, 10, 20, 40), lambda x: {"length": x / 10.0}),
}


def degradation(motion: Motion, sweep: str, seeds: int) -> tuple[dict[str, list[float]], list[float]]:
    """Share of exact structures of each method at each point of a sweep, and the median worst error of ours."""
    points, change = SWEEPS[sweep]
    shares: dict[str, list[float]] = {name: [] for name in ("ours", *METHODS)}
    errors = []
    for point in points:
        hits, off = dict.fromkeys(shares, 0), []
        for seed in range(seeds):
            trajectory, values = drawn(motion, seed, **change(point))
            terms, found = ours(trajectory)
            hits["ours"] += terms == set(motion.terms)
            off.append(worst_error(found, fitted_values(values)))
            np.random.seed(seed)  # noqa: NPY002 - EnsembleOptimizer knows no other
            for name, method in METHODS.items():
                hits[name] += quietly(method, trajectory) == set(motion.terms)
        for name, hit in hits.items():
            shares[name].append(hit / seeds)
        errors.append(float(np.median(np.nan_to_num(off, nan=np.inf))))
    return shares, errors


def print_degradation(motions: Sequence[Motion], seeds: int, picture: Path | None, write_docs: bool) -> None:
    """Print the shares, and draw them; ``write_docs`` writes a table of the docs for each model and sweep."""
    curves: dict[str, dict[str, dict[str, list[float]]]] = {}
    for motion in motions:
        curves[motion.model] = {}
        for sweep, (points, _) in SWEEPS.items():
            with pages.table(f"discovery-{motion.model.rpartition('-')[2]}-{sweep_name(sweep)}", write_docs):
                shares, errors = degradation(motion, sweep, seeds)
                curves[motion.model][sweep] = shares
                print(f"\n| {motion.model}, {sweep} | " + " | ".join(f"{p:g}" for p in points) + " |")
                print("|---" * (len(points) + 1) + "|")
                for name, values in shares.items():
                    print(f"| {name} | " + " | ".join(f"{100 * v:.0f} %" for v in values) + " |")
                print(
                    "| ours, worst parameter off by | "
                    + " | ".join(f"{100 * v:.2g} %" if np.isfinite(v) else "-" for v in errors)
                    + " |",
                    flush=True,
                )
    if picture is not None:
        draw_degradation(curves, picture)


def sweep_name(sweep: str) -> str:
    """One word for a sweep, as the tables of the docs are named: noise, rate or length."""
    return sweep.partition(" (")[0].split()[-1]


def draw_degradation(curves: dict[str, dict[str, dict[str, list[float]]]], picture: Path) -> None:
    """Draw one row a model, one column a sweep."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(10, 3.0 * len(curves)), layout="constrained")
    rows = figure.subplots(len(curves), len(SWEEPS), squeeze=False, sharey=True)
    colours = ("#000000", "#D55E00", "#E69F00", "#0072B2")
    for axes, (model, sweeps) in zip(rows, curves.items(), strict=True):
        for place, (sweep, shares) in zip(axes, sweeps.items(), strict=True):
            for colour, (name, values) in zip(colours, shares.items(), strict=True):
                style = "-o" if name == "ours" else "--s"
                place.plot(SWEEPS[sweep][0], 100 * np.array(values), style, color=colour, markersize=4, label=name)
            place.set(xscale="log", xlabel=sweep, ylim=(-4, 104))
        axes[0].set_ylabel(f"{model}\nexact structure (%)")
    rows[0][0].legend(fontsize=7, loc="center left")
    figure.savefig(picture, dpi=110)


def double_linear() -> Trajectory:
    """Positions of two oscillators on an air track that pull at one another, in mm in the file."""
    path = real.recording("schmidt_lipson") / "real_double_linear_h_1.txt"
    _, t_s, first_mm, second_mm, *_ = np.loadtxt(path, comments="%").T
    places = np.column_stack([first_mm, second_mm]) / 1000
    return real.trajectory_of(t_s, places, Quantity("z1", "m"), Quantity("z2", "m"))


RECORDINGS: dict[str, Callable[[], Trajectory]] = {
    "schmidt_lipson real_linear": real.schmidt_lipson_linear,
    "schmidt_lipson real_double_linear": double_linear,
    "wooden_bob": real.wooden_bob,
    "alexiev length_68": real.alexiev_length_68,
}


def print_real(names: Sequence[str]) -> None:
    """Print what is found in measured files."""
    for name in names:
        began = time.process_time()
        found = discover(RECORDINGS[name]())
        print(f"\n{name} ({found.fits[0].n} samples, {time.process_time() - began:.1f} s CPU; {found.status})")
        for equation in found.equations:
            print(f"    {equation.lhs} = {equation.rhs}")
        for term in found.selected:
            print(f"    {term.term:>20} {term.coefficient.value:12.5g} +- {term.coefficient.stderr:.2g}"
                  f"  inclusion {term.inclusion:.2f}")  # fmt: skip
        print(f"    {discovery_sentence(found)}", flush=True)


def print_speed() -> None:
    """Print the time for 150 s at 60 frames a second."""
    trajectory, _ = drawn(MOTIONS[0], 0, length=15.0)
    for text in ("first, with compilation", "again"):
        began, cpu = time.perf_counter(), time.process_time()
        discover(trajectory)
        wall, spent = time.perf_counter() - began, time.process_time() - cpu
        print(
            f"{trajectory.n} samples, {text}: {spent:.2f} s CPU, {wall:.2f} s wall; {10 / spent:.1f} times under 10 s"
        )


def main() -> None:
    """Print the tables."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--part", choices=("structure", "degradation", "real", "speed"), action="append")
    parser.add_argument("--model", action="append", help="only this model; may be repeated")
    parser.add_argument("--seeds", type=int, default=50)
    parser.add_argument("--curve-seeds", type=int, default=10, help="motions at each point of a degradation curve")
    parser.add_argument("--others-seeds", type=int, default=10, help="how many of them pysindy's own methods see")
    parser.add_argument("--picture", type=Path, help="PNG file for the degradation curves")
    pages.add_option(parser)
    options = parser.parse_args()
    parts = options.part or ["structure", "degradation", "real", "speed"]
    motions = [motion for motion in MOTIONS if not options.model or motion.model in options.model]
    with threadpool_limits(limits=1):
        if "structure" in parts:
            with pages.table("discovery-structure", options.write_docs):
                print_structure(motions, options.seeds, options.others_seeds)
        if "degradation" in parts:
            wanted = options.model or ("pendulum", "linear-oscillator")
            chosen = [motion for motion in motions if motion.model in wanted]
            print_degradation(chosen, options.curve_seeds, options.picture, options.write_docs)
        if "real" in parts:
            with pages.table("discovery-real", options.write_docs):
                print_real(list(RECORDINGS))
        if "speed" in parts:
            print_speed()


if __name__ == "__main__":
    main()

"""Discovery of the equation: exact structure, errors and degradation compared with pysindy; real recordings; speed.

``python -m validation.discovery`` prints the tables of ``docs/discovery.md``; ``--part`` chooses one, ``--seeds`` the
number of random motions in each row, ``--curve-seeds`` at each point of a curve, ``--picture`` the file of the curves.
"""

from __future__ import annotations

import argparse
import itertools
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
from iris_sysid.types import Discovery, OdeModel, Quantity, Trajectory
from tests import _real_data as real
from validation import pages

PX_PER_M = 500.0  # a 4K frame of about 8 m, or 720p of 2.5 m
ARM_M = 0.5  # from pivot to bob: 0.2 px are 0.8 mrad
NOISE_PX = 0.2


@dataclass(frozen=True)
class Motion:
    """A model with a range for each value, the terms of its equation, and how it is filmed."""

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
    # If all bodies started at rest, they would move in step, and the data would not show which pulls at which.
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
        The model, the ranges of its values, and how it is filmed.
    seed
        Seed of the values and of the noise.
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
    """Parameters of the terms that discovery selects, and the discovery; an empty set and None where it refuses."""
    try:
        discovery = discover(trajectory, resampled=20)
    except IrisError:
        return set(), None
    return {term.parameter for term in discovery.selected}, discovery


def plain_states(trajectory: Trajectory, library: Library) -> tuple[np.ndarray, np.ndarray]:
    """Values and rates (n, d) without smoothing: as measured, and by finite differences."""
    values = np.column_stack([value_of(v, trajectory.position[:, k]) for k, v in enumerate(library.variables)])
    return values, np.gradient(values, trajectory.t_s, axis=0)


def with_our_library(trajectory: Trajectory, optimizer: Callable[[], object]) -> set[str]:
    """Terms that an optimizer of pysindy finds among ours, with pysindy's own finite difference."""
    library = library_of(trajectory.quantities)
    values, rates = plain_states(trajectory, library)
    target = rates
    if library.variables[0].order == 2:
        target = np.asarray(pysindy.FiniteDifference()._differentiate(rates, trajectory.t_s))
    terms, selected = evaluated(library, values, rates, None), set()
    for equation in range(len(library.variables)):
        own = library.of_equation(equation)
        fitted = optimizer()
        fitted.fit(terms[:, own], target[:, [equation]])
        selected |= {library.names[k] for k, c in zip(own, np.ravel(fitted.coef_), strict=True) if c != 0}
    return selected


def defaults(trajectory: Trajectory) -> set[str]:
    """Terms of ``pysindy.SINDy()`` with its defaults: quadratic polynomials of values and rates, in our names."""
    library = library_of(trajectory.quantities)
    values, rates = plain_states(trajectory, library)
    second = library.variables[0].order == 2
    names = [v.quantity.name for v in library.variables]
    model = pysindy.SINDy()
    features = [*names, *(f"v_{name}" for name in names)] if second else names
    model.fit(np.hstack([values, rates]) if second else values, t=trajectory.t_s, feature_names=features)
    coefficients, terms = model.coefficients()[-len(names) :], set()
    for name, row in zip(names, coefficients, strict=True):
        spelled = {
            "1": f"{name}_constant",
            name: f"{name}_linear",
            f"v_{name}": f"{name}_rate",
            f"{name}^2": f"{name}_square",
        }
        terms |= {spelled.get(f, f"{name}: {f}") for f, c in zip(model.get_feature_names(), row, strict=True) if c != 0}
    return terms


def ensemble() -> pysindy.EnsembleOptimizer:
    """Bagging of pysindy's default optimizer, 20 models, the median coefficient."""
    return pysindy.EnsembleOptimizer(pysindy.STLSQ(), bagging=True, n_models=20)


WINDOWS = (7, 11, 21, 41, 81)  # samples of pysindy's smoothing, of those that a clip has three times over
THRESHOLDS = np.geomspace(0.003, 0.5, 16)  # of coefficients of columns of unit size


def tuned(trajectory: Trajectory, window: int, thresholds: Sequence[float]) -> list[set[str]]:
    """Terms that STLSQ finds among ours at each threshold, with smoothed derivatives and columns of unit size."""
    library = library_of(trajectory.quantities)
    derivative = pysindy.SmoothedFiniteDifference(smoother_kws={"window_length": window})
    raw = plain_states(trajectory, library)[0]
    rates = np.asarray(derivative(raw, trajectory.t_s))
    values = np.asarray(derivative.smoothed_x_)
    second = library.variables[0].order == 2
    target = np.asarray(derivative(rates, trajectory.t_s)) if second else rates
    inside = slice(window, len(values) - window)  # derivatives at the ends are unreliable
    terms, found = evaluated(library, values, rates, None)[inside], [set[str]() for _ in thresholds]
    for equation in range(len(library.variables)):
        own = library.of_equation(equation)
        columns, wanted = terms[:, own], target[inside, equation]
        columns = columns / np.linalg.norm(columns, axis=0)
        wanted = wanted / np.linalg.norm(wanted)
        for k, threshold in enumerate(thresholds):
            coefficients = np.ravel(pysindy.STLSQ(threshold=threshold, alpha=0.0).fit(columns, wanted[:, None]).coef_)
            found[k] |= {library.names[i] for i, c in zip(own, coefficients, strict=True) if c != 0}
    return found


def print_tuned(motions: Sequence[Motion], seeds: int) -> None:
    """Print how often pysindy finds exactly the right terms at the window and threshold best for each model.

    Both are chosen with the truth known, on the motions themselves: an upper bound.
    """
    print("| model | tuned pysindy | window | threshold |\n|---|---|---|---|")
    for motion in motions:
        trajectories = [drawn(motion, seed)[0] for seed in range(seeds)]
        windows = [window for window in WINDOWS if trajectories[0].n > 3 * window]
        hits = np.zeros((len(windows), len(THRESHOLDS)), dtype=int)
        for (row, window), trajectory in itertools.product(enumerate(windows), trajectories):
            with warnings.catch_warnings():
                warnings.simplefilter("ignore")
                made = tuned(trajectory, window, THRESHOLDS.tolist())
            hits[row] += [terms == set(motion.terms) for terms in made]
        row, k = np.unravel_index(int(np.argmax(hits)), hits.shape)
        print(f"| {motion.model} | {hits[row, k]}/{seeds} | {windows[row]} | {THRESHOLDS[k]:.2g} |", flush=True)


METHODS: dict[str, Callable[[Trajectory], set[str]]] = {
    "defaults": defaults,
    "defaults, our library": lambda motion: with_our_library(motion, pysindy.STLSQ),
    "ensemble, our library": lambda motion: with_our_library(motion, ensemble),
}


def quietly(method: Callable[[Trajectory], set[str]], trajectory: Trajectory) -> set[str]:
    """Terms that a method finds; ``{"failed"}`` where it fails."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        try:
            return method(trajectory)
        except (ValueError, np.linalg.LinAlgError):
            return {"failed"}


# --------------------------------------------------------------------------- tables


def worst_error(discovery: Discovery | None, values: dict[str, float]) -> float:
    """Largest relative error of the matched model's parameters."""
    if discovery is None or discovery.matched is None:
        return np.nan
    made = discovery.matched.parameters
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
            terms, discovery = ours(trajectory)
            spent.append(time.process_time() - began)
            exact += terms == set(motion.terms)
            right = discovery is not None and discovery.matched is not None
            matched += right and motion.model in (discovery.matched.model, *discovery.matched.same)
            errors.append(worst_error(discovery, fitted_values(MODELS[motion.model], values)))
            np.random.seed(seed)  # noqa: NPY002 - EnsembleOptimizer knows no other
            for name, method in METHODS.items() if seed < others_seeds else ():
                others[name] += quietly(method, trajectory) == set(motion.terms)
        finite = np.array([error for error in errors if np.isfinite(error)])
        row = [motion.model, trajectory.n, f"{exact}/{seeds}", f"{matched}/{seeds}",
               f"{np.sum(finite < 0.01)}/{seeds}", f"{100 * np.median(finite):.3f} %" if finite.size else "-",
               f"{np.median(spent):.2f}", *(f"{n}/{min(seeds, others_seeds)}" for n in others.values())]  # fmt: skip
        print("| " + " | ".join(map(str, row)) + " |", flush=True)


def fitted_values(model: OdeModel, values: dict[str, float]) -> dict[str, float]:
    """The values that are parameters of the model: all but its initial states."""
    return {name: value for name, value in values.items() if name not in model.initial_names}


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
            terms, discovery = ours(trajectory)
            hits["ours"] += terms == set(motion.terms)
            off.append(worst_error(discovery, fitted_values(MODELS[motion.model], values)))
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
        for panel, (sweep, shares) in zip(axes, sweeps.items(), strict=True):
            for colour, (name, values) in zip(colours, shares.items(), strict=True):
                style = "-o" if name == "ours" else "--s"
                panel.plot(SWEEPS[sweep][0], 100 * np.array(values), style, color=colour, markersize=4, label=name)
            panel.set(xscale="log", xlabel=sweep, ylim=(-4, 104))
        axes[0].set_ylabel(f"{model}\nexact structure (%)")
    rows[0][0].legend(fontsize=7, loc="center left")
    figure.savefig(picture, dpi=110)


def double_linear() -> Trajectory:
    """Positions of two coupled oscillators on an air track; the file holds mm."""
    path = real.recording("schmidt_lipson") / "real_double_linear_h_1.txt"
    _, t_s, first_mm, second_mm, *_ = np.loadtxt(path, comments="%").T
    position = np.column_stack([first_mm, second_mm]) / 1000
    return real.trajectory_of(t_s, position, Quantity("z1", "m"), Quantity("z2", "m"))


RECORDINGS: dict[str, Callable[[], Trajectory]] = {
    "schmidt_lipson real_linear": real.schmidt_lipson_linear,
    "schmidt_lipson real_double_linear": double_linear,
    "wooden_bob": real.wooden_bob,
    "alexiev length_68": real.alexiev_length_68,
}


def print_real(names: Sequence[str]) -> None:
    """Print the equations and terms that discovery finds in real recordings."""
    for name in names:
        began = time.process_time()
        discovery = discover(RECORDINGS[name]())
        print(f"\n{name} ({discovery.fits[0].n} samples, {time.process_time() - began:.1f} s CPU; {discovery.status})")
        for equation in discovery.equations:
            print(f"    {equation.lhs} = {equation.rhs}")
        for term in discovery.selected:
            print(f"    {term.term:>20} {term.coefficient.value:12.5g} +- {term.coefficient.stderr:.2g}"
                  f"  inclusion {term.inclusion:.2f}")  # fmt: skip
        print(f"    {discovery_sentence(discovery)}", flush=True)


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
    parser.add_argument("--part", choices=("structure", "tuned", "degradation", "real", "speed"), action="append")
    parser.add_argument("--model", action="append", help="only this model; may be repeated")
    parser.add_argument("--seeds", type=int, default=50)
    parser.add_argument("--curve-seeds", type=int, default=10, help="motions at each point of a degradation curve")
    parser.add_argument("--others-seeds", type=int, default=10, help="how many of them pysindy's own methods see")
    parser.add_argument("--picture", type=Path, help="PNG file for the degradation curves")
    pages.add_option(parser)
    options = parser.parse_args()
    parts = options.part or ["structure", "tuned", "degradation", "real", "speed"]
    motions = [motion for motion in MOTIONS if not options.model or motion.model in options.model]
    with threadpool_limits(limits=1):
        if "structure" in parts:
            with pages.table("discovery-structure", options.write_docs):
                print_structure(motions, options.seeds, options.others_seeds)
        if "tuned" in parts:
            with pages.table("discovery-tuned", options.write_docs):
                print_tuned(motions, options.others_seeds)
        if "degradation" in parts:
            names = options.model or ("pendulum", "linear-oscillator")
            chosen = [motion for motion in motions if motion.model in names]
            print_degradation(chosen, options.curve_seeds, options.picture, options.write_docs)
        if "real" in parts:
            with pages.table("discovery-real", options.write_docs):
                print_real(list(RECORDINGS))
        if "speed" in parts:
            print_speed()


if __name__ == "__main__":
    main()

"""Driven rigs that others measured and identified: what a diagnosis names of them, beside the values they published.

``python -m validation.driven [--only emps] [--sealed] [--seconds 300]`` needs the recordings in ``../shared/data``. The
model of each rig has a known input and viscous friction; dry friction and an offset of the force are for the diagnosis
to find, and in one row the viscous friction as well. Each row gives the values found, those published, and the error of
a free simulation of the record by both, and by a linear model of the same order that was fitted to it. A second row has
the terms of the authors, dry friction and an offset, in weak form, with the errors of its blocks: what the record says
of these terms. The record of an arm ends where it first comes near its upper rest. Some of the arms are sealed by a
hash of the name (:func:`validation.world_recordings.sealed`): they are scored with ``--sealed``. The linear drive was
in view; all arms have been since :mod:`validation.driven_arm`.

What bounds the dry friction of the linear drive, 20.65 ± 0.19 N (weak form, errors of blocks) against 20.39: the speed
within which it turns over at standstill, which the record does not tell. 1 %, 0.1 % and 0.01 % of the largest speed
give 20.65, 20.14 and 20.01 N with viscous 201.9, 207.0 and 208.4 N s/m; windows half as long again, a line between
voltages and a free run (at 0.1 %) give 20.72, 20.46 and 20.39 N, a free delay of the voltage is 0 ± 0.03 ms, and
friction that weakens with the speed doubles the squares. Beside viscous friction that differs by direction, -36 ± 1.6
N s/m, nothing is left of the offset: 0.28 ± 0.16 N.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np

from fitters.ode import FitRequest
from fitters.ode.fit_problem import check_columns
from fitters.ode.weak_fit import weak_fit
from iris_sysid import (
    EFFECTS,
    MODELS,
    FitOptions,
    FitResult,
    OdeModel,
    Quantity,
    Trajectory,
    diagnose,
    fit,
    model_from_equation,
    smooth,
    validate_fit,
    with_effects,
)
from iris_sysid.types import Array, Estimate
from validation.pages import add_option, table
from validation.world_recordings import sealed
from validation.world_tables import WORLD, WORLD2, columns

NAMED = ("coulomb-friction", "constant-force")  # what the published values are sizes of
MOTOR_N_PER_V = 35.15
SIZES = {  # what is published, the size of an effect per inertia, and its sign there
    "damping": ("linear_drag", 1.0),
    "dry": ("coulomb_friction", 1.0),
    "offset": ("constant_force", -1.0),
    "directional damping": ("directional_drag", 1.0),
}
ARM_FOLDER = WORLD / "tab-torque-pendulum"
UPRIGHT_RAD = 0.2  # of the upper rest, in which an arm is held by dry friction or pushed by hand


@dataclass(frozen=True, slots=True)
class Rig:
    """A recording, its model, and what its authors give: inertia, viscous and dry friction, constant force.

    ``named`` are the effects of its model in :mod:`validation.driven_benchmarks`.
    """

    name: str
    model: OdeModel
    read: Callable[[], Trajectory]
    published: Mapping[str, float]
    fixed: Mapping[str, float]
    in_view: bool = False
    named: tuple[str, ...] = NAMED

    @property
    def sealed(self) -> bool:
        """Whether it may not be looked at while the programs are written."""
        return not self.in_view and sealed(self.name)

    @property
    def inertia(self) -> str:
        """Name of the parameter by which forces are divided."""
        return self.model.parameters[0].name


def linear_drive() -> Trajectory:
    """Position (m) and voltage of a linear drive at 1 kHz, as they were recorded."""
    table = np.loadtxt(WORLD2 / "tab-emps" / "emps.csv", delimiter=",")
    return record(np.arange(len(table)) * 1e-3, table[:, 0], Quantity("q", "m"), table[:, 3], Quantity("u", "V"))


def arm(path: str, first: int) -> Trajectory:
    """Angle by the motor's encoder (rad) and the torque (N m); ``first`` is the column of the time."""
    rows = columns(ARM_FOLDER / path)
    later = np.concatenate([[True], np.diff(np.maximum.accumulate(rows[:, first])) > 0])
    t_s, angle, _, torque = rows[later, first : first + 4].T
    return record(t_s, angle, Quantity("theta", "rad"), torque, Quantity("u", "N m"))


def swing_up(clip: Trajectory) -> Trajectory:
    """An arm that begins hanging, until it first comes near its upper rest; one that begins there, whole."""
    upright = np.cos(clip.position[:, 0]) < -np.cos(UPRIGHT_RAD)
    return rows(clip, slice(0, int(np.argmax(upright)) or None))


def rows(clip: Trajectory, part: slice) -> Trajectory:
    """Some samples of a record of one held input and one output."""
    assert clip.inputs is not None
    output, given = clip.quantities[0], clip.input_quantities[0]
    return record(clip.t_s[part], clip.position[part, 0], output, clip.inputs[part, 0], given)


def record(t_s: Array, values: Array, quantity: Quantity, inputs: Array, given: Quantity) -> Trajectory:
    """A record of one held input and one output."""
    unknown, valid = np.full((t_s.size, 1), np.nan), np.isfinite(values)
    more = {"sensor": "encoder", "hold": "zero-order"}
    return Trajectory(t_s, (quantity,), values[:, None], unknown, valid, (given,), inputs[:, None], **more)


# The authors' dry friction is 0.1839 atan(100 theta'), which tends to pi/2 times that.
ARM_PUBLISHED = {"inertia": 0.06259, "moment": 0.1022, "damping": 0.04707, "dry": 0.1839 * np.pi / 2, "offset": -0.0759}
ARMS = {
    "arm-collocation": ("results__control_method_direct_collocation__data_measured.csv", 0),
    "arm-energy-shaping": ("results__control_method_energy_shaping__data_measured.csv", 0),
    "arm-energy-shaping-1kg": ("data_measured_1kg.csv", 0),
    "arm-frequency-sweep": ("measured_data.csv", 1),
    "arm-pd": ("control_method_pd__system_identification__data_measured.csv", 0),
    "arm-sac": ("results__control_method_sac__data_measured.csv", 0),
}
RIGS = [
    Rig(
        "emps",
        MODELS["driven-cart"],
        linear_drive,
        {"mass": 95.1089, "damping": 203.5034, "dry": 20.3935, "offset": -3.1648},
        {"gain": MOTOR_N_PER_V},
        in_view=True,
        named=("coulomb-friction", "directional-drag"),
    ),
    Rig(
        "emps-without-friction",
        model_from_equation(f"q'' = {MOTOR_N_PER_V}*u/mass", units={"q": "m", "u": "V", "mass": "kg"}),
        linear_drive,
        {"mass": 95.1089, "damping": 203.5034, "dry": 20.3935, "offset": -3.1648},
        {},
        in_view=True,
    ),
    *(
        Rig(name, MODELS["driven-pendulum"], lambda where=where: swing_up(arm(*where)), ARM_PUBLISHED, {})
        for name, where in ARMS.items()
    ),
]


def published_fit(rig: Rig, clip: Trajectory) -> float:
    """Error (rms) of a free simulation with the published values; only the initial state is fitted."""
    values, viscous = dict(rig.published), "damping" not in rig.model.units()
    model = with_effects(rig.model, (*NAMED, "linear-drag") if viscous else NAMED)
    dry, offset = values.pop("dry"), values.pop("offset")
    sizes = {"coulomb_friction": dry / values[rig.inertia], "constant_force": -offset / values[rig.inertia]}
    if viscous:
        sizes["linear_drag"] = values.pop("damping") / values[rig.inertia]
    known = {**rig.fixed, **values, **sizes, "coulomb_turnover": dry_turnover(clip)}
    return float(fit(clip, model, fixed=known, options=FitOptions(discrepancy=False)).rms[0])


def dry_turnover(clip: Trajectory) -> float:
    """The speed within which a diagnosis takes dry friction to turn over: 1 % of the largest."""
    trials = EFFECTS["coulomb-friction"].trials
    assert trials is not None
    return float(next(iter(trials(clip.t_s, clip.position)))[0])


def found_values(rig: Rig, fitted: FitResult) -> dict[str, tuple[float, float]]:
    """The values found in the units of those published, each with its standard error."""
    estimates = fitted.estimates
    found = {name: (estimates[name].value, estimates[name].stderr) for name in rig.published if name in estimates}
    by = estimates[rig.inertia].value
    for name, (size, sign) in SIZES.items():
        if size in estimates:
            found[name] = (sign * by * estimates[size].value, by * estimates[size].stderr)
    return found


def authors_terms(rig: Rig, clip: Trajectory) -> FitResult:
    """The rig with dry friction and an offset: values of the weak form with block errors, a free run from them."""
    model = with_effects(rig.model, NAMED)
    fixed = {**rig.fixed, "coulomb_turnover": dry_turnover(clip)}
    weak = weak_fit(FitRequest(smooth(clip), model, fixed))
    if weak is None:
        raise ValueError(f"{rig.name}: the weak form does not apply")
    units = model.units()
    known = {name: Estimate(weak.values[name], stderr, units[name]) for name, stderr in weak.stderr.items()}
    return fit(clip, model, fixed={**fixed, **known}, options=FitOptions(discrepancy=False))


def line(rig: Rig, seconds: float | None) -> str:
    """The rows of a rig."""
    clip = rig.read()
    check_columns(clip, rig.model)
    begin = time.process_time()
    diagnosis = diagnose(clip, rig.model, fixed=rig.fixed, seconds=seconds)
    spent = time.process_time() - begin
    validation = validate_fit(diagnosis.final, clip, clip)
    cells = [
        f"{rig.name}{' (sealed)' if rig.sealed else ''}",
        f"{clip.n}",
        ", ".join(effect.name for effect in diagnosis.added) or "nothing",
        beside_published(rig, diagnosis.final),
        f"{validation.rms[0]:.3g}",
        f"{published_fit(rig, clip):.3g}",
        "" if validation.linear is None else f"{validation.linear.rms[0]:.3g}",
        f"{spent:.0f}",
    ]
    rows = [cells]
    if "damping" in rig.model.units():
        theirs = authors_terms(rig, clip)
        found = beside_published(rig, theirs)
        rows.append([f"{rig.name}, authors' terms", "", "given", found, f"{theirs.rms[0]:.3g}", "", "", ""])
    return "\n".join(f"| {' | '.join(row)} |" for row in rows)


def beside_published(rig: Rig, fitted: FitResult) -> str:
    """The values of a fit with their standard errors, each beside the one published, if there is one."""
    said = []
    for name, (value, stderr) in found_values(rig, fitted).items():
        published = f" ({rig.published[name]:.4g})" if name in rig.published else ""
        said.append(f"{name} {value:.4g} ± {stderr:.2g}{published}")
    return ", ".join(said)


def main() -> None:
    """Print the table as Markdown."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--only", default="", help="only recordings whose name contains this")
    parser.add_argument("--sealed", action="store_true", help="score the sealed recordings as well")
    parser.add_argument("--seconds", type=float, help="after which a diagnosis gives its best answer so far")
    add_option(parser)
    options = parser.parse_args()
    with table("driven", options.write_docs):
        print(
            "| recording | samples | named | found (published) | free run | with published values | linear model | s |"
        )
        print("|---|---|---|---|---|---|---|---|")
        for rig in RIGS:
            if options.only in rig.name and (options.sealed or not rig.sealed):
                try:
                    print(line(rig, options.seconds), flush=True)
                except Exception as error:  # a row that fails is a row
                    print(f"| {rig.name} | | failed: {error!s:.200} | | | | | |", flush=True)


if __name__ == "__main__":
    main()

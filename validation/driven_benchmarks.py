"""Public records of driven systems: a frozen physical model beside SINDy with inputs, a NARX and a linear model.

``python -m validation.driven_benchmarks`` fits all of them to the estimation records in ``../shared/data`` and scores
them there. ``--look`` opens the test records as well: a line of ``validation/results/driven-looks.jsonl`` counts the
look, with the hash of the record and of the frozen models. The structure of each physical model was found on the
estimation record alone; the tanks are the exception: their test record was scored before looks were counted.

The linear drive and the arms of :mod:`validation.driven` have no test record: all is fitted, and the last cell but one
is the error with their authors' values.

Each error is the root mean square of a free simulation. Windows are those of the benchmarks: the first samples are not
scored. The coupled drives' test follows the estimation record, so the simulation of that one gives the initial state.
"""

from __future__ import annotations

import argparse
import re
import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from itertools import groupby, islice
from pathlib import Path

import numpy as np

from fitters.ode import FitRequest
from fitters.ode.weak_fit import weak_fit
from fitters.validation_record import validate_model
from iris_sysid import (
    FitOptions,
    FitResult,
    OdeModel,
    Quantity,
    Trajectory,
    fit,
    model_from_equation,
    simulate,
    smooth,
    with_effects,
)
from iris_sysid.io.files import sha256_of
from iris_sysid.io.sealed_record import counted, log_look, model_hash
from iris_sysid.types import Array
from validation.black_boxes import linear, narx, sindy_with_inputs
from validation.driven import RIGS, Rig, dry_turnover, published_fit
from validation.pages import RESULTS, add_option, table
from validation.world_tables import WORLD

LOG = RESULTS / "driven-looks.jsonl"
TANKS = WORLD.parent / "cascaded_tanks" / "tanque.csv"
DRIVES = WORLD / "tab-coupled-drives" / "DATAUNIF.csv"
DRIVES_END = 400  # samples of the estimation record
CHATTERS = ("arm-frequency-sweep",)  # at the sampling rate, for 100 s: see validation.driven_arm
REAL_TANKS = "examples/two_tanks.py:real_tanks"

# Motors (speed w) with viscous friction and an offset of their voltage; a pulley (speed p) on a springy belt, with dry
# friction; a sensor that counts pulses of either direction, with a gain that grows with the speed, and lags.
BELT = "p'' = k*(w - p) - c*p'; w' = b*(u + o) - a*w - d*tanh(p/v); y' = (abs(p) + q*p^2 - y)/tau"
BOUNDS = {"v": (0.05, 10.0), "tau": (0.005, 0.2), "k": (1.0, 5000.0)}
START = {"a": 3.1, "b": 2.35, "k": 600.0, "c": 10.0, "tau": 0.024, "o": -0.035, "q": 1.84, "d": 2.07, "v": 0.45}


@dataclass(frozen=True, eq=False, slots=True)
class Frozen:
    """A model as it was fitted to the estimation records, and its values and initial states by name, one a record."""

    model: OdeModel
    fitted: FitResult
    values: Sequence[dict[str, float]]


@dataclass(frozen=True, slots=True)
class Benchmark:
    """Records of one file that are fitted together; ``part`` reads the estimation or the test records.

    ``file`` is None where there is no test record. ``others`` are the best errors published, one a record, or give the
    error of the authors' values. Benchmarks of one ``table`` stand in it together.
    """

    name: str
    file: Path | None
    records: tuple[str, ...]
    part: Callable[[bool], list[Trajectory]]
    fitted: Callable[[Sequence[Trajectory]], Frozen]
    windows: tuple[int, ...]
    continues: bool
    others: tuple[str, ...] | Callable[[Trajectory], float]
    table: str


def held_record(begin_s: float, step_s: float, u: Array, y: Array, names: tuple[Quantity, Quantity]) -> Trajectory:
    """A record of one held input and one output."""
    t_s, unknown = begin_s + np.arange(u.size) * step_s, np.full((u.size, 1), np.nan)
    every = np.ones(u.size, dtype=np.bool_)
    return Trajectory(
        t_s, names[1:], y[:, None], unknown, every, names[:1], u[:, None], hold="zero-order", sensor="encoder"
    )


def drives(test: bool) -> list[Trajectory]:
    """Both records of the coupled drives; the test rows are read for a look alone."""
    rows = slice(DRIVES_END, None) if test else slice(0, DRIVES_END)
    with DRIVES.open() as file:
        lines = list(islice(file, 1 + rows.start, None if rows.stop is None else 1 + rows.stop))
    filled = [line.strip().rstrip(",") for line in lines]
    table = np.array([[float(cell) for cell in line.split(",")] for line in filled if line])
    names = Quantity("u", "V"), Quantity("y", "1")
    begin_s = rows.start * 0.02
    return [held_record(begin_s, 0.02, table[:, k], table[:, k + 2], names) for k in (0, 1)]


def tanks(test: bool) -> list[Trajectory]:
    """The record of the cascaded tanks, full scale included."""
    part = "Val" if test else "Est"
    data = np.genfromtxt(TANKS, delimiter=",", names=True, usecols=(f"u{part}", f"y{part}"))
    names = Quantity("u", "V"), Quantity("level", "V")
    return [held_record(0.0, 4.0, data[f"u{part}"], data[f"y{part}"], names)]


def fitted_drives(records: Sequence[Trajectory]) -> Frozen:
    """One rig: both records, which start at rest, side by side in one fit with the same parameters."""
    first, second = records
    assert first.inputs is not None
    assert second.inputs is not None
    twice = "; ".join(re.sub(r"\b([pwyu])\b", rf"\g<1>{k}", BELT) for k in (1, 2))
    both = model_from_equation(twice, observed=["y1", "y2"], bounds=BOUNDS)
    pair = Trajectory(
        first.t_s,
        both.observed,
        np.hstack([first.position, second.position]),
        np.full((first.n, 2), np.nan),
        first.valid & second.valid,
        both.inputs,
        np.hstack([first.inputs, second.inputs]),
        hold=first.hold,
    )
    rest = dict.fromkeys(both.initial_names, 0.0)
    found = fit(pair, both, fixed=rest, start=START, options=FitOptions(discrepancy=False, local=True))
    one = model_from_equation(BELT, observed=["y"], bounds=BOUNDS)
    return Frozen(one, found, [{**values_of(found, one), **dict.fromkeys(one.initial_names, 0.0)}] * 2)


def fitted_tanks(records: Sequence[Trajectory]) -> Frozen:
    """The model of the example: overflow at both rims, and the sensor."""
    (record,) = records
    found = fit(record, REAL_TANKS)
    initial = {name: found.estimates[name].value for name in found.model.initial_names}
    return Frozen(found.model, found, [{**values_of(found, found.model), **initial}])


def values_of(fitted: FitResult, model: OdeModel) -> dict[str, float]:
    """The fitted values of a model's parameters by name."""
    return {parameter.name: fitted.estimates[parameter.name].value for parameter in model.parameters}


def fitted_rig(rig: Rig, records: Sequence[Trajectory]) -> Frozen:
    """A rig with the effects that its diagnosis names; the weak form gives the start."""
    (record,) = records
    model = with_effects(rig.model, rig.named)
    fixed = {**rig.fixed, "coulomb_turnover": dry_turnover(record)}
    weak = weak_fit(FitRequest(smooth(record), model, fixed))
    start = {} if weak is None else {name: weak.values[name] for name in weak.stderr}
    found = fit(record, model, fixed=fixed, start=start, options=FitOptions(discrepancy=False))
    initial = {name: found.estimates[name].value for name in model.initial_names}
    return Frozen(model, found, [{**values_of(found, model), **initial}])


def rig_records(rig: Rig, test: bool) -> list[Trajectory]:
    """The record of a rig; there is none for a test."""
    return [] if test else [rig.read()]


BENCHMARKS = [
    Benchmark(
        "coupled drives", DRIVES, ("u11", "u12"), drives, fitted_drives, (10, 4), True, ("0.100", "0.089"),
        "driven-coupled-drives",
    ),
    Benchmark(
        "cascaded tanks", TANKS, ("level",), tanks, fitted_tanks, (50,), False, ("0.191",), "driven-cascaded-tanks"
    ),
    *(
        Benchmark(
            rig.name, None, ("",), partial(rig_records, rig), partial(fitted_rig, rig), (10,), False,
            partial(published_fit, rig), "driven-rigs",
        )
        for rig in RIGS
        if "damping" in rig.model.units() and rig.name not in CHATTERS
    ),
]  # fmt: skip


def errors(frozen: Frozen, k: int, estimation: Trajectory, test: Trajectory | None, each: Benchmark) -> list[str]:
    """Cells of record k: the errors of the physical model, NARX, SINDy and linear model, one number a window."""
    model, values, record = frozen.model, frozen.values[k], estimation if test is None else test
    boxes = [narx(estimation, len(model.states)), sindy_with_inputs(estimation), linear(estimation, len(model.states))]
    wrong = [box(record, max(each.windows)) - record.position[:, 0] for box in boxes]
    rows = []
    for first in each.windows:
        if test is None:
            made = simulate(model, record.t_s, values, inputs=record.inputs, hold=record.hold).observed
            own = np.sqrt(np.mean((made - record.position)[first:] ** 2))
        else:
            before = estimation if each.continues else None
            own = validate_model(model, values, test, before, initial=first, continues=each.continues).rms[0]
        rows.append([own, *(np.sqrt(np.mean(error[first:] ** 2)) for error in wrong)])
    return [" / ".join(_number(value) for value in cell) for cell in zip(*rows, strict=True)]


def _number(value: float) -> str:
    return f"{value:.4f}" if np.isfinite(value) else "diverges"


def rows_of(each: Benchmark, look: bool) -> list[str]:
    """The rows of a benchmark, one a record and part; a look is logged before the test part is read."""
    estimation = each.part(False)
    frozen = each.fitted(estimation)
    print(f"{each.name}: {', '.join(parameters(frozen.fitted))}", file=sys.stderr)
    cells = []
    for k, name in enumerate(each.records):
        published = "" if isinstance(each.others, tuple) else _number(each.others(estimation[k]))
        cells.append([f"{each.name} {name}, estimation", *errors(frozen, k, estimation[k], None, each), published, ""])
    if look and each.file is not None and isinstance(each.others, tuple):
        values = {f"{name}-{k}": float(f"{x:.6g}") for k, own in enumerate(frozen.values) for name, x in own.items()}
        how = [f"windows {each.windows}", f"continues {each.continues}"]
        looks = log_look(LOG, sha256_of(each.file), model_hash(frozen.model.equation, values, how), each.name)
        here = counted([one for one in looks if one.record == looks[-1].record])
        for k, (name, test) in enumerate(zip(each.records, each.part(True), strict=True)):
            scores = errors(frozen, k, estimation[k], test, each)
            cells.append([f"{each.name} {name}, test", *scores, each.others[k], here])
    return [f"| {' | '.join(row)} |" for row in cells]


def parameters(fitted: FitResult) -> list[str]:
    """The fitted parameters with their standard errors, initial states left out."""
    names = [parameter.name for parameter in fitted.model.parameters if parameter.name in fitted.free]
    return [f"{name} {fitted.estimates[name].value:.4g} ± {fitted.estimates[name].stderr:.2g}" for name in names]


def main() -> None:
    """Print the table as Markdown."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--only", default="", help="only benchmarks whose name or table contains this")
    parser.add_argument("--look", action="store_true", help="open the test records; the look is logged")
    add_option(parser)
    options = parser.parse_args()
    chosen = [each for each in BENCHMARKS if options.only in each.name or options.only in each.table]
    for name, together in groupby(chosen, key=lambda each: each.table):
        with table(name, options.write_docs):
            print("| record | physical model | NARX | SINDy with inputs | linear model | best published | looks |")
            print("|---|---|---|---|---|---|---|")
            for each in together:
                print("\n".join(rows_of(each, options.look)), flush=True)


if __name__ == "__main__":
    main()

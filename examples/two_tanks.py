"""Your own model on measured data: two water tanks, from the raw file to the missing effect, and to a better model.

A pump fills the upper tank, which drains into the lower one, whose level a sensor reads in volts: the cascaded tanks
of Schoukens, Mattson, Wigren and Noel (2016), doi:10.4121/12960104. Download ``tanque.csv`` from there.

The first two models are diagnosed; each model contains more of the rig than the one before.
Run it: python examples/two_tanks.py tanque.csv [folder]
One step of it: iris-sysid diagnose folder/estimation.csv --model examples/two_tanks.py:two_tanks -o diagnosis/
"""

import sys
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd

from iris_sysid import (
    MODELS,
    Array,
    FitResult,
    OdeModel,
    Parameter,
    Quantity,
    Trajectory,
    diagnose,
    diagnosis_sentence,
    estimates_frame,
    fit,
    read_trajectory,
    simulate,
)

RIG = (
    "overflow",
    "leak",
    "gain-change",
    "zero-offset",
    "parameter-drift",
)  # what pumps, tanks and a level gauge can have
FULL_SCALE_V = 10.0  # the sensor reads no more
SETTLED = 50  # samples before the score counts, as its publishers ask
HOLD = "zero-order"  # the pump's voltage is constant between samples
BEST_PUBLISHED_V = 0.191  # simulation RMSE on the validation record

UPPER, LOWER, READING, PUMP = (Quantity(name, "V") for name in ("upper", "lower", "level", "u"))

# --------------------------------------------------------------------------- the textbook model


OUTFLOWS = (
    Parameter("upper_outflow", "V^0.5/s", "k_1", lower=0.0, default=0.05),
    Parameter("lower_outflow", "V^0.5/s", "k_2", lower=0.0, default=0.05),
    Parameter("pump", "1/s", "k_u", lower=0.0, default=0.05),
)


def lower_level(t_s: Array, states: Array, params: Array) -> Array:
    """The sensor reads the level of the lower tank."""
    return states[:, 1:]


def guess(trajectory: Trajectory) -> Mapping[str, float]:
    """Both tanks start at the first measured level of the lower tank."""
    first = float(trajectory.position[trajectory.valid][0, 0])
    return {"upper_0": first, "lower_0": first}


# the registered model, but with levels in the volts of the sensor
two_tanks = replace(
    MODELS["two-tanks"],
    states=(UPPER, LOWER),
    parameters=OUTFLOWS,
    observed=(READING,),
    guess=guess,
    inputs=(PUMP,),
    observe=lower_level,
    example=None,
)

# --------------------------------------------------------------------------- with the overflow described by its authors


def overflowing(
    t: float, state: tuple[float, float], params: tuple[float, ...], inputs: tuple[float]
) -> tuple[float, float]:
    """Both tanks overflow at their rims; the lower tank catches part of the overflow of the upper tank."""
    upper, lower = state
    upper_outflow, lower_outflow, pump, upper_rim, caught, lower_rim, over = params[:7]
    falling = upper_outflow * np.sqrt(max(upper, 0.0))
    lost = over * max(upper - upper_rim, 0.0)
    drained = lower_outflow * np.sqrt(max(lower, 0.0)) + over * max(lower - lower_rim, 0.0)
    return pump * inputs[0] - falling - lost, falling + caught * lost - drained


OVERFLOW = (
    Parameter("upper_rim", "V", "r_1", lower=2.0, upper=20.0, default=8.0),
    Parameter("caught", "1", "c", lower=0.0, upper=1.0, default=0.6),
    Parameter("lower_rim", "V", "r_2", lower=5.0, upper=20.0, default=7.3),
    Parameter("overflow_rate", "1/s", "w", default=1.0, constant=True, source="fast: the rim is wide"),
)

rimmed_tanks = OdeModel(
    name="rimmed-tanks",
    summary="two tanks that overflow, the upper one in part into the lower one",
    equation=r"\dot h_1 = k_u u - k_1\sqrt{h_1} - o_1,\quad \dot h_2 = k_1\sqrt{h_1} + c\,o_1 - k_2\sqrt{h_2} - o_2,"
    r"\quad o_i = w\max(h_i - r_i, 0)",
    source="Torricelli (1644); overflow as described by Schoukens et al. (2016)",
    states=(UPPER, LOWER),
    parameters=(*OUTFLOWS, *OVERFLOW),
    observed=(READING,),
    rhs=overflowing,
    guess=guess,
    inputs=(PUMP,),
    observe=lower_level,
)

# --------------------------------------------------------------------------- with the sensor that the record shows


def reading(t_s: Array, states: Array, params: Array) -> Array:
    """The gain changes at one level; a film of water that stays on the sensor when the level falls counts as water."""
    gain_level, gain, film, film_top, film_end = params[7:12]
    lower = states[:, 1]
    film_level = gain_level + (film_top - gain_level) / gain
    wetted, dried = lower > film_level, lower < film_end
    last_change = np.maximum.accumulate(np.where(wetted | dried, np.arange(lower.size), 0))
    film_v = np.where(wetted[last_change], film * np.maximum(film_level - lower, 0.0), 0.0)
    volts = lower + (gain - 1.0) * np.maximum(lower - gain_level, 0.0) + film_v
    return np.asarray(np.minimum(volts, FULL_SCALE_V))[:, None]


real_tanks = replace(
    rimmed_tanks,
    name="real-tanks",
    summary="two tanks that overflow, and a sensor whose gain changes, that stays wet and that ends at full scale",
    parameters=(
        *OUTFLOWS,
        *(replace(rim, upper=10.0) if rim.name == "lower_rim" else rim for rim in OVERFLOW),  # 10 V, by the sensor
        Parameter("gain_level", "V", "h_g", lower=3.5, upper=5.0, default=4.4),
        Parameter("gain", "1", "g", lower=1.0, upper=4.0, default=2.0),
        Parameter("film", "1", "f", lower=0.0, upper=1.0, default=0.3),
        Parameter("film_top", "V", "h_t", lower=6.0, upper=9.0, default=7.2),
        Parameter("film_end", "V", "h_e", default=4.98, constant=True, source="where the reading drops at once"),
    ),
    observe=reading,
)

# --------------------------------------------------------------------------- from the raw file to the sentence


def write_tables(raw: Path, folder: Path) -> tuple[Path, Path]:
    """Write one table for each record, as every command reads it; a reading at full scale becomes a gap."""
    columns = pd.read_csv(raw)
    folder.mkdir(parents=True, exist_ok=True)
    paths = folder / "estimation.csv", folder / "validation.csv"
    for path, name in zip(paths, ("Est", "Val"), strict=True):
        t_s = columns["Ts"][0] * np.arange(len(columns))
        level_v = columns[f"y{name}"].where(columns[f"y{name}"] < FULL_SCALE_V)
        pd.DataFrame({"t_s": t_s, "level_V": level_v, "u_V": columns[f"u{name}"]}).to_csv(path, index=False)
    return paths


def read_to_full_scale(record: Trajectory) -> Trajectory:
    """The record with its gaps filled, for a model that knows where the sensor ends."""
    level_v = np.where(record.valid[:, None], record.position, FULL_SCALE_V)
    return record.with_(position=level_v, valid=np.ones(record.n, dtype=bool))


def simulation_rmse(fitted: FitResult, record: Trajectory) -> float:
    """RMS error of a simulation from the pump's voltage alone, on a record that the model was not fitted to."""
    assert record.inputs is not None
    values = {name: estimate.value for name, estimate in fitted.estimates.items()}
    predicted = simulate(fitted.model, record.t_s, values, inputs=record.inputs, hold=HOLD).observed
    error = read_to_full_scale(record).position - np.minimum(predicted, FULL_SCALE_V)
    return float(np.sqrt(np.mean(error[SETTLED:] ** 2)))


def main(raw: Path, folder: Path) -> None:
    """Diagnose two tanks by Torricelli, then fit the model with all parts of the rig, and score both."""
    estimation, validation = (read_trajectory(path).with_(hold=HOLD) for path in write_tables(raw, folder))

    plain, rimmed = (diagnose(estimation, model, effects=RIG, seconds=120) for model in (two_tanks, rimmed_tanks))
    for diagnosis in (plain, rimmed):
        print(f"{diagnosis.base.model.name}: {diagnosis_sentence(diagnosis)}")
        print(f"  the score test ranks first: {diagnosis.rounds[0][0].effect}")

    better = fit(read_to_full_scale(estimation), real_tanks)
    print(estimates_frame(better)[["value", "stderr", "unit"]])

    print(f"simulation RMSE on the validation record (best published: {BEST_PUBLISHED_V} V)")
    for fitted in dict.fromkeys((plain.base, rimmed.base, rimmed.final, better)):
        print(f"  {fitted.model.name}: {simulation_rmse(fitted, validation):.3f} V, {len(fitted.free)} values fitted")


if __name__ == "__main__":
    if len(sys.argv) < 2 or not Path(sys.argv[1]).is_file():
        sys.exit("usage: two_tanks.py tanque.csv [folder]; the file is at https://doi.org/10.4121/12960104")
    main(Path(sys.argv[1]), Path(sys.argv[2] if len(sys.argv) > 2 else "two-tanks"))

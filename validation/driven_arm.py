"""The torque-driven arm: one law of six recordings, each predicted by the law of the other five.

``python -m validation.driven_arm [--half 0.2]`` needs the recordings in ``../shared/data``. The recorded torque is
regressed on acceleration, gravity, viscous and dry friction and a constant, all in weak form: averages over windows of
twice ``--half`` seconds. The authors (Wiebe et al. 2022, J. Open Source Software 7, 3884) regressed filtered samples of
the record "pd" on the same terms; :func:`authors_regression` gives their values to the last digit, and R^2. The chatter
of the gear is in their acceleration and dilutes the inertia: in weak form it grows with the window up to 0.16 s, then
no more.

A recording ends where the arm first comes within 0.2 rad of its upper rest: there dry friction holds it, and a hand
pushes it, which no torque shows. One recording carries 1 kg: its inertia and moment are its own, for both laws. Each
row gives the share of the torque's variance that the law of the other records explains (R^2), and the error of its free
runs over windows of a second, whose initial state alone is fitted; the same by the authors' law; and the friction of
that record under the inertia and moment of the others. What is named has an interval of 99 % that excludes zero.

The first rows are of all six: with the angle's zero as recorded, where the arm hung when it was switched on; with the
zero of each fitted, as a moment of cos(theta): a friction that holds the arm off its lowest place when it is switched
on looks there like an offset of the torque; and with a delay of each torque as well, which looks like viscous friction.

What bounds the three names: friction between 1 and 9 rad/s hardly rises. Viscous friction is 0.000 ± 0.006 N m s in
windows of 0.4 s and 0.012 ± 0.008 in 0.6 s, so the 0.047 of the authors is excluded, and one law without it predicts
each record better than theirs. Tried by hand beside the windows, with the zero of each angle free: free runs of 1, 1.5,
2 and 3 s fitted together, without the sweep, which leaves them. They give viscous 0.000, 0.009, -0.004 and -0.009 with
errors of 0.002 to 0.007, dry 0.17 to 0.23 and an offset of -0.08 to 0.02: more scatter than the errors say. Dry
friction that weakens with the speed or grows with the torque explains no more (R^2 0.9541, 0.9542 and 0.9545).
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.signal import butter, filtfilt

from fitters.ode.weak_fit import clustered_errors, weak_windows
from iris_sysid import FitOptions, Trajectory, fit, model_from_equation, smooth
from iris_sysid.types import Array, student_ppf
from validation.driven import ARM_FOLDER, ARM_PUBLISHED, ARMS, arm, rows, swing_up
from validation.pages import add_option, table
from validation.world_tables import columns

GRAVITY = 9.81  # m/s^2, as the authors took it
STEEPNESS = 100.0  # s/rad, of the authors' dry friction: 2/pi atan(100 theta')
TERMS = tuple(ARM_PUBLISHED)  # inertia, moment, damping, dry, offset
OWN_LOAD = 2  # of the terms, those that the load changes
NEVER_NEGATIVE = ("damping", "dry")  # a friction that adds energy is none
AUTHORS_RECORD = "arm-pd"
LOADED = "arm-energy-shaping-1kg"
RUN_S = 1.0  # length of a free run
CLUSTERS = 8  # of the windows of a recording, by which errors are judged
LIKELY = 0.995  # below this a friction is not named: an interval of 99 %
OWN = {"all six": (), "with the zero of each": ("aside",), "with the delay of each as well": ("aside", "late")}
AUTHORS = np.array([ARM_PUBLISHED[name] for name in TERMS])
LAW = model_from_equation(
    f"theta'' = (u - moment*{GRAVITY}*sin(theta) - damping*theta' - dry*2/pi*atan({STEEPNESS}*theta') - offset)"
    "/inertia",
    units={"theta": "rad", "u": "N m"},
)


@dataclass(frozen=True, eq=False, slots=True)
class Windows:
    """A recording in weak form: the ``torque`` (w,) of each window, and the ``terms`` (w, 5) that make it up.

    ``aside`` (w,) is the mean of g cos(theta), by which gravity acts where the zero of the angle is not the lowest;
    ``late`` (w,) that of the torque's derivative (N m/s), by which a delay acts.
    """

    name: str
    record: Trajectory
    terms: Array
    torque: Array
    aside: Array
    late: Array

    @property
    def weight(self) -> float:
        """Makes all recordings count alike: the variance of the torque times the number of windows is one."""
        return float(1.0 / (np.std(self.torque) * np.sqrt(self.torque.size)))

    def share(self, law: Array) -> float:
        """Share of the torque's variance that a law (5,) explains."""
        left = self.torque - self.terms @ law
        return float(1.0 - np.sum(left**2) / np.sum((self.torque - self.torque.mean()) ** 2))

    def with_own_load(self, law: Array) -> Array:
        """A law (5,), with the inertia and moment of this recording where its load differs."""
        if self.name != LOADED:
            return law
        left = self.torque - self.terms[:, OWN_LOAD:] @ law[OWN_LOAD:]
        return np.concatenate([np.linalg.lstsq(self.terms[:, :OWN_LOAD], left)[0], law[OWN_LOAD:]])


def windows_of(name: str, half_s: float) -> Windows:
    """Read a recording up to its upper rest, in windows of twice this half."""
    record = smooth(swing_up(arm(*ARMS[name])))
    assert record.smoothed is not None
    assert record.inputs is not None
    mean, second = weak_windows(record.t_s, half_s, 2)
    torque = record.inputs[:, 0]
    angle, rate = record.position[:, 0], record.smoothed.velocity[:, 0]
    dry = 2 / np.pi * np.arctan(STEEPNESS * rate)
    averaged = [mean @ each for each in (GRAVITY * np.sin(angle), rate, dry, np.ones(angle.size))]
    terms, aside = np.column_stack([second @ angle, *averaged]), mean @ (GRAVITY * np.cos(angle))
    return Windows(name, record, terms, mean @ torque, aside, weak_windows(record.t_s, half_s, 1)[1] @ torque)


def common_law(recordings: Sequence[Windows], own: Sequence[str] = ()) -> tuple[Array, Array]:
    """The law (5,) of all recordings by least squares, and its standard errors; one with a load has two more values.

    ``own`` are the fields of :class:`Windows` whose size is fitted for each recording.
    """
    blocks, torques = [], []
    for number, each in enumerate(recordings):
        loaded = np.zeros((each.torque.size, OWN_LOAD))
        terms = each.terms.copy()
        if each.name == LOADED:
            loaded, terms[:, :OWN_LOAD] = terms[:, :OWN_LOAD].copy(), 0.0
        more = np.zeros((each.torque.size, len(own), len(recordings)))
        for k, name in enumerate(own):
            more[:, k, number] = getattr(each, name)
        blocks.append(np.hstack([terms, loaded, more.reshape(each.torque.size, -1)]) * each.weight)
        torques.append(each.torque * each.weight)
    law, errors = least_squares(blocks, torques, [TERMS.index(name) for name in NEVER_NEGATIVE])
    return law[: len(TERMS)], errors[: len(TERMS)]


def own_friction(each: Windows, law: Array) -> tuple[Array, Array]:
    """Damping, dry friction and offset (3,) of a recording under the inertia and moment of a law, with errors."""
    left = each.torque - each.terms[:, :OWN_LOAD] @ law[:OWN_LOAD]
    never_negative = [TERMS.index(name) - OWN_LOAD for name in NEVER_NEGATIVE]
    return least_squares([each.terms[:, OWN_LOAD:]], [left], never_negative)


def least_squares(
    blocks: Sequence[Array], targets: Sequence[Array], never_negative: Sequence[int]
) -> tuple[Array, Array]:
    """Values (k,) and standard errors (k,) by CLUSTERS of each block; a friction below zero is left out: 0, 0."""
    matrix, target = np.vstack(blocks), np.concatenate(targets)
    kept = np.ones(matrix.shape[1], dtype=np.bool_)
    while True:
        values, errors = np.zeros(kept.size), np.zeros(kept.size)
        values[kept] = np.linalg.lstsq(matrix[:, kept], target)[0]
        wrong = [k for k in never_negative if values[k] < 0]
        if not wrong:
            break
        kept[min(wrong, key=lambda k: values[k] * np.linalg.norm(matrix[:, k]))] = False
    parts = [
        part
        for block, own in zip(blocks, targets, strict=True)
        for part in clusters(block[:, kept], own - block @ values)
    ]
    errors[kept] = clustered_errors(parts)
    return values, errors


def clusters(terms: Array, residual: Array) -> list[tuple[Array, Array]]:
    """The windows of a recording in CLUSTERS parts, one after another."""
    return list(zip(np.array_split(terms, CLUSTERS), np.array_split(residual, CLUSTERS), strict=True))


def free_run(record: Trajectory, law: Array) -> float:
    """Error (rms, rad) of free runs of a second with a law (5,); the initial state of each is fitted."""
    known = dict(zip(TERMS, map(float, law), strict=True))
    squares = []
    for begin_s in np.arange(record.t_s[0], record.t_s[-1] - RUN_S, RUN_S):
        part = rows(record, slice(*np.searchsorted(record.t_s, [begin_s, begin_s + RUN_S])))
        run = fit(part, LAW, fixed=known, options=FitOptions(discrepancy=False, local=True))
        squares.append(float(run.rms[0]) ** 2)
    return float(np.sqrt(np.mean(squares)))


def authors_regression() -> tuple[Array, float]:
    """The authors' law (5,) from their record by their filters, and R^2 of the torque that they regressed.

    Butterworth filters of order 3, forward and back: the torque at a tenth of the Nyquist frequency; the velocity at a
    fifth, its derivative at a tenth for the acceleration. The angle, and the velocity in the friction, are not filtered
    (github.com/dfki-ric-underactuated-lab/torque_limited_simple_pendulum, model/system_identification.py).
    """

    def smoothed(values: Array, cutoff: float) -> Array:
        return np.asarray(filtfilt(*butter(3, cutoff), values))

    t_s, angle, rate, torque = columns(ARM_FOLDER / ARMS[AUTHORS_RECORD][0]).T
    plain = np.gradient(angle, t_s)
    terms = [smoothed(np.gradient(smoothed(rate, 0.2), t_s), 0.1), GRAVITY * np.sin(angle), plain]
    matrix = np.column_stack([*terms, 2 / np.pi * np.arctan(STEEPNESS * plain), np.ones(t_s.size)])
    target = smoothed(torque, 0.1)
    law = np.linalg.lstsq(matrix, target)[0]
    return law, float(1.0 - np.var(target - matrix @ law) / np.var(target))


def row(each: Windows, others: Sequence[Windows]) -> str:
    """One row of the table: inertia and moment of the others' law, and its own friction under these."""
    law = each.with_own_load(common_law(others)[0])
    authors = each.with_own_load(AUTHORS)
    found, errors = own_friction(each, law)
    cells = (
        each.name.removeprefix("arm-"),
        f"{each.record.t_s[-1] - each.record.t_s[0]:.1f}",
        f"{each.share(law):.3f} / {each.share(authors):.3f}",
        f"{free_run(each.record, law):.3f} / {free_run(each.record, authors):.3f}",
        *(f"{value:.3f}" for value in law[:OWN_LOAD]),
        *map(stated, found, errors),
        named(found, errors, CLUSTERS),
    )
    return f"| {' | '.join(cells)} |"


def named(friction: Array, errors: Array, count: int) -> str:
    """Of damping, dry friction and offset (3,) those whose interval by so many clusters excludes zero."""
    sure, each = student_ppf(LIKELY, count - 1), zip(TERMS[OWN_LOAD:], friction, errors, strict=True)
    return ", ".join(name for name, value, error in each if abs(value) > sure * error > 0) or "none"


def stated(value: float, error: float) -> str:
    """A value with its standard error; one that was held has none."""
    return f"{value:.3f} ± {error:.3f}" if error > 0 else "0 (held)"


def main() -> None:
    """Print the table as Markdown."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--half", type=float, default=0.2, help="half a window, s")
    add_option(parser)
    options = parser.parse_args()
    recordings = [windows_of(name, options.half) for name in ARMS]
    with table("driven-arm", options.write_docs):
        print(
            "| recording | s | R^2, others / authors | run, rad | inertia | moment | damping | dry | offset | named |"
        )
        print("|---|---|---|---|---|---|---|---|---|---|")
        for name, own in OWN.items():
            found, errors = common_law(recordings, own)
            said = named(found[OWN_LOAD:], errors[OWN_LOAD:], CLUSTERS * len(recordings))
            print(f"| {name} | | | | {' | '.join(map(stated, found, errors))} | {said} |")
        law, share = authors_regression()
        print(f"| authors, repeated | | {share:.3f} | | {' | '.join(f'{value:.4f}' for value in law)} | |")
        for each in recordings:
            print(row(each, [other for other in recordings if other is not each]), flush=True)


if __name__ == "__main__":
    main()

"""Real recordings with a known effect: where each comes from, what was known before it was diagnosed, and its reader.

Everything here was written before the recording was diagnosed. ``known`` quotes the table that came with it (the
README files of ``../shared/data``), or states the physics; ``right`` and ``plausible`` follow from it.
"""

from __future__ import annotations

import hashlib
import tempfile
from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np

from iris_sysid import MODELS, PHENOMENA, OdeModel, Parameter, Quantity, Trajectory, read_trajectory
from iris_sysid.types import Array
from tests._real_data import alexiev_length_68, schmidt_lipson_linear, wooden_bob
from validation import films
from validation.world_coastdowns import COASTS
from validation.world_friction_rig import PISTONS
from validation.world_tables import (
    DATA,
    DRAG,
    FRICTION,
    LOCAL_GRAVITY,
    NOTHING,
    QUADRATIC,
    TORQUE,
    UNEVEN,
    WORLD,
    WORLD2,
    ZERO,
    Recording,
    columns,
    only,
    series,
    sheet_rows,
)

# Falling bodies -----------------------------------------------------------------------------------------------------


def drops(name: str) -> list[Trajectory]:
    """All drops of one ball."""
    rows = sheet_rows(WORLD / "tab-bridge-drops" / "Ball_drops_data.xls", name)
    each = [rows[rows[:, 0] == number] for number in np.unique(rows[:, 0])]
    return [series(drop[:, 1], drop[:, 2], Quantity("z", "m")) for drop in each]


def ball(name: str, sheet: str, known: str, right: frozenset[str]) -> Recording:
    """A row of the drops from a bridge."""
    return Recording(
        f"ball-{name}",
        "world/README: quadratic drag (strong for whiffle balls), drag crisis?, coarse read-off noise",
        known,
        MODELS["free-fall"],
        partial(drops, sheet),
        "unknown",
        right,
        DRAG | {"drag-crisis"},
        fixed=LOCAL_GRAVITY,
    )


BALLS = [
    ball("baseball", "Baseball", "5 oz, 22 cm round: drag", DRAG),
    ball("basketball-blue", "Blue Basketball", "18 oz, 75 cm round: drag", DRAG),
    ball("basketball-green", "Green Basketball", "16 oz, 73 cm round: drag", DRAG),
    ball("bowling", "Bowling Ball", "81 oz, 67 cm round: nothing or drag", NOTHING),
    ball("golf", "Golf Ball", "1.6 oz, 13.8 cm round: nothing or drag", NOTHING),
    ball("tennis", "Tennis Ball", "2 oz, 21 cm round: drag", DRAG),
    ball("volleyball", "Volleyball", "light and large: drag", DRAG),
    ball("whiffle-1", "Whiffle Ball 1", "1 oz, 23 cm round: strong quadratic drag", QUADRATIC),
    ball("whiffle-2", "Whiffle Ball 2", "1 oz, 23 cm round: strong quadratic drag", QUADRATIC),
    ball("whiffle-orange", "Orange Whiffle Ball", "1.5 oz, 29 cm round: strong quadratic drag", QUADRATIC),
    ball("whiffle-yellow", "Yellow Whiffle Ball", "1.5 oz, 29 cm round: strong quadratic drag", QUADRATIC),
]


def coffee_filter() -> Trajectory:
    """Height by sonar."""
    t_s, height = np.loadtxt(WORLD / "tab-coffee-filter" / "falling.txt", comments="/").T
    return series(t_s, height, Quantity("z", "m"))


# An arm under a motor -----------------------------------------------------------------------------------------------


def arm_rhs(
    t: float, state: tuple[float, float], params: tuple[float, float, float, float], inputs: tuple[float]
) -> tuple[float, float]:
    """Torques: J q'' = tau - m c g sin q - d q'."""
    angle, rate = state
    inertia, moment, damping, gravity = params
    return rate, (inputs[0] - moment * gravity * np.sin(angle) - damping * rate) / inertia


def arm_guess(trajectory: Trajectory) -> Mapping[str, float]:
    """A small arm at rest."""
    return {"q_0": float(trajectory.position[trajectory.valid][0, 0]), "q_rate_0": 0.0}


ARM = OdeModel(
    name="driven-arm",
    summary="an arm that a motor turns against gravity, damped in proportion to its speed",
    equation=r"J\ddot q = \tau - m c g\sin q - d\,\dot q",
    source="Newton-Euler",
    states=(Quantity("q", "rad"), Quantity("q_rate", "rad/s")),
    parameters=(
        Parameter("inertia", "kg m^2", "J", lower=1e-3, upper=10.0, default=0.06),
        Parameter("moment", "kg m", "mc", lower=0.0, upper=10.0, default=0.1),
        Parameter("damping", "N m s", "d", lower=-10.0, upper=10.0, default=0.05, role="damping"),
        Parameter("gravity", "m/s^2", "g", default=9.81, constant=True, stderr=0.01, role="gravity"),
    ),
    observed=(Quantity("q", "rad"),),
    rhs=arm_rhs,
    guess=arm_guess,
    inputs=(TORQUE,),
)


def arm_clip(path: str, first: int) -> Trajectory:
    """Angle by the motor's encoder, and the torque; ``first`` is the column of the time."""
    table = columns(WORLD / "tab-torque-pendulum" / path)
    return series(table[:, first], table[:, first + 1], Quantity("q", "rad"), table[:, first + 3])


def arm(name: str, path: str, first: int = 0) -> Recording:
    """A row of the driven arm."""
    return Recording(
        f"arm-{name}",
        "world/README and system_identification.txt: viscous (in the model) and Coulomb friction Fc = 0.18 N m, "
        "torque offset -0.08 N m",
        "dry friction and a constant torque",
        ARM,
        only(partial(arm_clip, path, first)),
        "encoder",
        FRICTION,
        ZERO | {"zero-drift"},
    )


ARMS = [
    arm("collocation", "results__control_method_direct_collocation__data_measured.csv"),
    arm("energy-shaping", "results__control_method_energy_shaping__data_measured.csv"),
    arm("energy-shaping-1kg", "data_measured_1kg.csv"),
    arm("frequency-sweep", "measured_data.csv", first=1),
    arm("pd", "control_method_pd__system_identification__data_measured.csv"),
    arm("sac", "results__control_method_sac__data_measured.csv"),
]


# A wheel on a torsion rod -------------------------------------------------------------------------------------------


def wheel_guess(trajectory: Trajectory) -> Mapping[str, float]:
    """The rate obeys the equation of the angle: stiffness and damping from it, the angle from its slope."""
    course = replace(trajectory, quantities=(Quantity("z", "m"),))
    like = MODELS["linear-oscillator"].guess(course)
    slope = like.get("vz_0", like.get("v_0", 0.0))
    return {
        "stiffness": like["stiffness"],
        "damping": like["damping"],
        "phi_0": -float(slope) / max(like["stiffness"], 1e-9),
        "omega_0": float(trajectory.position[trajectory.valid][0, 0]),
    }


def turning_rate(t_s: Array, states: Array, params: Array) -> Array:
    """A gyroscope shows the rate (n, 1), rad/s, of the states (n, 2) at ``t_s`` (n,) s."""
    return states[:, 1:2]


def wheel_rhs(t: float, state: tuple[float, float], params: tuple[float, float]) -> tuple[float, float]:
    """A linear torque and damping: phi'' = -k phi - c phi'."""
    angle, rate = state
    stiffness, damping = params
    return rate, -stiffness * angle - damping * rate


WHEEL = OdeModel(
    name="torsion-wheel",
    summary="a wheel on a torsion rod, damped in proportion to its speed, whose rate is measured",
    equation=r"\ddot\varphi = -k\varphi - c\,\dot\varphi",
    source="Hooke",
    states=(Quantity("phi", "rad"), Quantity("omega", "rad/s")),
    parameters=(
        Parameter("stiffness", "1/s^2", "k", lower=0.0, default=10.0),
        Parameter("damping", "1/s", "c", default=0.1, role="damping"),
    ),
    observed=(Quantity("omega", "rad/s"),),
    rhs=wheel_rhs,
    guess=wheel_guess,
    observe=turning_rate,
)


def wheel_clip(axis: str) -> Trajectory:
    """Angular velocity by gyroscope."""
    table = columns(WORLD / "tab-wheel-torsion" / f"bicycle-wheel-{axis}-inertia-rate-gyro-measurement.csv")
    return series(table[:, 0], table[:, 1], Quantity("omega", "rad/s"))


def wheel(axis: str) -> Recording:
    """A row of the wheel."""
    return Recording(
        f"wheel-{axis}",
        "world/README: weak damping, gyro bias/noise",
        "nothing or a wrong zero of the gyroscope; air drag of the spokes",
        WHEEL,
        only(partial(wheel_clip, axis)),
        "gauge",
        NOTHING,
        ZERO | DRAG | {"zero-drift"},
    )


# Tanks --------------------------------------------------------------------------------------------------------------

HOLE_M, HOLE_RADIUS_M = 0.025, 0.5 * 0.0254 / 8
BOTTOM_M2, TOP_M2, TANK_M = 102.98e-4, 128.95e-4, 0.2859  # rounded rectangles from tank_length_measurements.txt


def tank_rhs(t: float, state: tuple[float], params: tuple[float]) -> tuple[float]:
    """A(h) h' = -C a sqrt(2 g h), the sides of the tank being known."""
    (level,) = state
    above = max(level, 0.0)
    side = np.sqrt(BOTTOM_M2) + (np.sqrt(TOP_M2) - np.sqrt(BOTTOM_M2)) * (above + HOLE_M) / TANK_M
    return (-params[0] * np.pi * HOLE_RADIUS_M**2 * np.sqrt(2 * 9.81 * above) / side**2,)


def tank_guess(trajectory: Trajectory) -> Mapping[str, float]:
    """A sharp-edged hole."""
    return {"discharge": 0.6, "h_0": float(trajectory.position[trajectory.valid][0, 0])}


TANK = OdeModel(
    name="tapered-tank",
    summary="a tank of known sides that drains through a hole of known size",
    equation=r"A(h)\,\dot h = -C a\sqrt{2 g h}",
    source="Torricelli (1644)",
    states=(Quantity("h", "m"),),
    parameters=(Parameter("discharge", "1", "C", lower=0.0, upper=3.0, default=0.6),),
    observed=(Quantity("h", "m"),),
    rhs=tank_rhs,
    guess=tank_guess,
)


def tank_clip(path: str) -> Trajectory:
    """Level above the hole, averaged over each second, from one minute after the tank is full until 2 cm are left."""
    folder = WORLD / "tab-drain-tank"
    level_cm, reading = columns(folder / "level_sensor_calibration.csv").T
    straight = level_cm >= 3  # below, the sensor shows the same reading
    gauge = np.polyfit(reading[straight], level_cm[straight], 3)
    rows = np.loadtxt((line for line in (folder / path).read_text().splitlines() if line[:1].isdigit()), delimiter=",")
    seconds = np.floor(rows[:, 0])
    t_s = np.unique(seconds)
    level_m = np.polyval(gauge, [rows[seconds == second, 1].mean() for second in t_s]) / 100 - HOLE_M
    start = int(np.argmax(level_m)) + 60
    stop = start + int(np.argmax(level_m[start:] < 0.02))
    return series(t_s[start:stop], level_m[start:stop], Quantity("h", "m"))


def tank(name: str, path: str, known: str, outside: bool = False) -> Recording:
    """A row of the draining tank."""
    return Recording(
        f"tank-{name}",
        "world/README: discharge coefficient and non-prismatic tank (in the model), body in the tank, sensor",
        known,
        TANK,
        only(partial(tank_clip, path)),
        "gauge",
        NOTHING,
        ZERO | {"gain-change", "zero-drift"},
        outside=outside,
    )


def cascaded_tanks() -> Trajectory:
    """Level of the lower tank, V, under the pump's voltage; a reading at full scale is a gap."""
    table = columns(DATA / "cascaded_tanks" / "tanque.csv")
    pump, level = table[:, 0], table[:, 2]
    clip = series(4.0 * np.arange(level.size), np.where(level < 10.0, level, np.nan), Quantity("level", "V"))
    return clip.with_(inputs=pump[:, None], input_quantities=(Quantity("u", "V"),))


# Pendulums ----------------------------------------------------------------------------------------------------------

THETA, Z = Quantity("theta", "rad"), Quantity("z", "px")
HANGS_PX = 1002.8  # where the pendulum of alexiev 001 hangs (its README)
CLEAN = 18_000  # samples of it before single-frame false detections


def tracker_angle(path: str) -> Trajectory:
    """Angle read off with a tracking program, with its stated errors."""
    table = columns(WORLD / "tab-90deg-pendulum" / path)
    clip = series(table[:, 0], table[:, 1], THETA)
    return clip if clip.n < len(table) else clip.with_(sigma=table[:, 3:4])


def hayson(path: str) -> Trajectory:
    """Position of a bob across the frame, tracked to half pixels, from its mean; the table's angles are all zero."""
    table = columns(WORLD / "tab-hayson-pendulum" / path)
    across_px = table[:, -3]
    return series(table[:, -4], across_px - np.mean(across_px), Z)


def foucault() -> Trajectory:
    """Position along the main direction of the swing, px."""
    t_s, *xy = columns(WORLD / "tab-foucault" / "2021_09_17_14_57_N.csv", delimiter=";").T
    points = np.column_stack(xy) - np.mean(xy, axis=1)
    along = points @ np.linalg.svd(points, full_matrices=False)[2][0]
    return series(t_s, along, Z)


def wide(number: int, until_s: float = np.inf, step: int = 1) -> Trajectory:
    """Angle of a wide swing, its first ``until_s`` seconds at every ``step``-th sample."""
    t_s, angle = columns(WORLD2 / "tab-pendulum-wide" / f"data{number}.csv").T
    early = t_s - t_s[0] < until_s
    return series(t_s[early][::step], angle[early][::step], THETA)


def cardboard_plate() -> Trajectory:
    """Deflection of a plate that is let go, from its mean over the second half; from its largest value on."""
    t_s, x_m, _ = columns(WORLD / "tab-cardboard-plate" / "damping.csv").T
    bent = x_m - np.mean(x_m[x_m.size // 2 :])
    start = int(np.argmax(np.abs(bent)))
    return series(t_s[start:], bent[start:], Quantity("z", "m"))


def alexiev_001() -> Trajectory:
    """Position across the frame, px."""
    folder = DATA / "alexiev_pendulum"
    t_s, x_px = (np.loadtxt(folder / f"001_{name}.csv")[:CLEAN] for name in ("times", "x_pos_pixels"))
    return series(t_s, x_px - HANGS_PX, Z)


def swing(
    name: str,
    source: str,
    known: str,
    read: Callable[[], Trajectory],
    right: frozenset[str],
    plausible: frozenset[str] = DRAG | ZERO,
    model: str = "pendulum",
) -> Recording:
    """A row of a filmed pendulum."""
    return Recording(name, source, known, MODELS[model], only(read), "camera", right, plausible)


WIDE = "world2/README: amplitude-dependent period (in the model), quadratic/linear drag, angle quantised"
IN_90DEG = "world/README: amplitude-dependent period (in the model), drag decay over minutes"
SINE = frozenset({"cubic-stiffness"})
SWINGS = [
    swing("pendulum-90deg", IN_90DEG, "drag", partial(tracker_angle, "q2_data.csv"), DRAG),
    *(
        swing(f"pendulum-90deg-{k}", IN_90DEG, "nothing or drag", partial(tracker_angle, f"q4b_data{k}.csv"), NOTHING)
        for k in range(1, 6)
    ),
    swing(
        "pendulum-alexiev-001", "data/README: quadratic drag", "quadratic drag; a pendulum's sine is cubic in x",
        alexiev_001, QUADRATIC, DRAG | ZERO | SINE, "linear-oscillator",
    ),
    swing("pendulum-alexiev-68", "data/README: length only", "nothing or drag", alexiev_length_68, NOTHING),
    swing(
        "pendulum-foucault", "world/README: 2-D swing, slow precession, damping", "drag; the sine; precession",
        foucault, NOTHING, DRAG | ZERO | SINE | {"parameter-drift"}, "linear-oscillator",
    ),
    swing(
        "pendulum-hayson-run1", "world/README: drag, half-pixel steps", "drag; the sine", partial(hayson, "run1.csv"),
        DRAG, DRAG | ZERO | SINE, "linear-oscillator",
    ),
    swing(
        "pendulum-hayson-263", "world/README: drag; frames dropped", "drag; the sine; lost frames",
        partial(hayson, "263.csv"), NOTHING, DRAG | ZERO | SINE | {"dropped-frame", "time-scale"}, "linear-oscillator",
    ),
    *(
        swing(f"pendulum-wide-{k}", WIDE, "nothing or drag", partial(wide, k), NOTHING) for k in (31, 32, 33)
    ),
    swing("pendulum-wide-31-halved", WIDE, "nothing or drag", partial(wide, 31, 40.0, 2), NOTHING),
    swing(
        "pendulum-wooden-bob", "data/README: slight quadratic drag; its zero is 0.009 rad off (issue 18)",
        "quadratic drag, zero offset", wooden_bob, QUADRATIC,
    ),
]  # fmt: skip


# All of them --------------------------------------------------------------------------------------------------------


def filmed(name: str, source: str, known: str, right: frozenset[str], plausible: frozenset[str]) -> Recording:
    """A row that starts from a video, by the command in :mod:`validation.films`."""
    film = films.named(name)
    described = PHENOMENA.named(film.phenomenon)
    return Recording(
        f"film-{name}",
        source,
        known,
        MODELS[described.model],
        only(partial(track, film)),
        "camera",
        right,
        plausible,
        free=described.free,
    )


def track(film: films.Film) -> Trajectory:
    """The trajectory that the command of a film measures."""
    with tempfile.TemporaryDirectory() as folder:
        films.run(film, Path(folder))
        return read_trajectory(Path(folder) / "trajectory.csv")


FILMS = [
    filmed("iris-pendulum", "data/README: ball on a cord; dynamic length", "nothing or drag", NOTHING, DRAG),
    filmed("juangomez", "data/README: ball on a string", "nothing or drag", NOTHING, DRAG | ZERO),
    filmed("projectile-30", "data/README: steel ball", "nothing or drag", NOTHING, DRAG),
    filmed("projectile-60", "data/README: steel ball", "nothing or drag", NOTHING, DRAG),
    filmed("sliding-friction-R1", "data/README: block on an incline", "nothing or uneven friction", NOTHING, UNEVEN),
    filmed("sliding-friction-R3", "data/README: block on an incline", "nothing or uneven friction", NOTHING, UNEVEN),
]


# All of them --------------------------------------------------------------------------------------------------------

OTHERS = [
    Recording(
        "air-track-single", "data/README: damped cosine fits to the noise", "nothing or drag",
        MODELS["linear-oscillator"], only(schmidt_lipson_linear), "camera", NOTHING, DRAG | ZERO,
    ),
    Recording(
        "coffee-filter", "world/README: quadratic drag to terminal speed", "quadratic drag",
        MODELS["free-fall"], only(coffee_filter), "gauge", QUADRATIC, DRAG, fixed=LOCAL_GRAVITY,
    ),
    Recording(
        "plate-cardboard", "world/README: damped cantilever, large angles", "nothing, drag, or a stiffness",
        MODELS["linear-oscillator"], only(cardboard_plate), "camera", NOTHING, DRAG | ZERO | SINE,
    ),
    Recording(
        "tanks-cascaded", "data/README: overflow beyond Torricelli outflow", "overflow",
        MODELS.named("examples/two_tanks.py:two_tanks"), only(cascaded_tanks), "gauge", frozenset({"overflow"}),
        frozenset({"gain-change"}),
    ),
    tank("empty-1", "liq_level_data_empty_train.csv", "nothing, or the gauge's curve"),
    tank("empty-2", "liq_level_data_empty_test.csv", "nothing, or the gauge's curve"),
    tank("with-bottle", "liq_level_data_w_bottle.csv", "a bottle takes part of the volume: not in the library", True),
    wheel("axial"),
    wheel("radial"),
]  # fmt: skip
RECORDINGS = sorted([*ARMS, *BALLS, *SWINGS, *FILMS, *OTHERS, *COASTS, *PISTONS], key=lambda recording: recording.name)


def chosen(only: str = "", without: str = "") -> list[Recording]:
    """The recordings whose name contains a text, and not another."""
    named = [recording for recording in RECORDINGS if only in recording.name]
    return [recording for recording in named if not without or without not in recording.name]


def sealed(name: str) -> bool:
    """Whether a recording may not be looked at: the first byte of the SHA-256 of its name is even."""
    return hashlib.sha256(name.encode()).digest()[0] % 2 == 0


# What was looked at while programs were written: before the lot was drawn anew every second row of an older table and
# the pendulum of the issue; later, in error, the baseball and the pistons, and R1 when it got a wrong name. A sealed
# one of these is no independent test.
SEEN_NAMES = """
    air-track-single arm-energy-shaping arm-frequency-sweep arm-sac ball-baseball ball-basketball-blue ball-bowling
    ball-tennis ball-whiffle-1 ball-whiffle-orange coffee-filter film-juangomez film-projectile-60
    film-sliding-friction-R1
    film-sliding-friction-R3 pendulum-90deg-1 pendulum-90deg-3 pendulum-90deg-5 pendulum-alexiev-68 pendulum-hayson-263
    pendulum-wide-31-halved pendulum-wooden-bob piston-circle-1 piston-circle-5 piston-kdn-1 piston-kdn-7 tank-empty-2
    tanks-cascaded wheel-radial
"""
SEEN = frozenset(SEEN_NAMES.split())

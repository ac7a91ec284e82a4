"""Two pendulums side by side: impacts, lasting contact, or the benchmark's continuous coupling.

theta_i'' + zeta_i theta_i' + (g/L_i) sin theta_i + kappa (theta_i - theta_j) = 0; with ``contact`` the balls are
solid: they bounce with a coefficient of restitution and, when they no longer bounce, stay together until pulled apart.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from iris_sysid.errors import DataError
from iris_sysid.synthetic.camera import CameraView
from iris_sysid.synthetic.effects import extra_acceleration
from iris_sysid.synthetic.motion import Phase, SceneEvent, SceneMotion, integrate
from iris_sysid.synthetic.props import clamp, tape
from iris_sysid.synthetic.scene import SceneBody, Setup, Stage, Wall, stated
from iris_sysid.synthetic.scenes._hanging import ball, constant, cord, hanging, holding_hand
from iris_sysid.synthetic.shapes import Colour, Layer, Path
from iris_sysid.types import Array, Parameter

DARK: Colour = (26.0, 40.0, 92.0)
LIGHT: Colour = (134.0, 178.0, 190.0)
CORD_WIDTH_M = 0.0035
STICKING_SPEED = 2e-3  # m/s; slower impacts end the bouncing

PARAMETERS = (
    Parameter("length_1", "m", "L_1", 0.01, 100.0, 0.5),
    Parameter("length_2", "m", "L_2", 0.01, 100.0, 0.5),
    Parameter("damping_1", "1/s", r"\zeta_1", 0.0, 100.0, 0.06),
    Parameter("damping_2", "1/s", r"\zeta_2", 0.0, 100.0, 0.06),
    Parameter("coupling", "1/s^2", r"\kappa", 0.0, 1e4, 0.0),
    Parameter("restitution", "1", "e", 0.0, 1.0, 0.85),
    Parameter("contact", "1", "", 0.0, 1.0, 1.0),
    Parameter("gravity", "m/s^2", "g", 0.01, 1000.0, 9.80665),
    Parameter("theta_1_0", "rad", r"\theta_{1,0}", -math.pi, math.pi, -math.pi / 4),
    Parameter("theta_2_0", "rad", r"\theta_{2,0}", -math.pi, math.pi, math.pi / 4),
    Parameter("ball_radius_1", "m", "r_1", 1e-4, 1.0, 0.031),
    Parameter("ball_radius_2", "m", "r_2", 1e-4, 1.0, 0.029),
    Parameter("pivot_gap", "m", "", 0.0, 1.0, 0.012),
    Parameter("release_time", "s", "t_r", 0.0, 1e4, 0.5),
)
SCATTER = {"theta_1_0": 0.004, "restitution": 0.01, "release_time": 0.05}
PUBLISHED = {f"length_{body}": (f"rope_length_{body}", 1.0, "m") for body in (1, 2)}
EFFECTS = ("linear-drag", "quadratic-drag", "constant-force", "cubic-stiffness", "parameter-drift")


@dataclass(frozen=True, eq=False, slots=True)
class PendulumPair:
    """The mechanics of the two balls; index 0 is the left one. Masses go with the cube of the radius."""

    length: Array
    damping: Array
    coupling: float
    gravity: float
    restitution: float
    radius: Array
    pivot_x: Array
    effects: Mapping[str, float]
    release_s: float

    @classmethod
    def of(cls, setup: Setup) -> PendulumPair:
        """The pair that a setup describes."""
        both = {name: np.array([setup[f"{name}_1"], setup[f"{name}_2"]]) for name in ("length", "damping")}
        radius = np.array([setup["ball_radius_1"], setup["ball_radius_2"]])
        pivot_x = setup["pivot_gap"] / 2 * np.array([-1.0, 1.0])
        rest = (setup["coupling"], setup["gravity"], setup["restitution"], radius, pivot_x, setup.effects)
        return cls(both["length"], both["damping"], *rest, setup["release_time"])

    def acceleration(self, t: float, state: Array) -> Array:
        """Angular accelerations (2,) without contact; the state is theta_1, theta_2, omega_1, omega_2. In rad/s^2."""
        theta, omega = state[:2], state[2:]
        added = extra_acceleration(self.effects)
        drift = 1 + self.effects.get("parameter-drift", 0.0) * (t - self.release_s)
        base = -self.damping * omega - self.gravity / self.length * np.sin(theta)
        base -= self.coupling * (theta - theta[::-1])
        return base * drift + np.array([added(t, theta[k], omega[k]) for k in range(2)])

    def gap(self, state: Array) -> float:
        """Distance between the surfaces, m; negative where the balls overlap.

        ``state`` (4,): angles and angular velocities of both.
        """
        return float(np.linalg.norm(self._geometry(state)[0])) - float(self.radius.sum())

    def normal(self, state: Array) -> tuple[Array, Array]:
        """The gap's slope d gap / d theta_i (2,), and the effect of a unit impulse.

        The gap's rate is the product of its slope with omega. The second (2,) is the change of omega_i by a unit
        impulse along the line of centres.
        """
        way, tangent, _ = self._geometry(state)
        slope = np.array([-1.0, 1.0]) * (tangent @ (way / np.linalg.norm(way)))
        return slope, slope / (self.radius**3 * self.length**2)

    def _geometry(self, state: Array) -> tuple[Array, Array, Array]:
        """From centre 1 to centre 2 (2,); d centre / d theta (2, 2) and its derivative, one row a body."""
        sine, cosine = np.sin(state[:2]), np.cos(state[:2])
        outward = self.length[:, np.newaxis] * np.stack([sine, -cosine], axis=-1)
        tangent = self.length[:, np.newaxis] * np.stack([cosine, sine], axis=-1)
        way = outward[1] - outward[0] + np.array([self.pivot_x[1] - self.pivot_x[0], 0.0])
        return way, tangent, -outward

    def pushed(self, state: Array, restitution: float) -> Array:
        """The state after an impulse along the line of centres that reverses the gap's rate, times restitution.

        ``state`` (4,): angles in rad and angular velocities in rad/s of both.
        """
        slope, response = self.normal(state)
        after = state.copy()
        after[2:] -= (1 + restitution) * float(slope @ state[2:]) / float(slope @ response) * response
        return after

    def holding_force(self, t: float, state: Array) -> tuple[float, Array]:
        """Force (per unit mass scale) that keeps the gap closed, and the accelerations (2,) it causes per unit."""
        way, tangent, curve = self._geometry(state)
        distance = float(np.linalg.norm(way))
        direction = way / distance
        speed = tangent[1] * state[3] - tangent[0] * state[2]
        bend = float(direction @ (curve[1] * state[3] ** 2 - curve[0] * state[2] ** 2))
        bend += float(speed @ speed - (direction @ speed) ** 2) / distance
        slope, response = self.normal(state)
        free = float(slope @ self.acceleration(t, state)) + bend
        return -free / float(slope @ response), response

    def apart(self, speed: float = 1.0) -> Phase:
        """The balls move freely until they touch; ``speed`` (m/s) at which they last parted bounds the step."""
        step = float(np.clip(0.3 * speed / self.gravity * 2, 2e-4, 0.02))
        return Phase("motion", self._free, (SceneEvent("impact", self._gap, -1.0, self._struck),), step)

    def together(self) -> Phase:
        """The balls lie against each other until they are pulled apart."""
        return Phase("contact", self._joined, (SceneEvent("parting", self._force, -1.0, self._parted),), 0.02)

    def never_touching(self) -> Phase:
        """The balls pass through each other: the benchmark's continuous coupling alone."""
        return Phase("motion", self._free)

    def _free(self, t: float, state: Array) -> Array:
        return np.concatenate([state[2:], self.acceleration(t, state)])

    def _joined(self, t: float, state: Array) -> Array:
        force, response = self.holding_force(t, state)
        return np.concatenate([state[2:], self.acceleration(t, state) + force * response])

    def _gap(self, t: float, state: Array) -> float:
        del t
        return self.gap(state)

    def _force(self, t: float, state: Array) -> float:
        return self.holding_force(t, state)[0]

    def _struck(self, t: float, state: Array) -> tuple[Array, Phase]:
        after = self.pushed(state, self.restitution)
        parting = float(self.normal(after)[0] @ after[2:])
        if parting > STICKING_SPEED:
            return after, self.apart(parting)
        after = self.pushed(state, 0.0)
        return after, self.together() if self._force(t, after) > 0 else self.apart(STICKING_SPEED)

    def _parted(self, t: float, state: Array) -> tuple[Array, Phase]:
        del t
        return state, self.apart(STICKING_SPEED)


def pair_stage(setup: Setup) -> Stage:
    """Hang up the two balls, hold those that are displaced, and let go."""
    pair = PendulumPair.of(setup)
    start = np.array([setup["theta_1_0"], setup["theta_2_0"], 0.0, 0.0])
    gap = pair.gap(start)
    if setup["contact"] and gap < 0:
        raise DataError(f"the balls overlap by {-gap:.3g} m where they are held; change theta_1_0 or theta_2_0")
    first = pair.apart() if setup["contact"] else pair.never_touching()
    motion = integrate(first, start, setup["release_time"], max(setup.duration_s, setup["release_time"]) + 1.0)
    pivots = [(float(x), 0.0) for x in pair.pivot_x]
    paths = [hanging(motion.state(k), constant(float(pair.length[k])), pivots[k]) for k in range(2)]
    side = float((pair.length + pair.radius).max()) + 0.07
    view = CameraView(-side, side, 0.01 - side, 0.06 if max(abs(start[:2])) < 1.7 else side)
    return Stage(
        view=view,
        wall=Wall((112.0, 112.0, 112.0), glossy=True),
        props=_props(setup, view),
        layers=tuple(_layers(setup, pair, paths, pivots, start)),
        bodies=tuple(_body(k, paths[k], pair, motion) for k in range(2)),
        stated=stated(setup, PARAMETERS),
        phase=motion.phase,
        happened=motion.happened,
    )


def _body(k: int, path: Path, pair: PendulumPair, motion: SceneMotion) -> SceneBody:
    observed = {"theta_rad": motion.state(k), "omega_rad_s": motion.state(k + 2)}
    return SceneBody(str(k + 1), path, float(pair.radius[k]), observed)


def _props(setup: Setup, view: CameraView) -> tuple[Layer, ...]:
    marks = tape([(-0.47, -0.09), (0.51, -0.12), (-0.36, -0.33), (-0.20, -0.47), (0.36, -0.32), (0.26, -0.46)])
    stand = clamp(0.0, 0.0, view.top + 0.05) if setup.look.clamp else []
    return (*(marks if setup.look.marks else []), *stand)


def _layers(
    setup: Setup, pair: PendulumPair, paths: list[Path], pivots: list[tuple[float, float]], start: Array
) -> list[Layer]:
    behind, middle, before = list[Layer](), list[Layer](), list[Layer]()
    for k, colour in enumerate((DARK, LIGHT)):
        radius = float(pair.radius[k])
        if setup.look.cord:
            behind.append(cord(paths[k], pivots[k], float(pair.length[k]), CORD_WIDTH_M))
        middle += ball(paths[k], radius, colour, setup)
        if start[k] != 0:
            back, front = holding_hand(paths[k], pivots[k], radius, setup)
            behind, before = behind + back, before + front
    return behind + middle + before


def same_angles(degrees: float, *, both: bool) -> dict[str, float]:
    """Initial angles of a setting: both balls out, or the left one only."""
    theta = math.radians(degrees)
    return {"theta_1_0": -theta, "theta_2_0": theta if both else 0.0}


def accepted(forces: Mapping[str, str]) -> dict[str, str]:
    """The effects that the pair knows, with their meaning."""
    return {name: forces[name] for name in EFFECTS}

"""Image model of a disc in front of a background: area coverage, blurred edge, shading, motion within the exposure."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from iris_sysid.types import Array
from trackers._disc.normal_equations import Scene, cover, equations, gauss_newton, jacobian, levels
from trackers._disc.robust_least_squares import ROUNDS, Equations, Pixels, Rest, Start

X, Y, RADIUS, BLUR, OVAL_ALONG, OVAL_ACROSS = range(6)  # the first parameters; the grey levels follow
MIN_BLUR = 0.004  # px^2, variance of the sharpest edge
FIRST_BLUR = 0.1  # px^2, variance of the edge at the start
MIN_RADIUS = 0.8  # px, radius
SUBSTEP = 1.5  # px of motion between two positions within the exposure
MAX_SUBSTEPS = 16


@dataclass(frozen=True, slots=True)
class Disc:
    """Where a disc is: centre and radius, px, and their standard errors (NaN where not fitted).

    ``blur`` is the variance of its edge, px^2; ``oval`` the parts of the radius by which it varies as cos 2 phi and
    sin 2 phi (detector, rolling shutter); ``contrast`` against the surroundings and ``intensity``, in grey levels, are
    means along the outline.
    """

    x: float
    y: float
    radius: float
    sigma_x: float = float("nan")
    sigma_y: float = float("nan")
    sigma_radius: float = float("nan")
    blur: float = FIRST_BLUR
    oval: tuple[float, float] = (0.0, 0.0)
    contrast: float = 0.0
    intensity: float = 0.0


@dataclass(frozen=True, slots=True)
class Motion:
    """By how much centre and radius change within one exposure, px.

    ``bend_x``, ``bend_y`` are the acceleration, px per exposure squared: by a 24th of it the mean position over the
    exposure is off the one at its middle.
    """

    x: float = 0.0
    y: float = 0.0
    radius: float = 0.0
    bend_x: float = 0.0
    bend_y: float = 0.0

    @property
    def length(self) -> float:
        """Farthest that a part of the outline moves, px."""
        return float(np.hypot(self.x, self.y) + abs(self.radius))

    @property
    def way(self) -> Array:
        """All of it (5,): x, y, radius, bend_x, bend_y. In px."""
        return np.array([self.x, self.y, self.radius, self.bend_x, self.bend_y])


@dataclass(frozen=True, slots=True)
class Form:
    """Free parameters besides centre, radius and blur.

    ``interior`` of the terms 1, u, v, u^2 + v^2 - 1, u^2 - v^2, u v shade the body, ``exterior`` of them its
    surroundings; with ``known_background`` these come on top of the background image. ``oval`` lets the radius vary.
    """

    interior: int = 1
    exterior: int = 1
    known_background: bool = True
    oval: bool = False

    @property
    def outline(self) -> int:
        """Number of parameters of the outline: they come first."""
        return OVAL_ACROSS + 1 if self.oval else BLUR + 1

    @property
    def count(self) -> int:
        """Number of parameters."""
        return self.outline + self.interior + self.exterior


@dataclass(eq=False, slots=True)
class DiscModel:
    """Grey levels of some pixels (n,) at ``x``, ``y`` px of the frame, before a ``background`` (n,)."""

    x: Array
    y: Array
    background: Array
    origin: Disc
    form: Form
    motion: Motion
    terms: Array = field(init=False)
    share: Array = field(init=False)
    slopes: Array = field(init=False)
    contrast: Array = field(init=False)

    def __post_init__(self) -> None:
        """Work out the terms of the shading (n, 6) in u, v = distance from the origin over its radius."""
        self.share, self.slopes, self.contrast = (
            np.empty(self.x.size),
            np.empty((self.x.size, 6)),
            np.empty(self.x.size),
        )
        u = (self.x - self.origin.x) / self.origin.radius
        v = (self.y - self.origin.y) / self.origin.radius
        self.terms = np.column_stack([np.ones_like(u), u, v, u**2 + v**2 - 1, u**2 - v**2, u * v])

    def start(self, values: Array) -> Start:
        """Parameters to start from: the levels inside and outside by the median of the ``values`` (n,).

        Levels are grey levels.
        """
        origin, outline = self.origin, self.form.outline
        parameters = np.zeros(self.form.count)
        parameters[:outline] = (origin.x, origin.y, origin.radius, origin.blur, *origin.oval)[:outline]
        self._cover(parameters[:outline])
        inside, outside = self.share > 0.5, self.share < 0.5
        parameters[outline] = np.median(values[inside]) if inside.any() else values.mean()
        level = np.median((values - self.background)[outside]) if outside.any() else 0.0
        parameters[outline + self.form.interior] = level
        longest, lowest = np.full(parameters.size, np.inf), np.full(parameters.size, -np.inf)
        longest[:outline] = np.array([0.3 * origin.radius] * 3 + [0.5 + origin.blur, 0.1, 0.1])[:outline]
        lowest[[RADIUS, BLUR]] = (MIN_RADIUS, MIN_BLUR)
        return Start(parameters, longest, lowest)

    def equations(self, parameters: Array, pixels: Pixels, sigma: Array, number: int) -> Equations:
        """Normal equations of the grey levels by the ``parameters`` (p,).

        ``pixels`` holds the grey levels that are fitted, ``sigma`` (n,) their noise in grey levels; ``number`` is that
        of the round.
        """
        work = self._work()
        of_zones, _ = equations(self._scene, (pixels.values, sigma, pixels.zone), number, parameters, work)
        return Equations(of_zones, *work[-2:])

    def round(self, start: Start, pixels: Pixels, sigma: Array, number: int) -> Rest:
        """Gauss-Newton steps of the grey levels with the weights of one round; see :meth:`equations`."""
        work, data, bounds = self._work(), (pixels.values, sigma, pixels.zone), (start.longest_step, start.lowest)
        parameters, step, of_zones, _ = gauss_newton(
            self._scene, data, (number, *ROUNDS[number]), bounds, start.parameters, work
        )
        return Rest(parameters, step, Equations(of_zones, *work[-2:]), sigma)

    def jacobian(self) -> Array:
        """Derivatives (n, p) of the grey levels by the parameters of the latest equations.

        In grey levels per px or per unit of a level.
        """
        return np.asarray(jacobian(self.share, self.slopes, self.contrast, self.terms, self._counts))

    def contrast_of(self, parameters: Array) -> tuple[float, float]:
        """Mean of body minus surroundings, and of the body, along the outline of the latest equations, in grey levels.

        ``parameters`` (p,) hold the levels.
        """
        edge = self.share * (1 - self.share) + 1e-9
        body, surroundings = self._levels(parameters)
        return float(np.average(body - surroundings, weights=edge)), float(np.average(body, weights=edge))

    @property
    def _counts(self) -> NDArray[np.int64]:
        return np.array([self.form.outline, self.form.interior, self.form.exterior])

    @property
    def _scene(self) -> Scene:
        """Pixels, background, terms and motion: see :func:`equations`."""
        parts = min(max(math.ceil(self.motion.length / SUBSTEP), 1), MAX_SUBSTEPS)
        return self.x, self.y, self.background, self.terms, self._counts, self.motion.way, parts

    def _work(self) -> tuple[Array, Array, Array, Array, Array]:
        """What the kernels set: share, slopes, contrast, and residual and weight (n,) of the pixels."""
        return self.share, self.slopes, self.contrast, np.empty_like(self.x), np.empty_like(self.x)

    def _levels(self, parameters: Array) -> tuple[Array, Array]:
        """Grey levels (n,) of the body and of the background behind it."""
        inside, outside = np.split(parameters[self.form.outline :], [self.form.interior])
        body, surroundings = np.empty((2, self.x.size))
        levels(self.terms, self.background, inside, outside, body, surroundings)
        return body, surroundings

    def _cover(self, outline: Array) -> None:
        """Set the share (n,) of each pixel that the moving disc covers in the mean, and its derivatives (n, 6)."""
        cover(self.x, self.y, outline, *self._scene[-2:], self.share, self.slopes)

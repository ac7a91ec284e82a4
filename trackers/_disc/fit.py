"""Disc fitted to the pixels round it; its standard error allows for noise correlated between neighbouring pixels."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from iris_sysid.types import Array
from trackers._disc.edge_coverage import edge_reach
from trackers._disc.model import BLUR, OVAL_ALONG, RADIUS, Disc, DiscModel, Form, Motion, X, Y
from trackers._disc.robust_least_squares import TUKEY, Labels, Pixels, RobustSolution, robust_fit
from trackers._frames.arrays import Box, Bytes, Flags, Image
from trackers._uncertainty.error_correlation import lobe_amplitudes
from trackers._uncertainty.pixel_correlation import variance_of_sum

INWARDS = (4.0, 0.25, 12.0)  # px, of the radius, px: how far inside of the outline the body's shading must hold
OUTWARDS = 6.0  # px outside of the outline in which the background must hold
MARGIN = 2.0  # px round the pixels that count
MIN_PIXELS = 20
MAX_FLAT = 4000  # pixels away from the edge that count: more do not help
MAX_EDGE = 100_000  # pixels of the edge: a disc has fewer; another body, whose edge gets ever softer, takes 60 MB
MAX_ROUGH = 2000  # pixels of a wide edge, and as many away from it, that find it to a fraction of its width
THINNED, MIN_THINNED = 4, 300  # every fourth pixel leads near the best fit, if this many remain
MAX_SHIFT = (2.0, 0.6)  # px, of the radius: how far a fit may go from where the disc was expected
RADIUS_RATIO = 1.7  # of the radius expected and fitted
MAX_BLUR = 0.5  # of the radius: standard deviation of the blur
MAX_OVAL = 0.3  # of the radius
MIN_OUTLINE = 0.5  # of the pixels on the outline must show it
LAST_STEP = 0.5  # of the standard errors of centre and radius
MAX_ERROR = 0.15  # of the radius
MIN_CONTRAST = 3.0  # grey levels


@dataclass(frozen=True, eq=False, slots=True)
class Cutout:
    """Grey levels (h, w) of a part of the image whose corner is (left, top): frame, background, noise.

    ``usable`` (h, w) is false where another body is. ``travel`` is how far, px, the outline may move within the
    exposure: the pixels that count reach as far.
    """

    image: Image
    background: Image
    noise: Image
    usable: Flags
    left: int
    top: int
    travel: float = 0.0

    def distance(self, disc: Disc) -> Array:
        """Distance (h, w) of each pixel to the outline of a disc, px, positive inside."""
        rows, columns = np.ogrid[: self.image.shape[0], : self.image.shape[1]]
        squared = (columns + self.left - disc.x) ** 2 + (rows + self.top - disc.y) ** 2
        return disc.radius - np.sqrt(squared)  # several times as fast as np.hypot


@dataclass(frozen=True, eq=False, slots=True)
class SeenDisc:
    """A disc as it is seen in a frame.

    ``lobes`` are the lobes of the outline that the disc does not have, px. ``sigma_lobe`` is the standard deviation of
    one by white noise as large as beside the outline, px: a coder leaves more at the outline itself.
    """

    disc: Disc
    lobes: tuple[float, ...] = ()
    sigma_lobe: float = 0.0


@dataclass(frozen=True, eq=False, slots=True)
class DiscFit:
    """A fitted disc and its pixels: rows and columns in the cutout of the pixels that count."""

    seen: SeenDisc
    solution: RobustSolution
    rows: Labels
    columns: Labels

    @property
    def disc(self) -> Disc:
        """The disc."""
        return self.seen.disc

    @property
    def outline_share(self) -> float:
        """Share of the outline that agrees with the model, by weight in the estimate of the radius."""
        tells = self.solution.jacobian[:, RADIUS] ** 2
        return float((self.solution.weight * tells).sum() / max(float(tells.sum()), 1e-9))

    @property
    def aic(self) -> float:
        """Akaike's information criterion a pixel, up to a constant: -2 log likelihood + 2 p, over n.

        The likelihood is the one whose weight function is Tukey's biweight.
        """
        solution = self.solution
        cost = TUKEY**2 / 3 * (1 - solution.weight**1.5) + 2 * np.log(solution.sigma)
        return float(cost.mean()) + 2 * solution.parameters.size / cost.size


def box_about(disc: Disc, travel: float, region: Box) -> Box:
    """The part of a region of the frame whose pixels may count for a disc that travels so far, px; it may be empty."""
    reach = disc.radius + band(disc, travel)[2] + MARGIN
    left, top, right, bottom = region
    return (
        max(left, int(disc.x - reach)),
        max(top, int(disc.y - reach)),
        min(right, int(disc.x + reach) + 2),
        min(bottom, int(disc.y + reach) + 2),
    )


def image_cutout(image: Bytes, disc: Disc) -> Cutout:
    """The part of an image (h, w) of unknown background and noise that counts for a disc at rest."""
    left, top, right, bottom = box_about(disc, 0.0, (0, 0, image.shape[1], image.shape[0]))
    grey = image[top : max(top, bottom), left : max(left, right)].astype(np.float32)
    return Cutout(grey, np.zeros_like(grey), np.ones_like(grey), np.ones(grey.shape, dtype=np.bool_), left, top)


def shows_disc(fitted: DiscFit, expected: Disc) -> bool:
    """Whether a fit is valid: near the expected disc, along most of its outline, and well determined."""
    disc = fitted.disc
    away = float(np.hypot(disc.x - expected.x, disc.y - expected.y))
    near = away <= max(MAX_SHIFT[0], MAX_SHIFT[1] * expected.radius)
    alike = 1 / RADIUS_RATIO < disc.radius / expected.radius < RADIUS_RATIO
    round_ = np.sqrt(disc.blur) < MAX_BLUR * disc.radius and np.hypot(*disc.oval) < MAX_OVAL
    shown = fitted.outline_share > MIN_OUTLINE and abs(disc.contrast) > MIN_CONTRAST
    return bool(near and alike and round_ and shown and _is_sure(fitted))


def _is_sure(fitted: DiscFit) -> bool:
    """Whether centre and radius are well determined, and the fit came to rest."""
    errors = np.array([fitted.disc.sigma_x, fitted.disc.sigma_y, fitted.disc.sigma_radius])
    settled = np.abs(fitted.solution.last_step[: RADIUS + 1]) < LAST_STEP * errors
    return bool(np.isfinite(errors).all() and (errors < MAX_ERROR * fitted.disc.radius).all() and settled.all())


def band(disc: Disc, travel: float) -> tuple[float, float, float]:
    """How far about an outline its edge shows, and how far inside and outside of it the pixels count, px.

    ``travel`` is how far the outline of the ``disc`` moves within the exposure, px.
    """
    reach = edge_reach(disc.blur) + travel / 2
    least, share, most = INWARDS
    return reach, reach + min(least + share * disc.radius, most), reach + OUTWARDS


def fit_disc(
    cutout: Cutout,
    start: Disc,
    form: Form,
    motion: Motion,
    correlation: Array | None = None,
    *,
    roughly: bool = False,
) -> DiscFit | None:
    """Fit a disc to a cutout; None when the pixels do not show one there.

    A pixel covered by the share a shows a F + (1 - a) B. The coverage is that of a straight edge (:mod:`_edge`),
    its distance corrected for the curvature of the circle over the pixel and the blur,

        d = r - rho - (v + 1/12) / (2 rho),

    averaged over the positions within the exposure. F and B are polynomials in the distance from the start over
    its radius. Standard errors: S = H^-1 J'W, H = J'WJ and var = S C S', where C holds the noise measured by the
    residuals and its correlation between neighbouring pixels.

    Parameters
    ----------
    cutout
        Pixels round the disc.
    start
        Where it is, to about a third of its radius.
    form
        Which shading is free.
    motion
        Of the disc within the exposure.
    correlation
        (2m + 1, 2m + 1) correlation of the noise of two pixels by their distance in rows and columns; None
        when it is white.
    roughly
        Whether few pixels do, for a start.
    """
    rows, columns, zone = _chosen(cutout, start, roughly=roughly)
    if rows.size < MIN_PIXELS + form.count:
        return None
    values, background, noise = (
        image[rows, columns].astype(np.float64) for image in (cutout.image, cutout.background, cutout.noise)
    )
    if not form.known_background:
        background = np.zeros_like(background)
    x, y = (columns + cutout.left).astype(np.float64), (rows + cutout.top).astype(np.float64)
    model, pixels = DiscModel(x, y, background, start, form, motion), Pixels(values, noise, zone)
    few = (
        (rows + 2 * columns) % THINNED == 0 if rows.size > THINNED * MIN_THINNED else np.ones(rows.size, dtype=np.bool_)
    )
    rough = DiscModel(x[few], y[few], background[few], start, form, motion)
    try:
        first = rough.start(values[few])
        solution = robust_fit(model, first, pixels, (rough, Pixels(values[few], noise[few], zone[few])))
    except np.linalg.LinAlgError:
        return None
    disc = _disc_of(solution, model)
    share = np.where(zone == 1, solution.weight, 0.0) / (disc.contrast or 1.0)  # of the outline alone
    offset = (x - disc.x) + 1j * (y - disc.y)
    lobes = lobe_amplitudes(share * solution.residual, offset, disc.radius)
    beside = solution.sigma[zone != 1] if (zone != 1).any() else solution.sigma
    sigma_lobe = float(np.median(beside) * np.linalg.norm(share)) / (np.sqrt(2) * np.pi * disc.radius)
    return with_errors(DiscFit(SeenDisc(disc, lobes, sigma_lobe), solution, rows, columns), correlation)


def _chosen(cutout: Cutout, start: Disc, *, roughly: bool) -> tuple[Labels, Labels, Labels]:
    """Rows, columns and zone (0 outside, 1 edge, 2 inside) of the pixels that count."""
    distance = cutout.distance(start)
    edge, inwards, outwards = band(start, cutout.travel)
    near_edge = np.abs(distance) < edge
    chosen = (distance < inwards) & (distance > -outwards) & cutout.usable
    _thin(chosen, ~near_edge, MAX_ROUGH if roughly else MAX_FLAT)
    _thin(chosen, near_edge, MAX_ROUGH if roughly else MAX_EDGE)
    zone = np.where(near_edge, 1, np.where(distance > 0, 2, 0))
    rows, columns = np.nonzero(chosen)
    return rows, columns, zone[chosen]


def _thin(chosen: Flags, part: Flags, most: int) -> None:
    """Leave about that many of the chosen pixels (h, w) of a part, evenly spread."""
    places = np.flatnonzero(chosen & part)
    chosen.ravel()[np.delete(places, np.s_[:: max(1, places.size // most)])] = False


def _disc_of(solution: RobustSolution, model: DiscModel) -> Disc:
    x, y, radius, blur = (float(value) for value in solution.parameters[: BLUR + 1])
    along, across = solution.parameters[OVAL_ALONG : model.form.outline] if model.form.oval else (0.0, 0.0)
    contrast, intensity = model.contrast_of(solution.parameters)
    return Disc(x, y, radius, blur=blur, oval=(float(along), float(across)), contrast=contrast, intensity=intensity)


def with_errors(fitted: DiscFit, correlation: Array | None) -> DiscFit:
    """The fit with the standard errors of its centre and radius, for noise of this ``correlation`` of pixels."""
    rows, columns = fitted.rows - fitted.rows.min(), fitted.columns - fitted.columns.min()
    errors = []
    for score in fitted.solution.scores(RADIUS + 1).T:
        image = np.zeros((int(rows.max()) + 1, int(columns.max()) + 1))
        image[rows, columns] = score
        errors.append(float(np.sqrt(variance_of_sum(image, correlation))))
    disc = replace(fitted.disc, sigma_x=errors[X], sigma_y=errors[Y], sigma_radius=errors[RADIUS])
    return replace(fitted, seen=replace(fitted.seen, disc=disc))

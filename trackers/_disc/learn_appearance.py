"""Appearance of a disc learned from a few frames before all are fitted: shading, shutter, pixel noise."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from iris_sysid.types import Array, Frame
from trackers._disc.background import KnownBackground
from trackers._disc.expected_position import ExpectedPath
from trackers._disc.fit import Cutout, DiscFit, SeenDisc, band, box_about, fit_disc, shows_disc, with_errors
from trackers._disc.model import Disc, Form
from trackers._frames.ahead import ahead
from trackers._frames.working_image import WorkingView
from trackers._uncertainty.pixel_correlation import noise_correlation

SURROUNDINGS = tuple(
    Form(4, exterior, known, oval=True) for known, exterior in ((True, 1), (True, 3), (True, 4), (False, 3), (False, 4))
)
PLAIN = Form(3, 1)  # with which the shutter is found: an oval would take up a streak
INTERIORS = (1, 3, 4, 6)
ROOM = 2.0  # px of radius for each further term of the shading
MIN_OVAL_RADIUS = 5.0  # px: a smaller disc does not show whether it is oval
# frames; by five instead of eight the centres of two pendulums at 1280x720 change by 0.006 px rms, 0.15 of their error
FRAMES_STUDIED = 5
FRAMES_CORRELATED = 16  # from which the correlation of the pixels' noise is measured
FAST = 1.5  # px moved between two frames: slower motion does not show the shutter
TOO_FAST = 4.0  # radii moved between two frames: above this the path between them is unknown
MIN_FAST = 3  # frames
SHUTTERS = (0.0, 0.25, 0.5, 0.75, 1.0)  # exposure over the time between frames
FINER = (-0.12, -0.06, 0.0, 0.06, 0.12)  # about the best of them
FINEST = (-0.04, -0.02, 0.0, 0.02, 0.04)  # about the best of these, once the shading is known
CLEARER_AT_REST, CLEARER_MOVING = 1.0, 3.0  # times as sure must colour be as luma: it lags behind where bodies move
NOT_SEEN = -1e6  # worth of a fit that fails
WORST = 0.25  # of the frames: in these something else may be wrong
COUNTS = 0.5  # weight: a pixel with less is an outlier, neither disc nor surroundings
SOFT = 0.12  # of the radius: standard deviation of an outline that is far off, at the start
MOVED = 1.0  # px: a fit that ends farther from its start is repeated about its result
REPEATS = 3
GAP = 2.0  # px kept from another body
MIN_KNOWN = 0.8  # of the pixels outside of the outline: with fewer known ones the background counts as unknown


@dataclass(frozen=True, eq=False, slots=True)
class DiscAppearance:
    """How to fit a disc in this clip: its form, exposure over frame time, correlation of the noise, plane of colour.

    ``longest_shutter`` decides which pixels count, so that trials of the shutter are about the same pixels.
    """

    form: Form = SURROUNDINGS[0]
    shutter: float = 0.0
    longest_shutter: float = 0.0
    correlation: Array | None = None
    channel: int = 0


@dataclass(frozen=True, eq=False, slots=True)
class DiscFitter:
    """Fits discs to a frame: holds the region, its background, and the expected position of each body."""

    view: WorkingView
    background: KnownBackground
    expected_paths: Sequence[ExpectedPath]
    appearances: Mapping[int, DiscAppearance] = field(default_factory=dict)

    def fit(self, body: int, frame: Frame) -> DiscFit | None:
        """The disc of a body in the image of a frame; None where it is not expected or not seen."""
        expected = self.expected_paths[body].discs.get(frame.index)
        if expected is None:
            return None
        fitted = self._fit_from(body, frame, expected)
        if fitted is None:
            rough = self.rough(self._appearance_of(body), body, frame)
            fitted = None if rough is None else self._fit_from(body, frame, rough)
        return fitted if fitted is not None and shows_disc(fitted, expected) else None

    def seen(self, frame: Frame) -> tuple[int, list[SeenDisc | None]]:
        """Number of a frame, and the disc of each body in it."""
        fits = [self.fit(body, frame) for body in range(len(self.expected_paths))]
        return frame.index, [None if fitted is None else fitted.seen for fitted in fits]

    def rough(self, appearance: DiscAppearance, body: int, frame: Frame) -> Disc | None:
        """The disc of a plain fit with a soft outline at first, which finds an edge that is farther off; None if none.

        An expected path may be wrong by the width of a shadow.
        """
        expected = self.expected_paths[body].discs.get(frame.index)
        if expected is None:
            return None
        soft = replace(expected, blur=max(1.0, (SOFT * expected.radius) ** 2))
        fitted = self.fit_as(replace(appearance, form=PLAIN), body, frame, soft, roughly=True)
        return fitted.disc if fitted is not None and shows_disc(fitted, expected) else None

    def shows_plain(self, body: int, frame: Frame) -> bool:
        """Whether a plain fit finds the disc of a body in a frame, in luma or in colour."""
        planes = (DiscAppearance(channel=channel) for channel in range(3 if self.view.chroma else 1))
        return any(self.rough(appearance, body, frame) for appearance in planes)

    def _appearance_of(self, body: int) -> DiscAppearance:
        return self.appearances.get(body, DiscAppearance())

    def _fit_from(self, body: int, frame: Frame, start: Disc) -> DiscFit | None:
        """The disc fitted from a start, and again from each result until it converges; None where it is not seen."""
        fitted = None
        for _ in range(REPEATS):
            fitted = self.fit_as(self._appearance_of(body), body, frame, start)
            if fitted is None or not shows_disc(fitted, start):
                return None
            last, start = start, fitted.disc
            if max(abs(start.x - last.x), abs(start.y - last.y), abs(start.radius - last.radius)) < MOVED:
                break
        return fitted

    def fit_as(
        self, appearance: DiscAppearance, body: int, frame: Frame, start: Disc | None = None, *, roughly: bool = False
    ) -> DiscFit | None:
        """One fit with an appearance of one's own, from ``start`` or from where the disc is expected, shown or not.

        ``roughly``: by few pixels, for a start.
        """
        start = start or self.expected_paths[body].discs.get(frame.index)
        if start is None:
            return None
        expected_path = self.expected_paths[body]
        motion = longest = expected_path.motion(frame.index, appearance.shutter)
        if appearance.longest_shutter > appearance.shutter:
            longest = expected_path.motion(frame.index, appearance.longest_shutter)
        cutout, form = self._cutout(body, frame, appearance, start, longest.length)
        if cutout is None:
            return None
        return fit_disc(cutout, start, form, motion, appearance.correlation, roughly=roughly)

    def _cutout(
        self, body: int, frame: Frame, appearance: DiscAppearance, start: Disc, travel: float
    ) -> tuple[Cutout | None, Form]:
        """The pixels round a disc that travels so far, px, and its form; None when it lies outside of the image.

        Where much of the background was never seen, it counts as unknown.
        """
        left, top, right, bottom = box_about(start, travel, self.view.box)
        if right - left < 3 or bottom - top < 3:
            return None, appearance.form
        box = (left - self.view.left, top - self.view.top, right - self.view.left, bottom - self.view.top)
        background, noise, known = self.background.patch(box[1], box[3], box[0], box[2])
        view = self.view if appearance.channel else replace(self.view, chroma=False)
        grey = view.part(frame, box).astype(np.float32)
        planes = [np.atleast_3d(part)[..., appearance.channel] for part in (grey, background, noise)]
        cutout = Cutout(planes[0], planes[1], planes[2], known, left, top, travel)
        edge, _, _ = band(start, travel)
        outside = cutout.distance(start) < edge
        form = appearance.form
        if form.known_background and known[outside].mean() < MIN_KNOWN:
            form = replace(form, exterior=max(form.exterior, 3), known_background=False)
        usable = known | ~outside if form.known_background else np.ones_like(known)
        for other in self._others(body, frame.index):
            usable &= cutout.distance(other) < -GAP
        return replace(cutout, usable=usable), form

    def _others(self, body: int, number: int) -> list[Disc]:
        expected_paths = [expected_path for k, expected_path in enumerate(self.expected_paths) if k != body]
        return [expected_path.discs[number] for expected_path in expected_paths if number in expected_path.discs]


def with_learned_appearance(fitter: DiscFitter, frames: Iterable[Frame]) -> DiscFitter:
    """The fitter with the appearance of each body, learned from frames spread over the clip."""
    sampled = {frame.index: frame for frame in frames}
    appearances = {body: _appearance_of(fitter, body, sampled) for body in range(len(fitter.expected_paths))}
    return replace(fitter, appearances=appearances)


def _appearance_of(fitter: DiscFitter, body: int, frames: Mapping[int, Frame]) -> DiscAppearance:
    """The plane of colour first, then the shutter, which shows before any shading does, the shading, the noise."""
    expected_path = fitter.expected_paths[body]
    seen = sorted(number for number in frames if number in expected_path.discs)
    if not seen:
        return DiscAppearance()
    spread = _spread(seen, FRAMES_STUDIED)
    radius = float(np.median([expected_path.discs[number].radius for number in seen]))
    trials = _Trials(fitter, body, frames, radius)
    speed = {number: expected_path.motion(number, 1.0).length for number in seen}
    moves = float(np.median(list(speed.values()))) > FAST
    appearance = _plane(trials, spread, CLEARER_MOVING if moves else CLEARER_AT_REST)
    fast = sorted(
        (number for number in seen if FAST < speed[number] < TOO_FAST * radius), key=lambda number: -speed[number]
    )[:FRAMES_STUDIED]
    if len(fast) >= MIN_FAST:
        appearance = replace(appearance, form=PLAIN, longest_shutter=max(SHUTTERS))
        for shutters, beyond in ((SHUTTERS, 2), (FINER, 1)):
            trial = _with_shutters(appearance, shutters)
            appearance = trials.climbed(trial, appearance.shutter, fast, beyond=beyond, shown=False)
    appearance = _shaded(trials, replace(appearance, longest_shutter=appearance.shutter), spread)
    if len(fast) >= MIN_FAST:
        longest = min(max(SHUTTERS), appearance.shutter + max(FINEST))
        appearance = replace(appearance, longest_shutter=longest)
        appearance = trials.climbed(_with_shutters(appearance, FINEST), appearance.shutter, fast, beyond=1)
    appearance = replace(appearance, longest_shutter=0.0)
    return replace(appearance, correlation=trials.correlation(appearance, _spread(seen, FRAMES_CORRELATED)))


def _spread(numbers: Sequence[int], count: int) -> list[int]:
    """About that many of some numbers, evenly spread."""
    return [numbers[k] for k in np.unique(np.linspace(0, len(numbers) - 1, count).astype(int))]


def _plane(trials: _Trials, numbers: Sequence[int], clearer: float) -> DiscAppearance:
    """The plane that gives the most precise centre, with the noise of neighbouring pixels correlated.

    A plane of colour must be ``clearer`` times as precise as luma: it is coded at half the size, and where a body
    moves the coder leaves it behind by more than the noise shows.
    """
    appearances = [DiscAppearance(channel=channel) for channel in range(trials.channels)]
    if len(appearances) == 1:
        return appearances[0]
    scores = []
    for appearance in appearances:
        fits = trials.fits(appearance, numbers)
        correlation = _correlation_of(trials.shown(fits, numbers))
        alike = [fitted and with_errors(fitted, correlation) for fitted in fits]
        scores.append([precision(fitted) for fitted in trials.shown(alike, numbers)])
    score = _mean_of_most(np.array(scores).T) - 2 * np.log(clearer) * (np.arange(len(scores)) > 0)
    return appearances[int(np.argmax(score))]


def _with_shutters(appearance: DiscAppearance, steps: Sequence[float]) -> list[DiscAppearance]:
    """The appearance with its shutter longer by each of some steps, as far as a shutter can be."""
    shutters = [appearance.shutter + step for step in steps]
    return [replace(appearance, shutter=shutter) for shutter in shutters if 0 <= shutter <= max(SHUTTERS)]


def _shaded(trials: _Trials, appearance: DiscAppearance, numbers: Sequence[int]) -> DiscAppearance:
    """The appearance with the surroundings, then the shading of the body, for which the frames speak."""
    appearance = trials.best([replace(appearance, form=form) for form in SURROUNDINGS], numbers, evidence)
    room = 1 + trials.radius / ROOM
    forms = [replace(appearance.form, interior=interior) for interior in INTERIORS if interior <= room]
    appearance = trials.best([replace(appearance, form=form) for form in forms], numbers, evidence)
    forms = [
        replace(appearance.form, oval=oval) for oval in (False, True) if not oval or trials.radius >= MIN_OVAL_RADIUS
    ]
    return trials.best([replace(appearance, form=form) for form in forms], numbers, evidence)


def precision(fitted: DiscFit | None) -> float:
    """Precision of the fitted centre: log of its inverse variance; nearly zero precision where the disc is not seen."""
    if fitted is None:
        return NOT_SEEN
    return -float(np.log(fitted.disc.sigma_x**2 + fitted.disc.sigma_y**2))


def evidence(fitted: DiscFit | None) -> float:
    """Quality of a fit less the penalty of its parameters; very low where the disc is not seen."""
    return NOT_SEEN if fitted is None else -fitted.aic


@dataclass(frozen=True, eq=False, slots=True)
class _Trials:
    """One body, of about that radius (px), in some frames."""

    fitter: DiscFitter
    body: int
    frames: Mapping[int, Frame]
    radius: float
    starts: dict[tuple[int, int], Disc | None] = field(default_factory=dict)
    scores: dict[tuple[object, ...], float] = field(default_factory=dict)

    @property
    def channels(self) -> int:
        """How many planes of colour the images have."""
        return 3 if self.fitter.view.chroma else 1

    def fits(
        self, appearance: DiscAppearance, numbers: Sequence[int], *, roughly: bool = False
    ) -> list[DiscFit | None]:
        """The fits that an appearance gives in some frames; ``roughly``: by few pixels."""

        def fit(number: int) -> DiscFit | None:
            start = self._start(appearance, number)
            return self.fitter.fit_as(appearance, self.body, self.frames[number], start, roughly=roughly)

        return list(ahead(fit, numbers))

    def shown(self, fits: Sequence[DiscFit | None], numbers: Sequence[int]) -> list[DiscFit | None]:
        """Those fits that are surely of a disc, None for the others; ``numbers`` are those of their frames."""
        discs = self.fitter.expected_paths[self.body].discs
        pairs = zip(fits, numbers, strict=True)
        return [fitted if fitted and shows_disc(fitted, discs[number]) else None for fitted, number in pairs]

    def _start(self, appearance: DiscAppearance, number: int) -> Disc | None:
        """Where a fit begins: at the disc that a plain one finds in that plane, where it finds one."""
        key = (appearance.channel, number)
        if key not in self.starts:
            plain = DiscAppearance(channel=appearance.channel)
            self.starts[key] = self.fitter.rough(plain, self.body, self.frames[number])
        return self.starts[key]

    def correlation(self, appearance: DiscAppearance, numbers: Sequence[int]) -> Array | None:
        """Correlation of the noise of neighbouring pixels that the fits of some frames leave."""
        return _correlation_of(self.shown(self.fits(appearance, numbers), numbers))

    def score(
        self,
        appearances: Sequence[DiscAppearance],
        numbers: Sequence[int],
        score: Callable[[DiscFit | None], float],
        *,
        shown: bool = True,
    ) -> Array:
        """Score of each appearance: the mean over the frames but the worst; if not ``shown``, of rough fits."""
        values = [self._scores(appearance, numbers, score, shown=shown) for appearance in appearances]
        return _mean_of_most(np.array(values).T)

    def _scores(
        self,
        appearance: DiscAppearance,
        numbers: Sequence[int],
        score: Callable[[DiscFit | None], float],
        *,
        shown: bool,
    ) -> list[float]:
        """Score of the fit in each frame; the best of some appearances is among the next ones and not fitted again."""
        how = (appearance.form, appearance.shutter, appearance.longest_shutter, appearance.channel)
        keys = [(*how, id(appearance.correlation), number, score, shown) for number in numbers]
        new = [number for number, key in zip(numbers, keys, strict=True) if key not in self.scores]
        fits = self.fits(appearance, new, roughly=not shown)
        scores = iter(map(score, self.shown(fits, new) if shown else fits))
        self.scores.update({key: next(scores) for key in keys if key not in self.scores})
        return [self.scores[key] for key in keys]

    def climbed(
        self,
        appearances: Sequence[DiscAppearance],
        start: float,
        numbers: Sequence[int],
        *,
        beyond: int,
        shown: bool = True,
    ) -> DiscAppearance:
        """The appearance with more evidence than the ``beyond`` next ones on either side, reached step by step.

        Along the shutter evidence has one maximum, and long shutters take longest to fit. ``start`` is the shutter of
        the first one.
        """

        def worth(k: int) -> float:
            return float(self.score([appearances[k]], numbers, evidence, shown=shown)[0])

        at = [appearance.shutter for appearance in appearances].index(start)
        while True:
            near = range(max(0, at - beyond), min(len(appearances), at + beyond + 1))
            best = max((at, *near), key=worth)
            if best == at:
                return appearances[at]
            at = best

    def best(
        self,
        appearances: Sequence[DiscAppearance],
        numbers: Sequence[int],
        score: Callable[[DiscFit | None], float],
        *,
        shown: bool = True,
    ) -> DiscAppearance:
        """The appearance that is worth most; the first of equals."""
        if len(appearances) == 1:
            return appearances[0]
        return appearances[int(np.argmax(self.score(appearances, numbers, score, shown=shown)))]


def _mean_of_most(scores: Array) -> Array:
    """Mean (a,) of scores (n, a) over the frames but the worst."""
    return np.asarray(np.sort(scores, axis=0)[int(WORST * len(scores)) :].mean(axis=0))


def _correlation_of(fits: Sequence[DiscFit | None]) -> Array | None:
    return noise_correlation(_standardised(fitted) for fitted in fits if fitted)


def _standardised(fitted: DiscFit) -> tuple[Array, Array]:
    """Residuals over their sigma, and which are known, as images about the disc; foreign pixels are left out."""
    rows, columns = fitted.rows - fitted.rows.min(), fitted.columns - fitted.columns.min()
    residual, known = np.zeros((2, int(rows.max()) + 1, int(columns.max()) + 1))
    counts = fitted.solution.weight > COUNTS
    residual[rows[counts], columns[counts]] = (fitted.solution.residual / fitted.solution.sigma)[counts]
    known[rows[counts], columns[counts]] = 1.0
    return residual, known

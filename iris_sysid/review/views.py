"""What the page shows, as JSON: clip, tracks, request, questions, and the fit with what it changed."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from iris_sysid.errors import DataError
from iris_sysid.io.json_documents import read_document
from iris_sysid.io.schemas import DiagnosisDocument
from iris_sysid.registry import PHENOMENA
from iris_sysid.report.component_colours import NOISE_COLOUR, SHADES, SIDE_COLOURS, shades_of
from iris_sysid.report.text import shown_estimates, shown_unit, verdict_lines, with_error
from iris_sysid.report.typeset import typeset
from iris_sysid.review.corrected_tracks import edited_mask, in_frame_px
from iris_sysid.review.doubtful_frames import questions_of
from iris_sysid.review.fit_queue import FitOutcome
from iris_sysid.review.request import ReviewRequest
from iris_sysid.review.session import Session
from iris_sysid.types import KIND_NAMES, Array, FitResult, Mask, Run, Track

DIAGNOSES = ("diagnosis/diagnosis.json", "diagnosis.json")  # in the folder, the usual place first


def state_view(session: Session, known: Sequence[Track] = ()) -> dict[str, Any]:
    """The state of a session; of tracks among ``known``, which the page has already, the name alone."""
    state = session.state
    return {
        "version": session.version,
        "saved": session.saved_version,
        "can_undo": session.history.can_undo,
        "can_redo": session.history.can_redo,
        "tracks": [
            {"body": track.body} if any(track is old for old in known) else _track(track) for track in state.tracks
        ],
        "request": {**_request(state.request), "scale_points": session.scale_points},
        "tracking": tracking_view(session),
    }


def clip_view(session: Session) -> dict[str, Any]:
    """What does not change: the clip, its times, the phenomena that there are, and the parts of the residual."""
    video = session.video
    times = video.frame_times
    return {
        "name": session.clip.name,
        "folder": str(session.folder),
        "width": video.width,
        "height": video.height,
        "frames": session.n_frames,
        "times": _numbers(np.array(times), 6),
        "phenomena": PHENOMENA.summaries(),
        "parts": residual_parts(session.folder),
    }


def tracking_view(session: Session) -> dict[str, Any]:
    """What the tracker is doing."""
    now = session.tracking
    return {"running": now.running, "done": now.done, "expected": now.expected, "problem": now.problem}


def fit_view(session: Session, outcome: FitOutcome) -> dict[str, Any]:
    """The fit of a version beside the fit before it, its curves, and the questions about the tracks."""
    run, state, before = outcome.run, session.state, session.fits.before
    fit, trajectory = (None, None) if run is None else (run.fit, run.trajectory)
    questions = questions_of(
        state.tracks, fit, trajectory, state.confirmed, (session.video.width, session.video.height)
    )
    return {
        "version": outcome.version,
        "problem": outcome.problem,
        "seconds": round(outcome.seconds, 3),
        "preview": outcome.every > 1,
        "verdict": [] if fit is None else _verdict_text(fit),
        "word": "" if fit is None else fit.verdict.word,
        "equation": "" if fit is None else fit.model.equation,
        "values": [] if fit is None else _values(fit, before, session.fits.opened),
        "verdict_before": [] if before is None or before.run is None else _verdict_text(before.run.fit),
        "curves": [] if run is None else _curves(run),
        "segments": [] if run is None else _segments(run),
        "questions": [
            {
                "body": question.body,
                "frame": question.frame,
                "first": question.first,
                "last": question.last,
                "reason": typeset("; ".join(question.reasons)),
                "doubts": list(question.doubts),
                "answered": question.answered,
            }
            for question in questions
        ],
    }


def residual_parts(folder: Path) -> list[dict[str, Any]]:
    """The parts of the residual that a diagnosis in the folder found, largest first; [] where there is none."""
    path = next((folder / name for name in DIAGNOSES if (folder / name).is_file()), None)
    if path is None:
        return []
    try:
        components = read_document(path, DiagnosisDocument).components
    except DataError:
        return []  # the parts are beside the point here: a damaged file must not keep the review from opening
    if components is None:
        return []
    shades = shades_of([part.side for part in components.parts])
    parts = [
        _part(KIND_NAMES[part.kind], part.share, SIDE_COLOURS[part.side], SHADES[shade])
        for part, shade in zip(components.parts, shades, strict=True)
    ]
    return [*parts, _part("noise", components.noise_share, (NOISE_COLOUR, NOISE_COLOUR), 1.0)]


def _part(name: str, share: float | None, inks: tuple[str, str], opacity: float) -> dict[str, Any]:
    """A part of the residual; ``inks`` on light and on dark paper."""
    return {"name": name, "share": share or 0.0, "inks": inks, "opacity": opacity}


def _track(track: Track) -> dict[str, Any]:
    xy = in_frame_px(track)
    radius = np.full(track.valid.size, np.nan) if track.radius_px is None else track.radius_px
    return {
        "body": track.body,
        "frame": track.frame.tolist(),
        "t": _numbers(track.t_s, 6),
        "x": _numbers(np.where(track.valid, xy[:, 0], np.nan), 2),
        "y": _numbers(np.where(track.valid, xy[:, 1], np.nan), 2),
        "sigma": _numbers(track.sigma_px.max(axis=1), 3),
        "radius": _numbers(radius, 1),
        "edited": _places(edited_mask(track)),
        "hand": [] if track.hand is None else _places(track.hand),
        "doubts": [] if track.quality is None else [doubt.text for doubt in track.quality.doubts],
    }


def _request(request: ReviewRequest) -> dict[str, Any]:
    phenomenon, calibration, geometry = request.phenomenon, request.calibration, request.geometry
    return {
        "phenomenon": None if phenomenon is None else phenomenon.name,
        "bodies": 1 if phenomenon is None else phenomenon.bodies,
        "tracker": request.tracker,
        "scale": None if calibration is None else f"{typeset(with_error(calibration.scale))} ({calibration.source})",
        "marks": {name: list(at) for name, at in geometry.marks_px.items()},
        "plumb": geometry.plumb_px,
        "roi": request.tracking.roi,
        "ignored": [[mark.x_px, mark.y_px, mark.frame] for mark in request.ignored],
        "body_marks": [[mark.body, mark.x_px, mark.y_px, mark.frame] for mark in request.tracking.marks],
    }


def _values(fit: FitResult, before: FitOutcome | None, opened: FitOutcome | None) -> list[dict[str, Any]]:
    """Each estimate as text, and what it was before the last change and when the review was opened."""
    earlier = [_texts(outcome) for outcome in (before, opened)]
    initial = set(fit.model.initial_names)
    shown = shown_estimates(fit)
    return [
        {
            "name": name,
            "now": typeset(with_error(estimate)),
            "before": earlier[0].get(name, ""),
            "opened": earlier[1].get(name, ""),
            "main": name not in initial and estimate.measurement_type in ("fitted", "derived"),
        }
        for name, estimate in shown.items()
        if math.isfinite(estimate.value)
    ]


def _texts(outcome: FitOutcome | None) -> dict[str, str]:
    if outcome is None or outcome.run is None:
        return {}
    return {name: typeset(with_error(estimate)) for name, estimate in shown_estimates(outcome.run.fit).items()}


def _verdict_text(fit: FitResult) -> list[str]:
    return [typeset(line) for line in verdict_lines(fit.verdict)]


def _curves(run: Run) -> list[dict[str, Any]]:
    """Data, fit and residual of each quantity that the model observes, in the unit shown."""
    fit, trajectory = run.fit, run.trajectory
    curves = []
    for k, quantity in enumerate(fit.model.observed):
        unit, factor = shown_unit(quantity.unit)
        column = k if len(fit.model.observed) == trajectory.position.shape[1] else trajectory.column(quantity.name)
        data = trajectory.position[:, column]
        curves.append(
            {
                "name": quantity.name,
                "unit": typeset(unit),
                "t": _numbers(trajectory.t_s, 6),
                "data": _significant(factor * np.where(trajectory.valid, data, np.nan)),
                "left_out": _significant(factor * np.where(trajectory.valid, np.nan, data)),
                "fit": _significant(factor * fit.predicted[:, k]),
                "residual": _significant(factor * fit.residual[:, k]),
            }
        )
    return curves


def _segments(run: Run) -> list[dict[str, Any]]:
    t_s = run.trajectory.t_s
    return [
        {"label": part.label, "from": float(t_s[part.start]), "to": float(t_s[part.stop - 1]), "reason": part.reason}
        for part in run.trajectory.segments
    ]


def _numbers(values: Array, digits: int) -> list[float | None]:
    """The values (n,), in their unit, rounded to ``digits`` decimal digits; null for what is not finite."""
    rounded = np.round(np.asarray(values, dtype=np.float64), digits)
    if np.isfinite(rounded).all():
        return rounded.tolist()  # ten times as fast
    return [value if math.isfinite(value) else None for value in rounded.tolist()]


def _significant(values: Array) -> list[float | None]:
    """The values (n,), in their unit, to six digits of the largest; null for what is not finite."""
    finite = np.abs(values[np.isfinite(values)])
    largest = float(finite.max()) if finite.size else 0.0
    return _numbers(values, 5 - math.floor(math.log10(largest)) if largest > 0 else 6)


def _places(flags: Mask) -> list[int]:
    """The indices of True in flags (n,)."""
    return [int(place) for place in np.flatnonzero(flags)]

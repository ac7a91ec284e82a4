"""Options about records of inputs and outputs: the sample time, the hold of the inputs, what is kept for validation."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import typer

from iris_sysid.cli import _terminal
from iris_sysid.errors import DataError
from iris_sysid.units import UNSIGNED

if TYPE_CHECKING:
    from iris_sysid.cli.arguments import RecordArguments
    from iris_sysid.types import Diagnosis, Estimate, Hold, OdeModel, Trajectory, Validation

HOLDS: dict[str, Hold | None] = {"zero": "zero-order", "linear": "linear", "auto": None}
IN_WORDS: dict[Hold, str] = {"zero-order": "held", "linear": "on a line"}
SHARE = re.compile(rf"(?P<number>{UNSIGNED})\s*+(?P<percent>%)?+")
SAMPLE_TIME = re.compile(rf"(?P<number>{UNSIGNED})\s*+(?P<unit>s|ms)?+")


def checked(record: RecordArguments) -> RecordArguments:
    """The options with the sample time among the columns: the time from the number of the row.

    Raises a DataError where the hold is none of the words that it may be, or the sample time cannot be read.
    """
    if record.hold not in HOLDS:
        raise DataError(f"inputs between samples are held: {', '.join(HOLDS)}, not {record.hold!r:.40}")
    return replace(record, columns=with_sample_time(record.columns, record.sample_time), sample_time=None)


def with_sample_time(columns: str | None, sample_time: str | None) -> str | None:
    """The option ``--columns`` with the time from the number of the row, where a sample time is stated."""
    if sample_time is None:
        return columns
    match = SAMPLE_TIME.fullmatch(sample_time.strip())
    if match is None or not float(match["number"]) > 0:
        raise DataError(f"cannot read the sample time {sample_time!r:.40}: write it as 4s, 0.02 or 20ms")
    if columns is not None and re.search(r"(?:^|,)\s*+t\s*+[\[=]", columns):
        raise DataError("--sample-time and --columns both state the time; leave one out")
    time = f"t[{match['number']} {match['unit'] or 's'}]=row"
    return time if columns is None else f"{time},{columns}"


def held(
    clips: Sequence[Trajectory],
    model: OdeModel,
    hold: str,
    *,
    fixed: Mapping[str, Estimate],
    free: Sequence[str],
    start: Mapping[str, float] | None = None,
) -> list[Trajectory]:
    """The records with the hold of their inputs, which ``auto`` takes from the data and says on stderr."""
    known = _stated_or_visible(clips if model.inputs else (), hold)
    if known is not None:
        return [clip.with_(hold=known) for clip in clips]
    from fitters.input_hold import holds_compared

    compared = holds_compared(clips, model, fixed=fixed, free=free, start=start)
    if not compared:
        return list(clips)
    best = tell_hold(compared)
    return [clip.with_(hold=best) for clip in clips]


def diagnosed(
    clips: list[Trajectory], search: Callable[[list[Trajectory]], Diagnosis], hold: str
) -> tuple[list[Trajectory], Diagnosis]:
    """The records and their diagnosis, once more where the effects that were found tell the hold otherwise."""
    diagnosis = search(clips)
    otherwise = _held_otherwise(clips, diagnosis, hold)
    return (clips, diagnosis) if otherwise is None else (otherwise, search(otherwise))


def _held_otherwise(clips: Sequence[Trajectory], diagnosis: Diagnosis, hold: str) -> list[Trajectory] | None:
    """The records with another hold of their inputs than they were diagnosed with; None where that fits as well.

    ``auto`` takes it from a fit without the effects that were found, where half a step's delay may make up for a part
    of one.
    """
    from fitters.input_hold import holds_compared, jumps

    final = diagnosis.final
    if HOLDS[hold] is not None or not diagnosis.added or jumps(clips):
        return None
    values = {name: each for name, each in final.estimates.items() if math.isfinite(each.value)}
    known = {each.name: values[each.name] for each in final.model.parameters if each.name in values}
    compared = holds_compared(
        clips,
        final.model,
        fixed={name: each for name, each in known.items() if name not in final.free},
        free=[each.name for each in final.model.parameters if each.constant and each.name in final.free],
        start={name: values[name].value for name in final.free},
    )
    if not compared or next(iter(compared)) == clips[0].hold:
        return None
    best = tell_hold(compared)
    return [clip.with_(hold=best) for clip in clips]


def _stated_or_visible(clips: Sequence[Trajectory], hold: str) -> Hold | None:
    """The stated hold, or the one that inputs show which jump, and that on stderr; None where neither tells it."""
    from fitters.input_hold import jumps

    if HOLDS[hold] is not None or not jumps(clips):
        return HOLDS[hold]
    typer.echo(f"inputs between samples: {IN_WORDS['zero-order']} (they keep their values between jumps)", err=True)
    return "zero-order"


def each_hold(clips: Sequence[Trajectory], hold: str) -> dict[Hold, list[Trajectory]]:
    """The records with each hold of their inputs to try: the stated or visible one, or both where there are inputs."""
    stated = _stated_or_visible(clips, hold)
    driven = any(clip.input_quantities for clip in clips)
    tried: Sequence[Hold] = [stated] if stated is not None else [*IN_WORDS] if driven else [clips[0].hold]
    return {each: [clip.with_(hold=each) for clip in clips] for each in tried}


def recorded_hold(origin: Mapping[str, object]) -> Hold | None:
    """The hold of the inputs that the origin of a fit on disk tells; None where it tells none."""
    return next((each for each in IN_WORDS if origin.get("hold") == each), None)


def tell_hold(compared: Mapping[Hold, float]) -> Hold:
    """Say on stderr which hold of the inputs fits best, and return it; ``compared`` is by hold residual over noise."""
    best, *others = sorted(compared, key=lambda each: compared[each])
    residuals = ", ".join(f"{compared[each]:.3g} {IN_WORDS[each]}" for each in (best, *others))
    typer.echo(f"inputs between samples: {IN_WORDS[best]} (residual over noise {residuals})", err=True)
    return best


def split(
    clips: Sequence[Trajectory], validate: str | None, stated: RecordArguments, model: OdeModel
) -> tuple[list[Trajectory], Trajectory | None]:
    """The records to fit, and the one to validate with: another table, or the last share of the only record."""
    if validate is None:
        return list(clips), None
    if len(clips) > 1:
        raise DataError("--validate is about one table; give one, or validate the values with fit and --set")
    (clip,) = clips
    match = SHARE.fullmatch(validate.strip())
    if match is None or Path(validate).exists():
        (record,) = _terminal.read_tables([Path(validate)], stated, model)
        return [clip], record
    from fitters.validation_record import split_record

    estimation, record = split_record(clip, float(match["number"]) * (0.01 if match["percent"] else 1.0))
    return [estimation], record


def kept(text: str, record: Trajectory) -> int:
    """Number of valid samples in the last part of a record, from ``20%`` or ``100``."""
    match = SHARE.fullmatch(text.strip())
    if match is None:
        raise DataError(f"cannot read --keep {text!r:.40}: give a share, 20%, or a number of samples, 100")
    number, valid = float(match["number"]), int(record.valid.sum())
    if match["percent"]:
        return round(0.01 * number * valid)
    if not number.is_integer():
        raise DataError(f"--keep {text:.40} is not a whole number of samples; a share is written 20%")
    return int(number)


def draw(validation: Validation, picture: Path | None, force: bool) -> None:
    """Draw a validation to a PNG file, where one is wanted."""
    if picture is None:
        return
    from iris_sysid.report.validation_figure import validation_figure

    _terminal.draw(validation_figure(validation), picture, overwrite=force)


def tell(validation: Validation, json: bool, what: str = "validation") -> None:
    """Say what a validation found: the simulation error, the linear model, and the correlations outside their bands.

    To stderr with ``json``: the result itself goes to stdout. ``what`` begins the line.
    """
    linear = validation.linear
    for k, (quantity, rms, share) in enumerate(
        zip(validation.quantities, validation.rms, validation.fit_percent, strict=True)
    ):
        text = f"{what} {quantity.name}: simulation error {rms:.3g} {quantity.unit} rms, fit {share:.1f} %"
        if linear is not None:
            text += f"; linear model of order {linear.order}: {linear.rms[k]:.3g}, {linear.fit_percent[k]:.1f} %"
        outside = f"residual: {100 * validation.coloured[k]:.0f} % of its autocorrelations"
        named = zip(validation.inputs, validation.input_left[k], strict=True)
        outside += "".join(f", {100 * left:.0f} % of its correlations with {name.name}" for name, left in named)
        typer.echo(text, err=json)
        typer.echo(f"{outside} lie outside the 99 % bands", err=json)

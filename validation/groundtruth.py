"""Ground truth regenerated from synthetic clips: coverage of its 95 % intervals, and processor time.

``python -m validation.groundtruth DATASET`` measures the clips (those of an earlier run are kept) and compares the
value of each clip, and the pooled value of each setting, with the truth beside the clips. The only thing taken from the
truth is the radius of the falling balls, which stands for the calipers.
"""

from __future__ import annotations

import argparse
import json
import math
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from iris_sysid.benchmark.dataset import list_clips
from iris_sysid.benchmark.groundtruth.clip import Conditions
from iris_sysid.benchmark.groundtruth.measure import ClipMeasurement, Measurements, measure
from iris_sysid.benchmark.groundtruth.parameters import parameters_document
from iris_sysid.benchmark.groundtruth.pool import in_published_unit
from iris_sysid.io.json_documents import write_document
from iris_sysid.io.schemas import number
from iris_sysid.io.schemas.groundtruth import MeasuredDocument, ParametersDocument
from iris_sysid.pipeline.clip_folders import benchmark_classes
from iris_sysid.types import Estimate
from validation import pages

CALIPERS = 1e-5  # m, resolution of the calipers
FULL_FRAMES, FULL_PIXELS = 372_600, 3840 * 2160  # of the published data set


@dataclass(frozen=True, slots=True)
class Row:
    """One value against its truth; ``clip`` is empty for the pooled value of a setting."""

    class_name: str
    setting: str
    clip: str
    parameter: str
    value: float
    stderr: float
    interval: tuple[float, float]
    truth: float

    @property
    def covered(self) -> bool:
        """Whether the 95 % interval contains the truth."""
        return self.interval[0] <= self.truth <= self.interval[1]

    @property
    def pull(self) -> float:
        """Error in standard errors."""
        return (self.value - self.truth) / self.stderr


def truth_of(path: Path) -> dict[str, Estimate]:
    """True values of a clip, by our names, in the units of parameters.json."""
    entries = json.loads(path.with_suffix(".truth.json").read_text(encoding="utf-8"))["parameters"]
    return {
        name: in_published_unit(Estimate(parameters["value"], 0.0, parameters["unit"]))[0]
        for name, parameters in entries.items()
    }


def by_calipers(dataset: Path) -> MeasuredDocument:
    """The radius of the falling balls, as calipers give it."""
    first = {(clip.class_name, clip.setting): clip for clip in reversed(list_clips(dataset).clips)}
    values = [
        {
            "class": name,
            "setting": setting,
            "parameter": "ball_radius",
            "value": truth_of(clip.path)["ball_radius"].value,
        }
        | {"uncertainty": CALIPERS, "unit": "m", "instrument": "calipers"}
        for (name, setting), clip in sorted(first.items())
        if clip.phenomenon == "falling-ball"
    ]
    return MeasuredDocument.model_validate({"values": values})


def clip_rows(clips: Sequence[ClipMeasurement], status: str) -> Iterator[Row]:
    """Every fitted value of every clip whose fit has that status, where the truth is known."""
    for measurement in clips:
        clip, document, truth = measurement.clip, measurement.document, truth_of(measurement.clip.path)
        if document.status != status:
            continue
        for name in benchmark_classes()[clip.class_name][1].parameters:
            if name not in truth or name not in document.parameters:
                continue
            estimate = in_published_unit(document.parameters[name].estimate())[0]
            if estimate.measurement_type == "assumed" or not math.isfinite(estimate.stderr):
                continue
            key = (clip.class_name, clip.setting, clip.clip)
            yield Row(*key, name, estimate.value, estimate.stderr, estimate.interval, truth[name].value)


def pooled_rows(document: ParametersDocument, clips: Sequence[ClipMeasurement]) -> Iterator[Row]:
    """Every regenerated value of every setting, against the mean truth of its clips."""
    settings = dict.fromkeys((clip.clip.class_name, clip.clip.setting) for clip in clips)
    for name, setting in settings:
        for entry in document.classes[name.lower()][setting.lower()].values():
            regenerated = entry.regenerated
            if regenerated is None or regenerated.n == 0 or regenerated.value is None:
                continue
            used = [clip for clip in clips if (clip.clip.class_name, clip.clip.setting) == (name, setting)]
            used = [clip for clip in used if regenerated.clips[clip.clip.clip].used]
            truths = [truth_of(clip.clip.path).get(regenerated.parameter) for clip in used]
            if None in truths:
                continue
            mean = float(np.mean([truth.value for truth in truths if truth is not None]))
            interval = (number(regenerated.interval[0]), number(regenerated.interval[1]))
            stderr = number(regenerated.standard_uncertainty)
            yield Row(name, setting, "", regenerated.parameter, regenerated.value, stderr, interval, mean)


def report(title: str, rows: Sequence[Row]) -> None:
    """Print coverage by class and parameter, and each value whose interval misses."""
    print(
        f"\n{title}\n\n| class | parameter | rows | in the interval | rms pull | median error / % |\n"
        "|---|---|---|---|---|---|"
    )
    for key in dict.fromkeys((row.class_name, row.parameter) for row in rows):
        some = [row for row in rows if (row.class_name, row.parameter) == key]
        pulls = np.array([row.pull for row in some])
        errors = [100 * abs(row.value / row.truth - 1) if row.truth else math.nan for row in some]
        print(
            f"| {key[0]} | {key[1]} | {len(some)} | {sum(row.covered for row in some)} | "
            f"{math.sqrt(float(np.mean(pulls**2))):.2f} | {np.median(errors):.3g} |"
        )
    covered = sum(row.covered for row in rows)
    print(f"\nin all {covered} of {len(rows)} = {100 * covered / max(len(rows), 1):.1f} %")
    for row in rows:
        if not row.covered:
            print(
                f"missed: {row.class_name}/{row.setting}/{row.clip or 'all'} {row.parameter} = {row.value:.6g} +- "
                f"{row.stderr:.2g}, truth {row.truth:.6g}, {row.pull:+.1f} standard errors"
            )


def report_time(measurements: Measurements, seconds: float, pixels: int) -> None:
    """Print processor time per clip and frame, and bounds on the time for the published data set at 4K."""
    if not measurements.now:
        print("\nno clip was measured now: no time to tell")
        return
    frames = np.mean([clip.document.frames for clip in measurements.clips if clip.document.frames])
    per_clip = seconds / measurements.now
    least = per_clip / float(frames) * FULL_FRAMES / 3600
    most = least * FULL_PIXELS / pixels
    print(
        f"\n{measurements.now} clips measured now: {per_clip:.1f} s of one processor a clip of {frames:.0f} frames, "
        f"{1000 * per_clip / float(frames):.0f} ms a frame. The published data set, {FULL_FRAMES} frames at 4K, would "
        f"take from {least:.0f} hours, if a frame of any size costs the same, to {most:.0f} in proportion to pixels"
    )


def main() -> None:
    """Measure, pool, compare, print."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("dataset", type=Path)
    parser.add_argument("--work", type=Path, default=Path("groundtruth.work"), help="folder of the measurements")
    parser.add_argument("--trials", type=int, default=None, help="only so many clips of each setting")
    parser.add_argument("-o", "--output", type=Path, default=None, help="parameters.json, to be kept")
    pages.add_option(parser)
    options = parser.parse_args()
    by_hand, began = by_calipers(options.dataset), time.process_time()
    measurements = measure(
        options.dataset, options.work, measured=by_hand, conditions=Conditions(trials=options.trials), tell=print
    )
    seconds = time.process_time() - began
    document = parameters_document(measurements, by_hand)
    if options.output is not None:
        write_document(document, options.output, overwrite=True)
    failed = [clip.clip.place for clip in measurements.clips if clip.document.status == "failed"]
    with pages.table("groundtruth", options.write_docs):
        print(f"{len(measurements.clips)} clips, {len(failed)} failed")
        report("Each clip that its equation fits", list(clip_rows(measurements.clips, "ok")))
        report("Each clip with a residual above the noise", list(clip_rows(measurements.clips, "misfit")))
        report("Each setting, pooled", list(pooled_rows(document, measurements.clips)))
        width, height = json.loads((options.dataset / "manifest.json").read_text("utf-8"))["origin"]["options"]["size"]
        report_time(measurements, seconds, width * height)


if __name__ == "__main__":
    main()

"""Render a synthetic copy of the whole benchmark in parallel; a run continues where an earlier one stopped."""

from __future__ import annotations

import json
import shutil
import zlib
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from iris_sysid.errors import DataError, IrisError, OutputError
from iris_sysid.io.files import check_writable, json_text, origin_of, write_atomic
from iris_sysid.pipeline.batch import Batch
from iris_sysid.pipeline.parallel import Workers, check_workers, run_parallel
from iris_sysid.synthetic.board import render_checkerboard
from iris_sysid.synthetic.clip import render_clip
from iris_sysid.synthetic.look import Look
from iris_sysid.synthetic.plan import check_clip, scene_named
from iris_sysid.synthetic.scene import SCENES, Scene
from iris_sysid.synthetic.truth import truth_paths
from iris_sysid.types import Progress, with_progress

WORKSHOP = ".rendering"  # folder of unfinished clips
MANIFEST = "manifest.json"
BOARD = "checkerboard.mp4"
MAX_TRIALS = 999


@dataclass(frozen=True, slots=True)
class RenderJob:
    """One clip to render: ``place`` is its path in the data set; ``setting`` is None for the checkerboard.

    ``film`` are the arguments that all clips have in common.
    """

    place: str
    phenomenon: str
    seed: int
    film: Mapping[str, Any]
    setting: str | None = None
    overrides: Mapping[str, float] = field(default_factory=dict)


@dataclass(frozen=True, slots=True)
class Dataset:
    """The result of :func:`render_dataset`: clips written now, and clips kept from an earlier run."""

    folder: Path
    written: tuple[Path, ...]
    kept: tuple[Path, ...]


def render_dataset(
    folder: str | Path,
    *,
    size: tuple[int, int] = (3840, 2160),
    fps: float = 60.0,
    trials: int = 10,
    seed: int = 0,
    workers: Workers = 0,
    phenomena: Sequence[str] | None = None,
    duration_s: float | None = None,
    look: Look | None = None,
    progress: Progress | None = None,
) -> Dataset:
    """Render the benchmark's clips as ``<Class>/<setting>/<clip>.mp4`` with ``parameters.json`` beside the classes.

    The truth of each clip is written beside it; each class has a ``checkerboard.mp4`` filmed by its camera. Trials
    differ as repeated experiments do (angle of release, friction, ...). A clip depends only on the seed and its own
    name, so that any part can be rendered alone. Finished clips of an earlier run are kept.

    Parameters
    ----------
    folder
        The data set; made when missing. One run at a time.
    size
        Width and height, px.
    fps
        Frames per second.
    trials
        Number of clips of each setting.
    seed
        Random seed of the whole data set.
    workers
        Number of parallel processes, 0 for this one, or the address or file of a dask scheduler.
    phenomena
        Names of scenes; None means the benchmark's eight phenomena, LED and Torricelli.
    duration_s
        Length of every clip in s; None for the length of the benchmark's clips.
    look
        Appearance of the clips.
    progress
        Called with (clips done, total number of clips).

    Raises
    ------
    UnknownNameError
        For a phenomenon that does not exist.
    DataError
        For numbers from which no clip can be rendered.
    OutputError
        When the folder holds another data set, or cannot be written.
    IrisError
        When some clips failed; all others are finished, and the message lists the failed ones.
    """
    look, root = look or Look(), Path(folder)
    scenes = [scene_named(name) for name in (phenomena if phenomena is not None else SCENES)]
    _check(size, fps, trials, seed, workers, duration_s)
    film = {"size": size, "fps": fps, "duration_s": duration_s, "look": look}
    jobs = list(_jobs(scenes, trials, seed, film))
    options = {"size": list(size), "fps": fps, "seed": seed, "duration_s": duration_s, "look": asdict(look)}
    _claim(root, options)
    missing = [job for job in jobs if not (root / job.place).exists()]
    with _workshop(root):
        batch = Batch(root, _attempt, _lost)
        outcomes = run_parallel(batch, missing, workers)
        _check_all(with_progress(outcomes, progress, len(jobs), done=len(jobs) - len(missing)))
    _write_parameters(root)
    written = {job.place for job in missing}
    places = [job.place for job in jobs]
    return Dataset(
        root,
        tuple(root / place for place in places if place in written),
        tuple(root / place for place in places if place not in written),
    )


def _check(
    size: tuple[int, int], fps: float, trials: int, seed: int, workers: Workers, duration_s: float | None
) -> None:
    check_clip(size, fps, 1.0 if duration_s is None else duration_s, seed)
    if not isinstance(trials, int) or not 1 <= trials <= MAX_TRIALS:
        raise DataError(f"trials must be a whole number from 1 to {MAX_TRIALS}, not {trials!r}")
    check_workers(workers)


def _jobs(scenes: Iterable[Scene], trials: int, seed: int, film: Mapping[str, Any]) -> Iterator[RenderJob]:
    for scene in scenes:
        place = f"{scene.folder}/{BOARD}"
        yield RenderJob(place, scene.name, _seed_of(seed, place), film)
        for setting in scene.settings:
            for trial in range(1, trials + 1):
                place = f"{scene.folder}/{setting}/{trial:02d}.mp4"
                clip_seed = _seed_of(seed, place)
                scattered = _scattered(scene, setting, clip_seed)
                yield RenderJob(place, scene.name, clip_seed, film, setting, scattered)


def _seed_of(seed: int, place: str) -> int:
    return int(np.random.SeedSequence([seed, zlib.crc32(place.encode())]).generate_state(1)[0])


def _scattered(scene: Scene, setting: str, seed: int) -> dict[str, float]:
    """Parameters of one trial, drawn about the setting's values within the scene's bounds."""
    rng, values = np.random.default_rng([seed, 7]), scene.settings[setting]
    drawn = {}
    for parameter in scene.parameters:
        if parameter.name in scene.scatter:
            mean = values.get(parameter.name, float(parameter.default or 0.0))
            value = mean + scene.scatter[parameter.name] * float(np.clip(rng.standard_normal(), -3, 3))
            drawn[parameter.name] = min(max(value, parameter.lower), parameter.upper)
    return drawn


def _claim(root: Path, options: Mapping[str, Any]) -> None:
    """Write the manifest, or check that the existing one has the same options."""
    manifest = root / MANIFEST
    if not manifest.exists():
        write_atomic(manifest, json_text({"schema": 1, "origin": origin_of(None, options)}))
        return
    check_writable(manifest, overwrite=True)
    try:
        earlier = json.loads(manifest.read_text(encoding="utf-8"))["origin"]["options"]
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise OutputError(f"{manifest} is not the manifest of a rendered data set; give another folder") from error
    now = json.loads(json_text(options))
    different = [name for name in now if earlier.get(name) != now[name]]
    if different:
        differences = ", ".join(f"{name} = {earlier.get(name)}" for name in different)
        raise OutputError(f"{root} holds a data set with {differences}; give another folder, or the same options")


@contextmanager
def _workshop(root: Path) -> Iterator[None]:
    """An empty folder for unfinished clips, removed afterwards; remains of an interrupted run are removed first."""
    shutil.rmtree(root / WORKSHOP, ignore_errors=True)
    try:
        yield
    finally:
        shutil.rmtree(root / WORKSHOP, ignore_errors=True)


def _check_all(outcomes: Iterable[tuple[RenderJob, IrisError | None]]) -> None:
    """Wait for all jobs, then raise IrisError when some of them failed."""
    errors = [(job.place, error) for job, error in outcomes]
    failed = [f"{place}: {error}" for place, error in errors if error is not None]
    if failed:
        raise IrisError(
            f"{len(failed)} of {len(errors)} clips could not be rendered; all others are: {'; '.join(failed)}"
        )


def _attempt(root: Path, job: RenderJob) -> IrisError | None:
    try:
        _render_one(job, root)
    except IrisError as error:
        return error
    return None


def _lost(root: Path, job: RenderJob) -> IrisError:
    return IrisError("the process that rendered it died; is there enough memory? Fewer workers need less")


def _render_one(job: RenderJob, root: Path) -> None:
    """Render into the folder of unfinished clips, then move the truth and, last, the clip to the data set."""
    target = root / job.place
    unfinished = root / WORKSHOP / job.place
    common = {**job.film, "seed": job.seed, "overwrite": True}
    if job.setting is None:
        del common["duration_s"]  # a board is shown in all its poses
        render_checkerboard(job.phenomenon, unfinished, **common)
    else:
        render_clip(job.phenomenon, unfinished, setting=job.setting, overrides=job.overrides, **common)
    try:
        target.parent.mkdir(parents=True, exist_ok=True)
        sources, goals = (*truth_paths(unfinished), unfinished), (*truth_paths(target), target)
        for source, goal in zip(sources, goals, strict=True):
            if source.exists():
                source.replace(goal)
    except OSError as error:
        raise OutputError(f"cannot write {target}: {error.strerror}") from error


# --------------------------------------------------------------------------- parameters.json


def _write_parameters(root: Path) -> None:
    """Write the true parameters of the rendered clips in the form that the benchmark's scripts read."""
    document: dict[str, Any] = {}
    for scene in SCENES.values():
        settings = {
            setting: _setting_parameters(scene, clips)
            for setting in scene.settings
            if (clips := sorted((root / scene.folder / setting).glob("*.truth.json")))
        }
        if settings:
            document[scene.folder.lower()] = settings
    write_atomic(root / "parameters.json", json_text(document), overwrite=True)


def _setting_parameters(scene: Scene, clips: Sequence[Path]) -> dict[str, Any]:
    truths = [json.loads(clip.read_text(encoding="utf-8"))["parameters"] for clip in clips]
    return {
        published_name: _summary([parameters[name]["value"] * factor for parameters in truths], unit)
        for name, (published_name, factor, unit) in scene.published.items()
    }


def _summary(values: Sequence[float], unit: str) -> dict[str, Any]:
    spread = float(np.std(values, ddof=1)) if len(values) > 1 else 0.0
    return {
        "mean": float(np.mean(values)),
        "std": spread,
        "min": min(values),
        "max": max(values),
        "n": len(values),
        "unit": unit,
        "measurement_type": "direct",
    }

"""The truth of a rendered clip, and the files that hold it."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from iris_sysid.errors import DataError
from iris_sysid.io.files import json_text, write_atomic
from iris_sysid.types import Estimate

SCHEMA = 1


@dataclass(frozen=True, eq=False, slots=True)
class Truth:
    """Everything about a rendered clip that is known exactly.

    ``table`` has one row per frame and body: ``frame`` (number in the file), ``t_s`` (the file's time of the frame,
    the middle of its exposure), ``body``, ``x_px``, ``y_px`` (true centre at that time; origin at the centre of
    pixel (0, 0), y down), ``x_mean_px``, ``y_mean_px`` (mean over the exposure), ``radius_px``, ``x_m``, ``z_m``,
    ``phase`` (hand, motion, contact, rest), ``inside`` (whether the centre lies in the image), ``shift_x_px``,
    ``shift_y_px`` (shift by camera shake; contained in the positions), then what the scene observes, e.g.
    ``theta_rad``.
    ``parameters`` and ``camera`` are the values that a user would know. ``effects`` are hidden; ``hidden`` holds the
    parameters that they change (e.g. the length in the equation of motion, where ``parameters`` has that of the cord)
    and ``true_camera`` the camera that they change. A separate file holds these; nothing else reads it.
    """

    phenomenon: str
    setting: str | None
    size: tuple[int, int]
    fps: float
    duration_s: float
    seed: int
    parameters: Mapping[str, Estimate]
    camera: Mapping[str, Any]
    look: Mapping[str, Any]
    events: tuple[tuple[float, str], ...]
    effects: Mapping[str, float]
    hidden: Mapping[str, Estimate]
    true_camera: Mapping[str, Any]
    table: pd.DataFrame

    def body(self, name: str = "1") -> pd.DataFrame:
        """The rows of one body, in order of time; DataError lists the names there are."""
        rows = self.table[self.table["body"] == name]
        if rows.empty:
            raise DataError(f"the clip has no body {name!r}; it has {', '.join(self.table['body'].unique())}")
        return rows.reset_index(drop=True)

    def exact(self, name: str) -> Estimate:
        """The value of a parameter in the equation that the bodies really follow; DataError lists the names."""
        known = {**self.parameters, **self.hidden}
        if name not in known:
            raise DataError(f"the clip has no parameter {name!r}; it has {', '.join(known)}")
        return known[name]

    @property
    def pixels_per_metre(self) -> float:
        """Scale at the centre of the image, px/m."""
        return float(self.camera["pixels_per_metre"])


def truth_paths(clip: str | Path) -> tuple[Path, Path, Path]:
    """The files beside a clip: parameters and camera, trajectory, and hidden effects."""
    clip = Path(clip)
    return clip.with_suffix(".truth.json"), clip.with_suffix(".truth.csv"), clip.with_suffix(".hidden.json")


def write_truth(truth: Truth, clip: str | Path, *, overwrite: bool = False) -> None:
    """Write CLIP.truth.json, CLIP.truth.csv and, apart from them, CLIP.hidden.json beside a clip."""
    truth_path, table, hidden = truth_paths(clip)
    write_atomic(table, truth.table.to_csv(index=False, lineterminator="\n"), overwrite=overwrite)
    write_atomic(hidden, json_text(_hidden(truth)), overwrite=overwrite)
    write_atomic(truth_path, json_text(_known_to_a_user(truth, Path(clip).name)), overwrite=overwrite)


def _known_to_a_user(truth: Truth, clip: str) -> dict[str, Any]:
    return {
        "schema": SCHEMA,
        "clip": clip,
        "phenomenon": truth.phenomenon,
        "setting": truth.setting,
        "size_px": list(truth.size),
        "fps": truth.fps,
        "duration_s": truth.duration_s,
        "seed": truth.seed,
        "parameters": {
            name: {"value": parameter.value, "unit": parameter.unit} for name, parameter in truth.parameters.items()
        },
        "camera": truth.camera,
        "look": truth.look,
    }


def _hidden(truth: Truth) -> dict[str, Any]:
    return {
        "schema": SCHEMA,
        "effects": truth.effects,
        "consequences": {name: {"value": true.value, "unit": true.unit} for name, true in truth.hidden.items()},
        "camera": truth.true_camera,
        "events": [{"t_s": t_s, "event": name} for t_s, name in truth.events],
    }


def read_truth(clip: str | Path) -> Truth:
    """Read the truth of a clip from the files beside it, including the hidden effects.

    Raises DataError when a file is missing or is not one of ours.
    """
    truth_path, table_path, hidden_path = truth_paths(clip)
    content, hidden = _read_json(truth_path), _read_json(hidden_path)
    try:
        return Truth(
            phenomenon=content["phenomenon"],
            setting=content["setting"],
            size=(content["size_px"][0], content["size_px"][1]),
            fps=content["fps"],
            duration_s=content["duration_s"],
            seed=content["seed"],
            parameters=_estimates(content["parameters"]),
            camera=content["camera"],
            look=content["look"],
            events=tuple((event["t_s"], event["event"]) for event in hidden["events"]),
            effects=hidden["effects"],
            hidden=_estimates(hidden["consequences"]),
            true_camera=hidden["camera"],
            table=pd.read_csv(table_path, dtype={"body": str}),
        )
    except (KeyError, TypeError, IndexError, OSError, ValueError) as error:
        raise DataError(f"{truth_path} and its companions are not the truth of a rendered clip: {error!r}") from error


def _read_json(path: Path) -> dict[str, Any]:
    try:
        content = json.loads(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise DataError(f"cannot read {path}: {error.strerror}; is the clip one that render wrote?") from error
    except ValueError as error:
        raise DataError(f"{path} is not JSON: {error}") from error
    if not isinstance(content, dict):
        raise DataError(f"{path} holds no mapping")
    return content


def _estimates(entries: Mapping[str, Mapping[str, Any]]) -> dict[str, Estimate]:
    return {
        name: Estimate(
            np.nan if entry["value"] is None else float(entry["value"]), 0.0, entry["unit"], "direct", "rendered"
        )
        for name, entry in entries.items()
    }

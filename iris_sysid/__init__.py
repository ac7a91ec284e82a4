"""From a physics video to the parameters of its governing equation, with honest error bars.

Everything public is here; names are imported when first used, so that ``import iris_sysid`` is quick.
"""

from __future__ import annotations

import importlib
from typing import Any

__version__ = "0.1.0"

DISTRIBUTION = "iris-sysid"

_HOME = {
    name: module
    for module, names in {
        "iris_sysid.calibration.pixel_scale": "scale scale_bar scale_from_text uncalibrated from_osp to_world",
        "iris_sysid.calibration.calibration_json": "read_calibration write_calibration",
        "iris_sysid.errors": (
            "IrisError VideoError TrackingError CalibrationError DataError FitError UnknownNameError "
            "PluginError OutputError"
        ),
        "iris_sysid.trajectory.segmentation": "segment",
        "iris_sysid.pipeline": "run track observe save Run",
        "iris_sysid.registry": "TRACKERS MODELS EFFECTS PHENOMENA",
        "iris_sysid.trajectory.smoothing": "smooth",
        "iris_sysid.diagnosis.diagnose": "diagnose Diagnosis",
        "iris_sysid.io.dataframes": "to_frame estimates_frame",
        "iris_sysid.io.osp_tracker": "read_osp marked_tracks",
        "iris_sysid.report.clip_page": "write_report",
        "iris_sysid.io.csv_read": "read_track read_trajectory",
        "iris_sysid.io.csv_write": "write_track write_trajectory",
        "iris_sysid.types": (
            "Calibration Discovery Effect Estimate FitResult Frame FrameSource OdeModel Parameter Phenomenon Quantity "
            "Segment Smoothed Track Tracker TrackOptions Trajectory"
        ),
        "iris_sysid.video.reader": "open_video",
        "fitters.compose_effects": "with_effects",
        "fitters.ode.single_clip": "fit simulate",
        "fitters.sindy.discover": "discover",
    }.items()
    for name in names.split()
}

__all__ = sorted(_HOME)


def __getattr__(name: str) -> Any:
    if name not in _HOME:
        raise AttributeError(f"module 'iris_sysid' has no attribute {name!r}")
    return getattr(importlib.import_module(_HOME[name]), name)


def __dir__() -> list[str]:
    return sorted([*globals(), *_HOME])

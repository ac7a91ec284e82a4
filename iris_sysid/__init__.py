"""From a physics video to the parameters of its governing equation, with honest error bars.

Everything public is here; names are imported when first used, so that ``import iris_sysid`` is quick.
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

from iris_sysid._version import __version__ as __version__

if TYPE_CHECKING:
    from fitters.compose_effects import with_effects as with_effects
    from fitters.ode.identifiability import identifiability as identifiability
    from fitters.ode.lmfit_minimizer import lmfit_minimizer as lmfit_minimizer
    from fitters.ode.prediction import predict as predict
    from fitters.ode.request import FitOptions as FitOptions
    from fitters.ode.several_clips import fit_clips as fit_clips
    from fitters.ode.simulation import simulate as simulate
    from fitters.ode.single_clip import fit as fit
    from fitters.own_model.equation import model_from_equation as model_from_equation
    from fitters.own_model.function import model_from_function as model_from_function
    from fitters.selection.select import select_model as select_model
    from fitters.sindy.as_pysindy import to_pysindy as to_pysindy
    from fitters.sindy.discover import discover as discover
    from fitters.validation_record import split_record as split_record
    from fitters.validation_record import validate_fit as validate_fit
    from iris_sysid.calibration.board.calibrate import calibrate_board as calibrate_board
    from iris_sysid.calibration.calibration_json import read_calibration as read_calibration
    from iris_sysid.calibration.calibration_json import write_calibration as write_calibration
    from iris_sysid.calibration.known_size import plane_from_ball as plane_from_ball
    from iris_sysid.calibration.known_size import plane_from_distance as plane_from_distance
    from iris_sysid.calibration.known_size import plane_from_size as plane_from_size
    from iris_sysid.calibration.pixel_scale import from_osp as from_osp
    from iris_sysid.calibration.pixel_scale import scale as scale
    from iris_sysid.calibration.pixel_scale import scale_bar as scale_bar
    from iris_sysid.calibration.pixel_scale import scale_from_text as scale_from_text
    from iris_sysid.calibration.pixel_scale import to_world as to_world
    from iris_sysid.calibration.pixel_scale import uncalibrated as uncalibrated
    from iris_sysid.diagnosis.diagnose import diagnose as diagnose
    from iris_sysid.diagnosis.planning.changes import SetUpChange as SetUpChange
    from iris_sysid.diagnosis.planning.decide import Decision as Decision
    from iris_sysid.diagnosis.planning.decide import decide as decide
    from iris_sysid.diagnosis.planning.plan import Plan as Plan
    from iris_sysid.diagnosis.planning.plan import Proposal as Proposal
    from iris_sysid.diagnosis.planning.plan import plan as plan
    from iris_sysid.errors import CalibrationError as CalibrationError
    from iris_sysid.errors import DataError as DataError
    from iris_sysid.errors import FitError as FitError
    from iris_sysid.errors import IrisError as IrisError
    from iris_sysid.errors import OutputError as OutputError
    from iris_sysid.errors import PluginError as PluginError
    from iris_sysid.errors import TrackingError as TrackingError
    from iris_sysid.errors import UnknownNameError as UnknownNameError
    from iris_sysid.errors import VideoError as VideoError
    from iris_sysid.io.csv_read import read_track as read_track
    from iris_sysid.io.csv_read import read_trajectory as read_trajectory
    from iris_sysid.io.csv_write import write_track as write_track
    from iris_sysid.io.csv_write import write_trajectory as write_trajectory
    from iris_sysid.io.dataframes import estimates_frame as estimates_frame
    from iris_sysid.io.dataframes import to_frame as to_frame
    from iris_sysid.io.frame_read import from_frame as from_frame
    from iris_sysid.io.osp_tracker import marked_tracks as marked_tracks
    from iris_sysid.io.osp_tracker import read_osp as read_osp
    from iris_sysid.pipeline import observe as observe
    from iris_sysid.pipeline import run as run
    from iris_sysid.pipeline import save as save
    from iris_sysid.pipeline import track as track
    from iris_sysid.registry import DETECTORS as DETECTORS
    from iris_sysid.registry import EFFECTS as EFFECTS
    from iris_sysid.registry import LINKERS as LINKERS
    from iris_sysid.registry import MEASURERS as MEASURERS
    from iris_sysid.registry import MODELS as MODELS
    from iris_sysid.registry import PHENOMENA as PHENOMENA
    from iris_sysid.registry import TRACKERS as TRACKERS
    from iris_sysid.report.clip_page import write_report as write_report
    from iris_sysid.report.diagnosis_page import write_diagnosis as write_diagnosis
    from iris_sysid.report.diagnosis_text import diagnosis_sentence as diagnosis_sentence
    from iris_sysid.report.diagnosis_text import diagnosis_text as diagnosis_text
    from iris_sysid.report.fit_report import fit_report as fit_report
    from iris_sysid.report.notebook import to_html as to_html
    from iris_sysid.report.plots import plot as plot
    from iris_sysid.report.text import discovery_sentence as discovery_sentence
    from iris_sysid.review.notebook import review_widget as review_widget
    from iris_sysid.stages import detect as detect
    from iris_sysid.stages import link as link
    from iris_sysid.stages import measure as measure
    from iris_sysid.synthetic.board import render_checkerboard as render_checkerboard
    from iris_sysid.synthetic.clip import render_clip as render_clip
    from iris_sysid.synthetic.scene import SCENES as SCENES
    from iris_sysid.synthetic.truth import Truth as Truth
    from iris_sysid.synthetic.truth import read_truth as read_truth
    from iris_sysid.trajectory.segmentation import segment as segment
    from iris_sysid.trajectory.smoothing import smooth as smooth
    from iris_sysid.types import Array as Array
    from iris_sysid.types import Calibration as Calibration
    from iris_sysid.types import ClipOptions as ClipOptions
    from iris_sysid.types import Detections as Detections
    from iris_sysid.types import Detector as Detector
    from iris_sysid.types import Diagnosis as Diagnosis
    from iris_sysid.types import Discovery as Discovery
    from iris_sysid.types import Doubt as Doubt
    from iris_sysid.types import Effect as Effect
    from iris_sysid.types import EffectExample as EffectExample
    from iris_sysid.types import Estimate as Estimate
    from iris_sysid.types import Event as Event
    from iris_sysid.types import FitResult as FitResult
    from iris_sysid.types import Frame as Frame
    from iris_sysid.types import FrameSource as FrameSource
    from iris_sysid.types import GeometryOptions as GeometryOptions
    from iris_sysid.types import LinearModel as LinearModel
    from iris_sysid.types import Linker as Linker
    from iris_sysid.types import LinkOptions as LinkOptions
    from iris_sysid.types import Measurer as Measurer
    from iris_sysid.types import ModelExample as ModelExample
    from iris_sysid.types import OdeModel as OdeModel
    from iris_sysid.types import Parameter as Parameter
    from iris_sysid.types import Phenomenon as Phenomenon
    from iris_sysid.types import PooledFit as PooledFit
    from iris_sysid.types import Quantity as Quantity
    from iris_sysid.types import Run as Run
    from iris_sysid.types import Segment as Segment
    from iris_sysid.types import Smoothed as Smoothed
    from iris_sysid.types import Track as Track
    from iris_sysid.types import Tracker as Tracker
    from iris_sysid.types import TrackerExample as TrackerExample
    from iris_sysid.types import TrackMark as TrackMark
    from iris_sysid.types import TrackOptions as TrackOptions
    from iris_sysid.types import TrackQuality as TrackQuality
    from iris_sysid.types import Trajectory as Trajectory
    from iris_sysid.types import Transfer as Transfer
    from iris_sysid.types import Validation as Validation
    from iris_sysid.types import Verdict as Verdict
    from iris_sysid.types import View as View
    from iris_sysid.video.array_frames import frames_from_array as frames_from_array
    from iris_sysid.video.reader import open_video as open_video

DISTRIBUTION = "iris-sysid"

# where each public name is defined
_HOME = {
    name: module
    for module, names in {
        "fitters.compose_effects": "with_effects",
        "fitters.ode.identifiability": "identifiability",
        "fitters.ode.lmfit_minimizer": "lmfit_minimizer",
        "fitters.ode.prediction": "predict",
        "fitters.ode.request": "FitOptions",
        "fitters.ode.several_clips": "fit_clips",
        "fitters.ode.simulation": "simulate",
        "fitters.ode.single_clip": "fit",
        "fitters.own_model.equation": "model_from_equation",
        "fitters.own_model.function": "model_from_function",
        "fitters.selection.select": "select_model",
        "fitters.sindy.as_pysindy": "to_pysindy",
        "fitters.sindy.discover": "discover",
        "fitters.validation_record": "split_record validate_fit",
        "iris_sysid.calibration.board.calibrate": "calibrate_board",
        "iris_sysid.calibration.calibration_json": "read_calibration write_calibration",
        "iris_sysid.calibration.known_size": "plane_from_ball plane_from_distance plane_from_size",
        "iris_sysid.calibration.pixel_scale": "scale scale_bar scale_from_text uncalibrated from_osp to_world",
        "iris_sysid.diagnosis.diagnose": "diagnose",
        "iris_sysid.diagnosis.planning.changes": "SetUpChange",
        "iris_sysid.diagnosis.planning.decide": "Decision decide",
        "iris_sysid.diagnosis.planning.plan": "Plan Proposal plan",
        "iris_sysid.errors": (
            "IrisError VideoError TrackingError CalibrationError DataError FitError UnknownNameError "
            "PluginError OutputError"
        ),
        "iris_sysid.io.csv_read": "read_track read_trajectory",
        "iris_sysid.io.csv_write": "write_track write_trajectory",
        "iris_sysid.io.dataframes": "to_frame estimates_frame",
        "iris_sysid.io.frame_read": "from_frame",
        "iris_sysid.io.osp_tracker": "read_osp marked_tracks",
        "iris_sysid.pipeline": "run track observe save",
        "iris_sysid.registry": "TRACKERS DETECTORS LINKERS MEASURERS MODELS EFFECTS PHENOMENA",
        "iris_sysid.report.clip_page": "write_report",
        "iris_sysid.report.diagnosis_page": "write_diagnosis",
        "iris_sysid.report.fit_report": "fit_report",
        "iris_sysid.report.notebook": "to_html",
        "iris_sysid.report.plots": "plot",
        "iris_sysid.report.diagnosis_text": "diagnosis_sentence diagnosis_text",
        "iris_sysid.report.text": "discovery_sentence",
        "iris_sysid.review.notebook": "review_widget",
        "iris_sysid.stages": "detect link measure",
        "iris_sysid.synthetic.board": "render_checkerboard",
        "iris_sysid.synthetic.clip": "render_clip",
        "iris_sysid.synthetic.scene": "SCENES",
        "iris_sysid.synthetic.truth": "Truth read_truth",
        "iris_sysid.trajectory.segmentation": "segment",
        "iris_sysid.trajectory.smoothing": "smooth",
        "iris_sysid.types": (
            "Array Calibration ClipOptions Detections Detector Diagnosis Discovery Doubt Effect EffectExample Estimate "
            "Event FitResult Frame FrameSource GeometryOptions LinearModel Linker LinkOptions Measurer ModelExample "
            "OdeModel Parameter Phenomenon PooledFit Quantity Run Segment Smoothed Track TrackMark TrackQuality "
            "Tracker TrackerExample TrackOptions Trajectory Transfer Validation Verdict View"
        ),
        "iris_sysid.video.array_frames": "frames_from_array",
        "iris_sysid.video.reader": "open_video",
    }.items()
    for name in names.split()
}

__all__ = sorted(_HOME)


def __getattr__(name: str) -> Any:
    if name not in _HOME:
        raise AttributeError(f"module 'iris_sysid' has no attribute {name!r}")
    return getattr(importlib.import_module(_HOME[name]), name)


def __dir__() -> list[str]:
    return list(__all__)

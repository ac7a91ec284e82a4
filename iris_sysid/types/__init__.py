"""Data types that pass between the stages: frozen, and checked when they are made.

Arrays are read-only and float64 unless stated otherwise. NaN means "not known";
``valid`` marks those samples explicitly. Pixels: x right, y down, origin at the centre of pixel (0, 0).
World: x right, z up.
"""

from iris_sysid.types._arrays import Array as Array
from iris_sysid.types._arrays import Mask as Mask
from iris_sysid.types._arrays import frozen_array as frozen_array
from iris_sysid.types._arrays import frozen_mask as frozen_mask
from iris_sysid.types._arrays import increasing_times as increasing_times
from iris_sysid.types._calibration import N_VALUES as N_VALUES
from iris_sysid.types._calibration import Calibration as Calibration
from iris_sysid.types._calibration import VerticalSource as VerticalSource
from iris_sysid.types._clip import TRACK_SIGMAS as TRACK_SIGMAS
from iris_sysid.types._clip import Frame as Frame
from iris_sysid.types._clip import FrameSource as FrameSource
from iris_sysid.types._clip import Track as Track
from iris_sysid.types._clip import TrackOptions as TrackOptions
from iris_sysid.types._departure import DEPARTURE_SIGMAS as DEPARTURE_SIGMAS
from iris_sysid.types._departure import N_REST_SAMPLES as N_REST_SAMPLES
from iris_sysid.types._departure import departure as departure
from iris_sysid.types._diagnosis import Diagnosis as Diagnosis
from iris_sysid.types._diagnosis import DiagnosticNote as DiagnosticNote
from iris_sysid.types._diagnosis import Errors as Errors
from iris_sysid.types._diagnosis import Limit as Limit
from iris_sysid.types._diagnosis import NoteKind as NoteKind
from iris_sysid.types._diagnosis import Score as Score
from iris_sysid.types._discovery import DiscoveredEquation as DiscoveredEquation
from iris_sysid.types._discovery import DiscoveredTerm as DiscoveredTerm
from iris_sysid.types._discovery import Discovery as Discovery
from iris_sysid.types._discovery import Match as Match
from iris_sysid.types._distributions import chi2_isf as chi2_isf
from iris_sysid.types._distributions import chi2_ppf as chi2_ppf
from iris_sysid.types._distributions import chi2_sf as chi2_sf
from iris_sysid.types._distributions import normal_cdf as normal_cdf
from iris_sysid.types._distributions import normal_isf as normal_isf
from iris_sysid.types._distributions import student_ppf as student_ppf
from iris_sysid.types._distributions import student_sf as student_sf
from iris_sysid.types._error_autocorrelation import ErrorAutocorrelation as ErrorAutocorrelation
from iris_sysid.types._model import Effect as Effect
from iris_sysid.types._model import EffectExample as EffectExample
from iris_sysid.types._model import Event as Event
from iris_sysid.types._model import ModelExample as ModelExample
from iris_sysid.types._model import OdeModel as OdeModel
from iris_sysid.types._model import Parameter as Parameter
from iris_sysid.types._model import ParameterRole as ParameterRole
from iris_sysid.types._model import RightHandSide as RightHandSide
from iris_sysid.types._motion import MotionKind as MotionKind
from iris_sysid.types._motion import Segment as Segment
from iris_sysid.types._motion import SegmentLabel as SegmentLabel
from iris_sysid.types._motion import Smoothed as Smoothed
from iris_sysid.types._motion import Trajectory as Trajectory
from iris_sysid.types._numbers import NORMAL_975 as NORMAL_975
from iris_sysid.types._numbers import Estimate as Estimate
from iris_sysid.types._numbers import Quantity as Quantity
from iris_sysid.types._numbers import symbol_of as symbol_of
from iris_sysid.types._numbers import unit_suffix as unit_suffix
from iris_sysid.types._plugins import BenchmarkClass as BenchmarkClass
from iris_sysid.types._plugins import Phenomenon as Phenomenon
from iris_sysid.types._plugins import Tracker as Tracker
from iris_sysid.types._plugins import TrackerExample as TrackerExample
from iris_sysid.types._progress import Progress as Progress
from iris_sysid.types._progress import part_of_progress as part_of_progress
from iris_sysid.types._progress import with_progress as with_progress
from iris_sysid.types._result import FitProblem as FitProblem
from iris_sysid.types._result import FitReason as FitReason
from iris_sysid.types._result import FitResult as FitResult
from iris_sysid.types._result import FitStatus as FitStatus
from iris_sysid.types._result import Identifiability as Identifiability
from iris_sysid.types._result import PooledFit as PooledFit
from iris_sysid.types._result import Population as Population
from iris_sysid.types._run import ClipOptions as ClipOptions
from iris_sysid.types._run import GeometryOptions as GeometryOptions
from iris_sysid.types._run import Run as Run
from iris_sysid.types._selection import ModelCandidate as ModelCandidate
from iris_sysid.types._selection import ModelChoice as ModelChoice

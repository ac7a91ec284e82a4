"""What the JSON files hold: one class each, from which the published JSON Schemas are made.

A new kind of file is one class with its own ``document`` and ``version``, entered in ``DOCUMENTS``. In every
file ``null`` stands for a number that is not known or not finite.
"""

from iris_sysid.io.schemas._beside import BrightnessEntry as BrightnessEntry
from iris_sysid.io.schemas._beside import CalibrationDocument as CalibrationDocument
from iris_sysid.io.schemas._beside import CameraMotionEntry as CameraMotionEntry
from iris_sysid.io.schemas._beside import OriginDocument as OriginDocument
from iris_sysid.io.schemas._beside import Smoothing as Smoothing
from iris_sysid.io.schemas._classroom import GroupDocument as GroupDocument
from iris_sysid.io.schemas._diagnosis import DiagnosisDocument as DiagnosisDocument
from iris_sysid.io.schemas._discovery import DiscoveryDocument as DiscoveryDocument
from iris_sysid.io.schemas._discovery import TermEntry as TermEntry
from iris_sysid.io.schemas._fit import CandidateEntry as CandidateEntry
from iris_sysid.io.schemas._fit import ClipEntry as ClipEntry
from iris_sysid.io.schemas._fit import ClipsEntry as ClipsEntry
from iris_sysid.io.schemas._fit import FitDocument as FitDocument
from iris_sysid.io.schemas._fit import FittedQuantity as FittedQuantity
from iris_sysid.io.schemas._fit import FittedSegment as FittedSegment
from iris_sysid.io.schemas._fit import IdentifiabilityEntry as IdentifiabilityEntry
from iris_sysid.io.schemas._fit import PopulationEntry as PopulationEntry
from iris_sysid.io.schemas._fit import SelectionEntry as SelectionEntry
from iris_sysid.io.schemas._fit import UsedSamples as UsedSamples
from iris_sysid.io.schemas._parts import Document as Document
from iris_sysid.io.schemas._parts import EstimateEntry as EstimateEntry
from iris_sysid.io.schemas._parts import Number as Number
from iris_sysid.io.schemas._parts import Part as Part
from iris_sysid.io.schemas._parts import VerdictEntry as VerdictEntry
from iris_sysid.io.schemas._parts import number as number
from iris_sysid.io.schemas._parts import why_null as why_null
from iris_sysid.io.schemas._plan import ChangeEntry as ChangeEntry
from iris_sysid.io.schemas._plan import LimitsDocument as LimitsDocument
from iris_sysid.io.schemas._plan import NeedEntry as NeedEntry
from iris_sysid.io.schemas._plan import PlanDocument as PlanDocument
from iris_sysid.io.schemas._plan import PrecisionEntry as PrecisionEntry
from iris_sysid.io.schemas._plan import ProposalEntry as ProposalEntry
from iris_sysid.io.schemas._validation import LinearModelEntry as LinearModelEntry
from iris_sysid.io.schemas._validation import ValidationEntry as ValidationEntry

DOCUMENTS: dict[str, type[Document]] = {
    "fit": FitDocument,
    "diagnosis": DiagnosisDocument,
    "discovery": DiscoveryDocument,
    "calibration": CalibrationDocument,
    "origin": OriginDocument,
    "plan": PlanDocument,
    "detection-limits": LimitsDocument,
    "group": GroupDocument,
}

from .extended import ExtendedModel as ExtendedModel
from .extended import Fact as Fact
from .extended import extended_model as extended_model
from .notes import BevameterCode as BevameterCode
from .notes import DiagnosisCode as DiagnosisCode
from .notes import FitCode as FitCode
from .notes import LackCode as LackCode
from .notes import SinkageCode as SinkageCode

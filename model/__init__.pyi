from .extended import ExtendedModel as ExtendedModel
from .extended import Fact as Fact
from .extended import extended_model as extended_model
from .notes import DiagnosisCode as DiagnosisCode
from .notes import LackCode as LackCode

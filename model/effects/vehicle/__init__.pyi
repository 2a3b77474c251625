from .tyre_flattening import REFERENCE_KPA as REFERENCE_KPA

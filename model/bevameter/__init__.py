"""Terrain parameters from bevameter tests (the paper's Tab. 1): plates give k_c, k_phi, n; shear tests c, phi, K.

Source: Bekker (1969), Introduction to Terrain-Vehicle Systems; Wong (1980), J. Terramechanics 17(1).
"""

from daq.bench_tables import PlateTest, ShearTest
from model.bevameter.joint import JointFit
from model.bevameter.plates import PlateFit, fit_plate
from model.bevameter.pressure_sinkage import PressureSinkage, fit_pressure_sinkage
from model.bevameter.shear_strength import ShearStrength, fit_shear_strength
from model.bevameter.shears import ShearFit, fit_shear
from model.bevameter.terrain import terrain_of, terrain_toml
from model.bevameter.window import Window, WindowOptions

__all__ = [
    "JointFit",
    "PlateFit",
    "PlateTest",
    "PressureSinkage",
    "ShearFit",
    "ShearStrength",
    "ShearTest",
    "Window",
    "WindowOptions",
    "fit_plate",
    "fit_pressure_sinkage",
    "fit_shear",
    "fit_shear_strength",
    "terrain_of",
    "terrain_toml",
]

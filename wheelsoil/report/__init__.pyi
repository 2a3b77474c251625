from .build import Report as Report
from .build import build_report as build_report
from .build import find_browser as find_browser
from .content import Drawing as Drawing
from .drawing import Curve as Curve
from .drawing import Plane as Plane
from .drawing import drawn as drawn
from .drawing import reach as reach

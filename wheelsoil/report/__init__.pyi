from .build import Report as Report
from .build import build_report as build_report
from .build import find_browser as find_browser

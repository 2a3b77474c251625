from .diagnosis import diagnose as diagnose
from .looks import look as look
from .samples import coverage_of as coverage_of
from .samples import samples_of as samples_of

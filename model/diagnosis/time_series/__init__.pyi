from .diagnosis import diagnose as diagnose
from .looks import look as look
from .samples import samples_of as samples_of

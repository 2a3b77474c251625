from .base import Effect as Effect
from .base import Needs as Needs
from .base import Parameter as Parameter
from .base import Values as Values
from .catalogue import EFFECTS as EFFECTS
from .catalogue import MEASUREMENT as MEASUREMENT
from .catalogue import PHYSICAL as PHYSICAL
from .catalogue import Library as Library

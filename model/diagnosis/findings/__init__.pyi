from .isolability import CONFOUNDED_COSINE as CONFOUNDED_COSINE
from .isolability import DETECTABLE_D as DETECTABLE_D

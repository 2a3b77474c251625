from .isolability import SEEN as SEEN

from .detectable import SEEN as SEEN

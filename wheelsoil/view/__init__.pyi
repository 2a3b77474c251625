from .campaigns import Files as Files
from .server import serve as serve

from .opening import Files as Files
from .server import serve as serve

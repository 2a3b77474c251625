from .store import clear as clear
from .store import entries as entries
from .store import folder as folder
from .store import limit_bytes as limit_bytes
from .store import nothing_kept as nothing_kept

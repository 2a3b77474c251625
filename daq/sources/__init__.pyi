from .interfaces import open_sink as open_sink
from .player import ReplaySummary as ReplaySummary
from .replaying import replay as replay
from .replaying import replay_batches as replay_batches
from .socketcan import SocketCanSource as SocketCanSource

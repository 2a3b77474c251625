from .field_logger import log as log
from .panel import Command as Command
from .panel import CommandKind as CommandKind
from .panel import Panel as Panel
from .run_files import is_being_recorded as is_being_recorded
from .session_monitor import LogStatus as LogStatus
from .session_monitor import LogSummary as LogSummary
from .session_monitor import Progress as Progress

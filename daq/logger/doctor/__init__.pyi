from .checks import CHECKS as CHECKS
from .checks import Check as Check
from .checks import examine as examine
from .situation import Line as Line
from .situation import Situation as Situation
from .situation import Verdict as Verdict
from .situation import gather as gather

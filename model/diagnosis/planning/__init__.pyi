from .plan import ALIKE as ALIKE
from .plan import Plan as Plan
from .plan import plan_of as plan_of
from .planned_runs import plan_for as plan_for
from .planned_runs import planned_campaign as planned_campaign
from .planned_runs import usual_runs as usual_runs

from .plan import Plan as Plan
from .plan import plan_for as plan_for
from .plan import plan_of as plan_of
from .plan import planned_campaign as planned_campaign
from .plan import usual_runs as usual_runs

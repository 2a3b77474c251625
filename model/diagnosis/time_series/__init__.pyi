from .diagnosis import diagnose as diagnose
from .linearised_campaign import linearise_campaigns as linearise_campaigns
from .samples import coverage_of as coverage_of
from .samples import samples_of as samples_of
from .standstills import ROLLING_RADIUS_SHARE as ROLLING_RADIUS_SHARE
from .standstills import coasted as coasted
from .standstills import rolled as rolled

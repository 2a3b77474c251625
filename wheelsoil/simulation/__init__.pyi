from .campaign import SimulatedCampaign as SimulatedCampaign
from .campaign import simulate_campaign as simulate_campaign
from .campaign import simulated_roles as simulated_roles
from .options import SimulationOptions as SimulationOptions
from .options import parse_effect as parse_effect

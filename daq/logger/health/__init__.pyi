from .monitor import HealthMonitor as HealthMonitor

from .panel import PagePanel as PagePanel

from .panel import open_page as open_page

"""The fitted-model report: one self-contained HTML file and its numbers as JSON."""

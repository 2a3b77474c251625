"""Sections on the runs and their sensors."""

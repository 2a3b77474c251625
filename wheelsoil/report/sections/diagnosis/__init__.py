"""Sections on the diagnosis."""

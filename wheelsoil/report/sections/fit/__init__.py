"""Sections on the fitted models."""

"""Channels to a processed run: pure functions on arrays."""

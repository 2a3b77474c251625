"""MCAP recordings, written and read as columns."""

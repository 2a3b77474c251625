"""Health of a running acquisition: what comes in, what is lost, and what to do about it."""

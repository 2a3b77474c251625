"""Processed runs to parameters, causes and gains. No I/O, no plotting."""

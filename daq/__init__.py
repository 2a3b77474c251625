"""Frames in, recordings out, recordings back in. Knows no slip and no soil."""

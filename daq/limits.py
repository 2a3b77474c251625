"""What readers take at most, each with its reason: a damaged or malicious file must not exhaust memory or time."""

from __future__ import annotations

LARGEST_BLF_CONTAINER_BYTES = 64 << 20
"""Of a BLF container, packed or unpacked. Vector's tools and python-can write 128 KiB."""

MOST_DAMAGED_PARTS = 1000
"""Damaged parts of a log that are kept for the report; behind more of them the file is random bytes."""

MOST_BUSES = 256
"""Buses of a log: the number of a bus is one byte of each frame. Vehicles have fewer than 30."""

MOST_KINDS = 64
"""Kinds of objects or lines that a report lists by name. BLF defines 130, a log has fewer than ten."""

MF4_PATIENCE_S, MF4_BYTES_PER_S = 25.0, 10e6
"""How long asammdf may give nothing: for any file, and how fast it reads a large one before it gives the first frame."""

MF4_MEMORY_BYTES = 2 << 30
"""Address space for asammdf beside twice the size of the file; its libraries take 0.4 GB of it, frames are read in pieces."""

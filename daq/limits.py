"""What readers take at most, each with its reason: a damaged or malicious file must not exhaust memory or time."""

from __future__ import annotations

LARGEST_CHUNK_BYTES = 256 << 20
"""Of a chunk of an MCAP file, unpacked. Writers make chunks of 1 to 4 MB; a camera's images fit in, too."""

LARGEST_BATCH_BYTES = 256 << 20
"""Of chunks that are held in memory together until there are frames enough for a batch."""

LARGEST_BLF_CONTAINER_BYTES = 16 << 20
"""Of a BLF container, packed or unpacked. Vector's tools and python-can write 128 KiB."""

MOST_DAMAGED_PARTS = 1000
"""Damaged parts of a log that are kept for the report; behind more of them the file is random bytes."""

MOST_BUSES = 256
"""Buses of a log: the number of a bus is one byte of each frame. Vehicles have fewer than 30."""

MOST_IDS = 10_000
"""Identifiers without a message in a DBC that are counted one by one; a vehicle's buses have hundreds."""

MOST_KINDS = 64
"""Kinds of objects or lines that a report lists by name. BLF defines 130, a log has fewer than ten."""

LIBRARY_PATIENCE_S, LIBRARY_BYTES_PER_S = 15.0, 10e6
"""How long a library that reads a foreign format may give nothing: for any file, and how fast it reads a large one."""

LIBRARY_MEMORY_BYTES = 2 << 30
"""Address space for such a library beside four times the size of the file; asammdf and its imports take 0.4 GB."""

LONGEST_MESSAGE_BYTES = 4095
"""Of a message in a DBC: what ISO-TP can carry; J1939's transport protocol carries 1785, a CAN FD frame 64."""

LONGEST_ARXML_BITS = 8 * 65_535
"""Of a length or position in an ARXML file, which also describes Ethernet: the longest PDU there."""

MOST_MULTIPLEXER_VALUES = 1_000_000
"""Of all ranges of multiplexed signals in a DBC (SG_MUL_VAL_): cantools makes a list of each."""

MOST_MESSAGES_OF_A_RANGE = 4096
"""Of a range of identifiers in a SYM file: cantools makes a message for each. There are 2,048 of 11 bits."""

LARGEST_DBC_BYTES = 64 << 20
"""Of a DBC file. A whole vehicle takes less than 10 MB; cantools takes 50 times the size in memory."""

MOST_COLUMNS = 10_000
"""Of a CSV table. Tests record hundreds of channels; this many names are a table that lies on its side."""

LARGEST_TOML_BYTES = 4 << 20
"""Of a TOML file that people write. A run of runs.toml takes 150 bytes, a reading of the rut 40."""

DEEPEST_KEY = 32
"""Parts of a dotted key in a TOML file: ours have four at most, and tomllib takes the square of them in time."""

MOST_FAULTS = 100
"""Of a TOML file that are listed one by one."""

MOST_RUNS = 10_000
"""Of runs.toml; a campaign has tens."""

MOST_WHEELS = 60
"""Instrumented ones in vehicle.toml, which are compared with each other."""

EARLIEST_DATE_NS = 631_152_000 * 10**9
"""1990-01-01: a time stamp before it is not a date but counts from some zero of the logger's own."""

LAST_TIME_NS = 2**62
"""The year 2116: time stamps and their differences stay within 64 bits."""

SLOWEST_RATE_HZ, FASTEST_RATE_HZ = 1e-6, 1e9
"""Of samples that have a rate instead of time stamps: one in 12 days, and one a nanosecond."""

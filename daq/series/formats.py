"""The formats of decoded time series, each with its reader, and `read_series`, which reads any of them."""

from __future__ import annotations

import importlib.util
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

from daq import RecordingError, SeriesSection, WheelsoilError, every_error_as
from daq.can.roles import plain_name
from daq.deferred import deferred
from daq.gunzip import unpacked
from daq.logs.frame_tables import is_frame_table
from daq.recording.contents import MAGIC, read_contents
from daq.recording.reader import raw_channels
from daq.recording.series_topics import series_topics
from daq.series.apart import apart
from daq.series.blocks import Blocks, Series, SeriesBlock, SeriesReport, together

Reader = Callable[[Path, SeriesSection, SeriesReport], Series]
_HEAD_BYTES = 4096


@dataclass(frozen=True)
class SeriesFormat:
    """A format of decoded series: its name, the suffixes it goes by, what its files begin with, and its reader."""

    name: str
    suffixes: tuple[str, ...]
    magic: bytes
    read: Reader


_MATLAB = SeriesFormat("MATLAB", (".mat",), b"MATLAB", apart("daq.series.readers.matlab:read_mat"))
_HDF5 = SeriesFormat("HDF5", (".h5", ".hdf5"), b"\x89HDF", apart("daq.series.readers.matlab:read_hdf5"))
_BAG = SeriesFormat("ROS 2 bag", (".db3",), b"SQLite format 3", deferred("daq.series.readers.bags:read_bag"))
_MDF = SeriesFormat("MF4 channels", (".mf4", ".mdf", ".dat"), b"MDF     ", apart("daq.series.readers.mdf:read_mdf"))
_TEXT = SeriesFormat(
    "delimited text", (".csv", ".tsv", ".txt"), b"", deferred("daq.series.readers.delimited:read_delimited")
)
SERIES_FORMATS = (
    SeriesFormat("Parquet", (".parquet", ".pq"), b"PAR1", deferred("daq.series.readers.parquet:read_parquet")),
    _MATLAB,
    _HDF5,
    SeriesFormat("TDMS", (".tdms",), b"TDSm", deferred("daq.series.readers.tdms:read_tdms")),
    SeriesFormat("RPC III", (".rsp", ".rpc", ".tim", ".drv"), b"FORMAT", deferred("daq.series.readers.rpc3:read_rpc3")),
    SeriesFormat("ROS 1 bag", (".bag",), b"#ROSBAG", deferred("daq.series.readers.bags:read_bag")),
    _BAG,
    _MDF,
    _TEXT,
)
"""Every format. A file is of the one whose first bytes it has; a text without any is `_TEXT`."""
SERIES_SUFFIXES = tuple(suffix for known in SERIES_FORMATS for suffix in known.suffixes)
BAG_METADATA = "metadata.yaml"
"""In the folder of a ROS 2 bag."""


def series_format(path: Path) -> SeriesFormat | None:
    """Return the format of decoded series that a file or bag folder has, None where it is a log of frames or no file.

    MF4 files with CAN frames are logs, those with decoded channels only are series; MCAP files of others are bags.
    """
    if path.is_dir():
        return _BAG if (path / BAG_METADATA).is_file() else None
    try:
        with path.open("rb") as plain, unpacked(path, _HEAD_BYTES) as file:
            packed, head = plain.read(_HEAD_BYTES), file.read(_HEAD_BYTES)
    except OSError:
        return None
    if head.startswith(MAGIC):
        return _BAG if _is_foreign(path, head) else None
    if head.startswith(b"\x89HDF"):
        return _MATLAB if path.suffix == ".mat" else _HDF5
    for known in SERIES_FORMATS if head == packed else ():
        if known.magic and head.startswith(known.magic):
            return None if known is _MDF and not _holds_channels(path, path.stat().st_mtime_ns) else known
    name = path.name.lower().removesuffix(".gz")
    is_text = any(name.endswith(suffix) for suffix in _TEXT.suffixes) and not is_frame_table(head)
    return _TEXT if is_text else None


@lru_cache(maxsize=256)
def _holds_channels(path: Path, _changed_ns: int) -> bool:
    """Return whether an MF4 file holds decoded channels and no frames; False without asammdf.

    A file is looked at once while it stays as it is: asammdf starts in a process of its own, which takes seconds.
    """
    if importlib.util.find_spec("asammdf") is None:
        return False
    try:
        return bool(_MDF.read(path, SeriesSection(), SeriesReport(str(path), _MDF.name)).topics)
    except WheelsoilError:  # the reader of frames says what is wrong
        return False


def _is_foreign(path: Path, head: bytes) -> bool:
    """Return whether an MCAP file has neither raw frames nor series of ours."""
    if b"wheelsoil" in head[: len(MAGIC) + 64]:
        return False
    contents = read_contents(path)
    return not raw_channels(contents) and not series_topics(contents)


def read_series(path: Path, layout: SeriesSection | None = None) -> Series:
    """Open a file of decoded series: CSV, Parquet, MAT, HDF5, TDMS, RPC III, ROS bags, MF4 channels.

    Parameters
    ----------
    layout : SeriesSection, optional
        What the file does not say of its layout.

    Raises
    ------
    RecordingError
        It cannot be read, or is of none of these formats.
    DataError
        It has no time column, no rows, or something else that is no series.
    ConfigError
        Its format needs a package that is not installed.
    """
    known = series_format(path)
    if known is None:
        names = ", ".join(file_format.name for file_format in SERIES_FORMATS)
        raise RecordingError.of("not a file of decoded series", path, expected=names, next_step="check the file")
    with every_error_as(RecordingError, "the file cannot be read", lambda: path):
        return known.read(path, layout or SeriesSection(), SeriesReport(str(path), known.name))


def read_all(paths: Sequence[Path], layout: SeriesSection | None = None) -> tuple[Series, list[SeriesReport]]:
    """Open several files of one run as one series; a topic is called after its file.

    Raises as `read_series`.
    """
    if len(paths) == 1:
        single = read_series(paths[0], layout)
        return single, [single.report]
    # a dot would part the name of a file, as a topic, from a signal
    stems = [Path(path.name.removesuffix(".gz")).stem.replace(".", "_") for path in paths]
    opened = [(stem, read_series(path, layout)) for stem, path in zip(stems, paths, strict=True)]
    topics = {_joined(stem, topic): units for stem, series in opened for topic, units in series.topics.items()}

    report = SeriesReport(", ".join(map(str, paths)), "files")

    def stream(stem: str, series: Series) -> Iterator[SeriesBlock]:
        for blocks in series.blocks():
            for block in blocks:
                report.balance.come("rows", len(block))
                report.balance.out += len(block)
                yield SeriesBlock(_joined(stem, block.topic), block.time_ns, block.columns)

    def read() -> Iterator[Blocks]:
        return together([stream(stem, series) for stem, series in opened])

    return Series(topics, read, report), [series.report for _, series in opened]


def _joined(stem: str, topic: str) -> str:
    return stem if topic == "table" else f"{stem}/{plain_name(topic)}"

"""Logs of other programs -> frames, and frames -> candump text; streaming, in bounded memory."""

from daq.logs.candump_writer import write_candump
from daq.logs.formats import LOG_FORMATS, LOG_SUFFIXES, LogFormat
from daq.logs.reading import LogReading, read_log
from daq.logs.report import LogReport

__all__ = ["LOG_FORMATS", "LOG_SUFFIXES", "LogFormat", "LogReading", "LogReport", "read_log", "write_candump"]

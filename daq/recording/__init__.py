"""MCAP recordings, written and read as columns."""

from daq.recording.contents import Loss
from daq.recording.diagnostics import DiagnosticStatus
from daq.recording.events import Event
from daq.recording.gaps import Gap
from daq.recording.part_writer import PartWriter
from daq.recording.reader import Recording, Topic
from daq.recording.recover import Recovery, recover
from daq.recording.run_recording import RunRecording
from daq.recording.writer import RecordingWriter

__all__ = [
    "DiagnosticStatus",
    "Event",
    "Gap",
    "Loss",
    "PartWriter",
    "Recording",
    "RecordingWriter",
    "Recovery",
    "RunRecording",
    "Topic",
    "recover",
]

"""MCAP recordings, written and read as columns."""

from daq.recording.contents import Loss
from daq.recording.reader import Recording, Topic
from daq.recording.recover import Recovery, recover
from daq.recording.writer import RecordingWriter

__all__ = ["Loss", "Recording", "RecordingWriter", "Recovery", "Topic", "recover"]

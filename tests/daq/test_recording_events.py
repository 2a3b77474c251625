"""Events, diagnostics and clock offsets: what is written is read, by us and by others."""

from __future__ import annotations

import struct

import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from property_settings import examples
from recording_support import START_NS, random_frames

from daq import DataError
from daq.can import FrameBatch
from daq.recording import DiagnosticStatus, Event, Recording, RecordingWriter
from daq.recording.chunks import DamagedError
from daq.recording.events import decode_event, encode_diagnostics, encode_event
from daq.recording.format import CdrDecoder

# Lone surrogates are no text, and ROS strings end at a NUL.
TEXT = st.text(st.characters(exclude_categories=["Cs"], exclude_characters="\0"), max_size=40)
TIMES = st.integers(-(2**31) * 10**9, 2**63 - 1)
EVENTS = st.builds(Event, TIMES, TEXT, TEXT, st.sampled_from(["info", "warning", "error"]))
STATUSES = st.builds(DiagnosticStatus, st.integers(0, 3), TEXT, TEXT, TEXT, st.dictionaries(TEXT, TEXT, max_size=4))


@examples(60)
@given(st.lists(EVENTS, max_size=12), st.integers(0, 3), st.sampled_from(["zstd", "lz4", "none"]))
def test_events_come_back_in_the_order_of_the_file(tmp_path_factory, events, flush_every, compression):
    path = tmp_path_factory.mktemp("events") / "run.mcap"
    with RecordingWriter(path, compression=compression, chunk_bytes=300, flush_every_s=None) as writer:
        for number, event in enumerate(events):
            writer.host.write_event(event)
            writer.write_frames(FrameBatch(random_frames(number, 3), ("can0",)))
            if flush_every and number % flush_every == 0:
                writer.flush()
    recording = Recording.open(path)
    assert recording.events() == tuple(events)
    assert recording.loss == ()
    assert len(recording.frames()) == 3 * len(events)


@given(EVENTS, st.data())
def test_a_damaged_event_is_refused_or_read(event, data):
    whole = encode_event(event)
    assert decode_event(whole, max(event.time_ns, 0)) == event
    behind_the_text = 3 * 3 + 5 + 5 + 4
    cut = whole[: data.draw(st.integers(0, len(whole) - behind_the_text - 1))]
    with pytest.raises(DamagedError):
        decode_event(cut, 1)


@given(TIMES.filter(lambda t: t < 2**31 * 10**9), st.lists(STATUSES, max_size=5))
@example(START_NS, [DiagnosticStatus(2, "a", "b", "c", {"d": "e"})])
def test_diagnostics_are_what_their_schema_says(time_ns, statuses):
    message = CdrDecoder(encode_diagnostics(time_ns, statuses))
    assert message.stamp() == time_ns
    assert message.text() == ""
    found = []
    for _ in range(message.uint32()):
        level, name, text, hardware = message.uint8(), message.text(), message.text(), message.text()
        values = {message.text(): message.text() for _ in range(message.uint32())}
        found.append(DiagnosticStatus(level, name, text, hardware, values))
    assert found == statuses


@settings(max_examples=30, deadline=None)
@given(st.lists(STATUSES, max_size=4))
@example([DiagnosticStatus(0, "bus/can0", "ok", "can0", {"rate": "3"}), DiagnosticStatus(3, "µ")])
def test_others_read_the_same_diagnostics(tmp_path_factory, statuses):
    from mcap.reader import make_reader
    from mcap_ros2.decoder import DecoderFactory

    path = tmp_path_factory.mktemp("diagnostics") / "run.mcap"
    with RecordingWriter(path) as writer:
        writer.host.write_diagnostics(START_NS, statuses)
    with path.open("rb") as file:
        reader = make_reader(file, validate_crcs=True, decoder_factories=[DecoderFactory()])
        ((_, _, _, decoded),) = reader.iter_decoded_messages()
    found = [
        DiagnosticStatus(_number(s.level), s.name, s.message, s.hardware_id, {v.key: v.value for v in s.values})
        for s in decoded.status
    ]
    assert found == statuses


def _number(level: int | bytes) -> int:
    return level if isinstance(level, int) else struct.unpack("B", level)[0]


def test_a_level_that_does_not_exist_is_refused(tmp_path):
    with RecordingWriter(tmp_path / "run.mcap") as writer, pytest.raises(DataError, match="level 4"):
        writer.host.write_diagnostics(START_NS, [DiagnosticStatus(4, "x")])


def test_what_is_no_text_does_not_stop_a_recording(tmp_path):
    with RecordingWriter(tmp_path / "run.mcap") as writer:
        writer.host.write_event(Event(START_NS, "ma\0rk", "\ud800"))
    assert Recording.open(tmp_path / "run.mcap").events() == (Event(START_NS, "mark", "?"),)


def test_clock_offsets_are_reported_every_second_and_when_they_change(tmp_path):
    offsets = [0] * 250 + [2_000_000] * 10
    with RecordingWriter(tmp_path / "run.mcap") as writer:
        for number, offset in enumerate(offsets):
            for bus in ("can0", "can1"):
                writer.host.write_clock(START_NS + number * 10_000_000, bus, offset, -offset)
    (topic,) = Recording.open(tmp_path / "run.mcap").topics
    assert (topic.name, topic.message_count) == ("/clock/host", 2 * (3 + 1))


def test_readers_of_frames_skip_what_the_host_tells(tmp_path):
    path = tmp_path / "run.mcap"
    with RecordingWriter(path, flush_every_s=None) as writer:
        writer.write_frames(FrameBatch(random_frames(1, 5), ("can0",)))
        writer.host.write_event(Event(START_NS, "mark", ""))
        writer.host.write_diagnostics(START_NS, [])
        writer.host.write_clock(START_NS, "can0", 1, 2)
    contents = Recording.open(path).contents
    assert [len(chunk.channel_ids or ()) for chunk in contents.chunks] == [1, 3]

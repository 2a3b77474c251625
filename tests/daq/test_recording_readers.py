"""Independent readers (mcap with mcap-ros2-support, rosbags) see the numbers that were written."""

from __future__ import annotations

import json
import re

import numpy as np
import pytest
from logger_support import Clocks
from recording_support import START_NS, random_frames, with_mcap_ros2

from daq.can import FrameBatch, split
from daq.recording import DiagnosticStatus, Event, Recording, RecordingWriter
from daq.recording.decoded_topics import field_names
from daq.recording.format import TopicNames, snake_case

# Names as vendors write them: keywords, digits first, doubles once in snake case, words of the formats themselves.
SIGNALS = ["Fx", "fx", "2ndGear", "class", "header", "Drehmoment°", "µ", "WheelSpeedFL", "uint8", "string", "stamp"]
UNITS = dict(zip(SIGNALS, ["N", "kN", "", "", "", "Nm", "", "km/h", "", "", "s"], strict=True))
COUNT = 40
TIMES = START_NS + np.arange(COUNT) * 10_000_000 + np.arange(COUNT) ** 2
VALUES = {name: np.random.default_rng(i).normal(size=COUNT) * 10.0**i for i, name in enumerate(SIGNALS[:-1])}
VALUES["Fx"][3] = np.nan
LATITUDE = np.linspace(48, 49, COUNT)
EVENTS = [
    Event(START_NS + 5, "mark", "Ω: soft\nspot"),
    Event(START_NS + 10**9, "bus", "", "error"),
    Event(START_NS - 10**9, "clock", "x" * 5000, "warning"),
]
STATUSES = [
    DiagnosticStatus(0, "bus/can0", "as usual", "can0", {"rate": "3200 /s", "µ": ""}),
    DiagnosticStatus(2, "disk"),
    DiagnosticStatus(3, "gnss", "kein Fix", values={"age": "20 s"}),
]
CLOCK = [(START_NS, "can0", 10**18, 0), (START_NS + 1, "2nd-Bus", -5, 7)]
FRAMES = {
    False: random_frames(1, 3000, bus_count=2),
    True: random_frames(2, 300, fd=True, bus_count=2),
}


@pytest.fixture(scope="module", params=["zstd", "lz4", "none"])
def recording(request, tmp_path_factory):
    path = tmp_path_factory.mktemp("readers") / "run.mcap"
    with RecordingWriter(path, attachments={"a.dbc": b"VERSION"}, compression=request.param) as writer:
        for frames in FRAMES.values():
            for batch in split(FrameBatch(frames, ("can0", "2nd-Bus")), 500):
                writer.write_frames(batch)
                writer.flush()
        writer.decoded.write("WFT_Force", "can0", TIMES, VALUES, UNITS)
        writer.decoded.write("raw", "can0", TIMES, {"V": VALUES["Fx"]}, {"V": "m/s"})
        writer.decoded.write_position("can0", TIMES, LATITUDE, -LATITUDE)
        for event in EVENTS:
            writer.host.write_event(event)
            writer.flush()
        writer.host.write_diagnostics(START_NS, STATUSES)
        writer.host.write_diagnostics(START_NS + 10**9, [])
        for offsets in CLOCK:
            writer.host.write_clock(*offsets)
    return path


def with_rosbags(path):
    from rosbags.highlevel import AnyReader
    from rosbags.typesys import Stores, get_typestore

    with AnyReader([path], default_typestore=get_typestore(Stores.ROS2_HUMBLE)) as reader:
        for connection, log_time_ns, data in reader.messages():
            yield connection.topic, log_time_ns, reader.deserialize(data, connection.msgtype)


@pytest.fixture(params=[with_mcap_ros2, with_rosbags], ids=["mcap-ros2-support", "rosbags"])
def topics(request, recording):
    """Return the messages of each topic, as an independent reader gives them."""
    found: dict[str, list[tuple[int, object]]] = {}
    for topic, log_time_ns, message in request.param(recording):
        found.setdefault(topic, []).append((log_time_ns, message))
    return found


def test_every_topic_is_there(topics):
    raw = {f"/can/{bus}/{kind}" for bus in ("can0", "x_2nd_bus") for kind in ("raw", "raw_fd")}
    campaigns = {"/can/can0/wft_force", "/can/can0/raw_2", "/can/can0/position"}
    assert topics.keys() == {*raw, *campaigns, "/events", "/diagnostics", "/clock/host"}


@pytest.mark.parametrize("fd", [False, True])
@pytest.mark.parametrize(("number", "bus"), [(0, "can0"), (1, "x_2nd_bus")])
def test_raw_frames(topics, fd, number, bus):
    expected = FRAMES[fd][FRAMES[fd]["bus"] == number]
    messages = topics[f"/can/{bus}/{'raw_fd' if fd else 'raw'}"]
    frames = [frame for _, message in messages for frame in message.frames]
    for name in ("time_ns", "can_id", "bus", "flags", "length", "reserved"):
        assert [getattr(frame, name) for frame in frames] == expected[name].tolist()
    assert [bytes(frame.data) for frame in frames] == [bytes(row) for row in expected["data"]]
    for log_time_ns, message in messages:
        assert log_time_ns == message.frames[-1].time_ns == stamp_ns(message)


def test_decoded_messages(topics):
    messages = topics["/can/can0/wft_force"]
    assert [log_time_ns for log_time_ns, _ in messages] == TIMES.tolist()
    assert [stamp_ns(message) for _, message in messages] == TIMES.tolist()
    for signal, field in zip(SIGNALS, field_names(SIGNALS), strict=True):
        found = np.array([getattr(message, field) for _, message in messages])
        np.testing.assert_array_equal(found, VALUES.get(signal, np.full(COUNT, np.nan)))


def test_positions(topics):
    messages = [message for _, message in topics["/can/can0/position"]]
    assert [message.latitude for message in messages] == LATITUDE.tolist()
    assert [message.longitude for message in messages] == (-LATITUDE).tolist()
    assert all(np.isnan(message.altitude) and message.status.status == 0 for message in messages)


def test_events(topics):
    levels = {"info": 20, "warning": 30, "error": 40}
    expected = [(event.time_ns, levels[event.severity], event.name, event.text) for event in EVENTS]
    messages = sorted(topics["/events"], key=lambda pair: [event.time_ns for event in EVENTS].index(pair[0]))
    assert [(time_ns, message.level, message.name, message.msg) for time_ns, message in messages] == expected
    assert [in_ns(message.stamp) for _, message in messages] == [event.time_ns for event in EVENTS]
    assert {(message.file, message.function, message.line) for _, message in messages} == {("", "", 0)}


def test_diagnostics(topics):
    (time_ns, message), (_, empty) = topics["/diagnostics"]
    assert time_ns == stamp_ns(message) == START_NS
    assert not empty.status
    for found, status in zip(message.status, STATUSES, strict=True):
        level = found.level if isinstance(found.level, int) else int.from_bytes(found.level)
        assert level == status.level
        assert (found.name, found.message, found.hardware_id) == (status.name, status.message, status.hardware_id)
        assert {pair.key: pair.value for pair in found.values} == status.values


def test_clock(topics):
    found = [
        (m.time_ns, m.header.frame_id, m.realtime_minus_monotonic_ns, m.file_minus_realtime_ns)
        for _, m in topics["/clock/host"]
    ]
    assert found == CLOCK


def stamp_ns(message) -> int:
    return in_ns(message.header.stamp)


def in_ns(stamp) -> int:
    return int(stamp.sec) * 1_000_000_000 + int(stamp.nanosec)


def test_topics_keep_the_original_names_and_units(recording):
    topic = {topic.name: topic for topic in Recording.open(recording).topics}["/can/can0/wft_force"]
    assert (topic.metadata["bus"], topic.metadata["message"]) == ("can0", "WFT_Force")
    described = json.loads(topic.metadata["signals"])
    assert {entry["name"]: entry["unit"] for entry in described.values()} == UNITS
    assert topic.message_count == COUNT


def test_names_are_what_ros_allows_and_unique():
    strange = ["Fx", "FX", "f-x", "", "__", "9", "Ω", "a__b_", "x_", "HTTPServer2", "from", "header", "Fx_2"]
    names = field_names(strange)
    assert len(set(names)) == len(strange)
    assert all(re.fullmatch(r"[a-z][a-z0-9]*(_[a-z0-9]+)*", name) for name in names)
    assert snake_case("HTTPServer2Load") == "http_server2_load"
    hands = TopicNames()
    topics = [
        hands.raw_topic("a-b", False),
        hands.raw_topic("a_b", False),
        hands.topic("a_b", "M"),
        hands.topic("a_b", "m"),
    ]
    assert topics == ["/can/a_b/raw", "/can/a_b_2/raw", "/can/a_b_2/m", "/can/a_b_2/m_2"]
    types = [hands.type_name("can", "frames"), hands.type_name("x", "y"), hands.type_name("X", "y")]
    assert len(set(types)) == 3
    assert "CanFrames" not in types


@pytest.mark.parametrize("step_ns", [1_000_000, 10_000_000, 9_500_000, 1_000_000_000])
@pytest.mark.parametrize("batch", [1, 20, 1000])
def test_decoded_topics_are_thinned_to_the_rate(tmp_path, step_ns, batch):
    rng = np.random.default_rng(3)
    times = START_NS + np.arange(2000) * step_ns + rng.integers(-step_ns // 20, step_ns // 20, 2000)
    with RecordingWriter(tmp_path / "run.mcap", decoded_rate_hz=100.0, flush_every_s=None) as writer:
        for start in range(0, len(times), batch):
            part = times[start : start + batch]
            writer.decoded.write("M", "can0", part, {"v": part * 1.0}, {"v": ""})
    (topic,) = Recording.open(tmp_path / "run.mcap").topics
    span_s = (times[-1] - times[0]) * 1e-9
    if step_ns >= 9_500_000:
        assert topic.message_count == len(times)
    else:
        assert 0.95 * 100 * span_s <= topic.message_count <= 1.2 * 100 * span_s


def test_a_timed_flush_costs_little_and_is_kept(tmp_path):
    frames = random_frames(5, 64_000)
    frames["data"][:, 2:] = 0
    sizes = {}
    for flush_every in (None, 640):
        path = tmp_path / f"{flush_every}.mcap"
        with RecordingWriter(path, flush_every_s=None, sync_every_s=None) as writer:
            for batch in split(FrameBatch(frames, ("can0",)), flush_every or len(frames)):
                writer.write_frames(batch)
                if flush_every:
                    writer.flush()
                    assert path.stat().st_size == writer.bytes_written
        sizes[flush_every] = path.stat().st_size
    assert sizes[640] < 1.1 * sizes[None]
    clocks = Clocks()
    with RecordingWriter(tmp_path / "clock.mcap", flush_every_s=0.05, clock=clocks.seconds) as writer:
        before = writer.bytes_written
        writer.write_frames(FrameBatch(frames[:10], ("can0",)))
        clocks.pass_s(0.049)
        writer.tick()
        assert writer.bytes_written == before
        clocks.pass_s(0.002)
        writer.tick()
        assert writer.bytes_written > before

"""What a cut file defines: every topic of every whole chunk, wherever its definition stands."""

from __future__ import annotations

import struct
from collections import Counter
from pathlib import Path
from types import SimpleNamespace

import pytest
from hypothesis import example, given
from hypothesis import strategies as st
from mcap.exceptions import McapError
from mcap.records import Channel, Message
from mcap.stream_reader import StreamReader
from mcap.writer import Writer
from property_settings import examples
from recording_cuts import write_everything

from daq.recording import Recording, recover
from daq.recording import contents as opening


def counted_by_reading(path: Path) -> Counter[str]:
    """Return the messages a topic, as the ``mcap`` package's reader of streams finds them up to the cut."""
    topics: dict[int, str] = {}
    counts: Counter[str] = Counter()
    with path.open("rb") as file:
        try:
            for record in StreamReader(file).records:
                if isinstance(record, Channel):
                    topics[record.id] = record.topic
                elif isinstance(record, Message):
                    counts[topics[record.channel_id]] += 1
        except (McapError, struct.error):
            pass
    return counts


def counted(path: Path) -> Counter[str]:
    """Return the messages a topic of a whole file."""
    return Counter({topic.name: topic.message_count for topic in Recording.open(path).topics if topic.message_count})


@pytest.fixture(scope="module")
def whole(tmp_path_factory) -> Path:
    path = tmp_path_factory.mktemp("whole") / "run.mcap"
    write_everything(path)
    return path


@pytest.fixture(scope="module", params=["ours", "defined early"])
def written(request, whole) -> Path:
    if request.param == "ours":
        return whole
    early = whole.with_name("early.mcap")
    define_early(whole, early)
    return early


def define_early(source: Path, target: Path) -> None:
    """Copy a file, one message a chunk; each channel is defined in the chunk before the one that uses it first."""
    with source.open("rb") as file:
        records = list(StreamReader(file).records)
    channels = {record.id: record for record in records if isinstance(record, Channel)}
    messages = [record for record in records if isinstance(record, Message)]
    messages.insert(0, messages[0])
    ids: dict[int, int] = {}
    with target.open("wb") as file:
        writer = Writer(file, chunk_size=1)
        writer.start()
        schema = writer.register_schema("a/msg/A", "ros2msg", b"int8 x")
        for i, message in enumerate(messages):
            for needed in messages[i : i + 2]:
                if needed.channel_id not in ids:
                    topic = channels[needed.channel_id].topic
                    ids[needed.channel_id] = writer.register_channel(topic, "cdr", schema)
            writer.add_message(ids[message.channel_id], message.log_time, message.data, message.publish_time)
        writer.finish()


@pytest.mark.hypothesis  # the property is within
def test_recover_finds_what_a_simple_reader_finds_wherever_it_is_cut(written, tmp_path_factory):
    data = written.read_bytes()
    folder = tmp_path_factory.mktemp("cuts")
    cut, clean = folder / "cut.mcap", folder / "clean.mcap"

    @examples(40)
    @given(st.integers(5000, len(data) - 1))
    @example(len(data) - 40)
    def check(size):
        cut.write_bytes(data[:size])
        expected = counted_by_reading(cut)
        if not expected:
            return
        names = {topic.name for topic in Recording.open(cut).topics}
        assert expected.keys() <= names
        done = recover(cut, clean, overwrite=True)
        assert not any("nothing defines" in str(loss) for loss in done.loss)
        assert counted(clean) == counted_by_reading(clean) == expected

    check()


def test_a_chunk_may_use_what_an_earlier_one_defines(tmp_path):
    """Writers of others, and older ones of ours, define a channel in whichever chunk is open then."""
    cut, clean = tmp_path / "cut.mcap", tmp_path / "clean.mcap"
    with cut.open("wb") as file:
        writer = Writer(file, chunk_size=1)
        writer.start()
        schema = writer.register_schema("a/msg/A", "ros2msg", b"int8 x")
        first = writer.register_channel("/A", "cdr", schema)
        writer.add_message(first, 1, bytes(100), 1)
        others = [writer.register_channel(f"/{name}", "cdr", schema) for name in "BC"]
        for channel_id in (first, *reversed(others)):
            writer.add_message(channel_id, 1, bytes(100), 1)
    assert {topic.name for topic in Recording.open(cut).topics} == {"/A", "/B", "/C"}
    done = recover(cut, clean)
    assert done.chunk_count == 4
    assert counted(clean) == {"/A": 2, "/B": 1, "/C": 1}


def test_a_damaged_chunk_takes_no_definition_with_it(whole, tmp_path):
    """Each chunk defines what it is the first to use."""
    data = bytearray(whole.read_bytes()[:-40])
    first = Recording.open(whole).contents.chunks[0]
    data[first.offset + first.size - 10] ^= 0xFF
    (tmp_path / "broken.mcap").write_bytes(data)
    recover(tmp_path / "broken.mcap", tmp_path / "clean.mcap")
    found, expected = counted(tmp_path / "clean.mcap"), counted(whole)
    assert {name for name in expected if found[name] == expected[name]} >= {"/events", "/diagnostics", "/clock/host"}


def test_what_nothing_defines_is_reported_and_searched_once(tmp_path, monkeypatch):
    path = tmp_path / "cut.mcap"
    with path.open("wb") as file:
        writer = Writer(file, chunk_size=1)
        writer.start()
        for _ in range(20):
            writer.add_message(7, 1, bytes(100), 1)
    read: list[int] = []
    really = opening.read_chunk
    monkeypatch.setattr(opening, "read_chunk", lambda file, entry: (read.append(entry.offset), really(file, entry))[1])
    assert Recording.open(path).topics == ()
    assert len(read) == len(set(read)) == 20
    done = recover(path, tmp_path / "clean.mcap")
    assert done.chunk_count == 0
    assert sum("nothing defines" in str(loss) for loss in done.loss) == 20


def test_a_channel_is_defined_with_its_schema_where_it_has_one(tmp_path):
    contents = opening.Contents(tmp_path, 0, schemas={5: SimpleNamespace(id=5)})
    contents.channels |= {number: SimpleNamespace(schema_id=of) for number, of in ((1, 0), (2, 5), (3, 9))}
    assert [contents.is_defined(number) for number in range(1, 5)] == [True, True, False, False]

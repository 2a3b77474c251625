"""A text file reads alike with the line ends of Windows, and with the byte-order mark of its editors."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest
from fuzz.readers import FORMATS, whole_file

from daq import ConfigError, read_toml
from daq.can import load_database
from daq.logs import read_log
from daq.series import read_series


def frames(path: Path) -> object:
    return b"".join(batch.frames.tobytes() for batch in read_log(path))


def columns(path: Path) -> object:
    blocks = [one for some in read_series(path).blocks() for one in some]
    return [(one.time_ns.tolist(), [(name, column.tolist()) for name, column in one.columns.items()]) for one in blocks]


def messages(path: Path) -> object:
    return load_database(path).messages


def whole(name: str) -> Callable[[Path], object]:
    return lambda path: repr(FORMATS[name].read(path))


CONTENT: dict[str, Callable[[Path], object]] = {
    **dict.fromkeys(("candump", "asc", "trc", "frames in csv", "busmaster"), frames),
    "series in csv": columns,
    **{name: whole(name) for name in ("table", "vehicle.toml", "terrain.toml")},
    **dict.fromkeys(("dbc", "kcd", "sym", "arxml"), messages),
}


@pytest.mark.parametrize("name", CONTENT)
def test_it_reads_alike(name: str, tmp_path: Path) -> None:
    raw = whole_file(name, tmp_path).replace(b"\r\n", b"\n")
    path = tmp_path / f"text{FORMATS[name].suffix}"
    found = []
    for text in (raw, raw.replace(b"\n", b"\r\n"), *([b"\xef\xbb\xbf" + raw] if name != "candump" else [])):
        path.write_bytes(text)
        found.append(CONTENT[name](path))
    assert found[0] and all(other == found[0] for other in found[1:])


@pytest.mark.parametrize("encoding", ["cp1252", "utf-16"])
def test_a_toml_file_that_is_not_utf_8_says_so(encoding: str, tmp_path: Path) -> None:
    path = tmp_path / "vehicle.toml"
    path.write_bytes('[vehicle]\nname = "Größe 2"\n'.encode(encoding))
    with pytest.raises(ConfigError, match=r"(?s)not UTF-8.*save it as UTF-8"):
        read_toml(path)

"""The page's names and units of channels are those of the table."""

from __future__ import annotations

import re
from pathlib import Path

from daq import ON_TIME_BASE
from wheelsoil import view

PAGE = (Path(view.__file__).parent / "static" / "channels.js").read_text()


def test_the_page_names_channels_as_the_table_does() -> None:
    shown = {
        key: (name, unit) for key, name, unit in re.findall(r'key: "(\w+)", name: "([^"]+)".*unit: "([^"]*)"', PAGE)
    }
    known = {channel.field: (channel.name, channel.unit_text) for channel in ON_TIME_BASE}
    assert len(shown.keys() & known) >= 5
    for key in shown.keys() & known:
        (name, unit), (own_name, own) = shown[key], known[key]
        assert name == own_name and unit in (own, f"k{own}", f"m{own}"), key

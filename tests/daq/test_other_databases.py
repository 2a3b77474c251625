"""KCD, SYM and ARXML databases decode as the DBC that they came from."""

from __future__ import annotations

from pathlib import Path

import cantools
import numpy as np
import pytest
from cli_support import ok
from database_texts import ARXML

from daq.can import Decoder, load_database, shipped_dbc
from daq.errors import DatabaseError
from daq.runs import open_runs

CLAY = Path(__file__).parents[2] / "recordings" / "clay"


@pytest.mark.parametrize("kind", ["kcd", "sym"])
@pytest.mark.parametrize("name", ["wft.dbc", "wheel_speed.dbc", "gnss.dbc"])
def test_what_cantools_writes_decodes_alike(tmp_path: Path, kind: str, name: str) -> None:
    original = load_database(shipped_dbc(name))
    parsed = cantools.database.load_file(shipped_dbc(name))
    path = tmp_path / f"copy.{kind}"
    cantools.database.dump_file(parsed, path)
    copy = load_database(path)
    again = load_database(path.read_bytes(), path.name)  # as a recording carries it
    assert again.messages == copy.messages
    batch = next(open_runs([CLAY / "run-1.mcap"])[0].frame_batches())
    ours = Decoder({"can0": (original,)}).decode(batch)
    theirs = Decoder({"can0": (copy,)}).decode(batch)
    assert ours.keys() == theirs.keys()
    for key, channel in ours.items():
        np.testing.assert_array_equal(theirs[key].values, channel.values)
        assert theirs[key].unit == channel.unit


def test_an_arxml_file_is_a_database(tmp_path: Path) -> None:
    (tmp_path / "system.arxml").write_text(ARXML)
    (message,) = load_database(tmp_path / "system.arxml").messages
    assert (message.name, message.can_id, message.length) == ("Forces", 291, 8)
    assert [(s.name, s.start_bit, s.length_bits) for s in message.signals] == [("Fz", 16, 12)]


def test_a_vehicle_may_name_them(tmp_path: Path) -> None:
    parsed = cantools.database.load_file(shipped_dbc("wft.dbc"))
    cantools.database.dump_file(parsed, tmp_path / "wft.kcd")
    for name in ("wheel_speed.dbc", "gnss.dbc"):
        (tmp_path / name).write_bytes(shipped_dbc(name).read_bytes())
    text = (CLAY / "vehicle.toml").read_text().replace('"wft.dbc"', '"wft.kcd"')
    (tmp_path / "vehicle.toml").write_text(text)
    facts = ok("info", CLAY / "run-1.mcap", "--vehicle", tmp_path / "vehicle.toml", "--json").json
    assert facts[0]["unknown_frames"] == 0 and "wft.kcd" in facts[0]["databases"]["can0"]


@pytest.mark.parametrize("suffix", [".kcd", ".sym", ".arxml"])
def test_a_damaged_one_is_our_error(tmp_path: Path, suffix: str) -> None:
    path = tmp_path / f"broken{suffix}"
    path.write_text("<NetworkDefinition><Bus ")
    with pytest.raises(DatabaseError, match="cantools cannot load this") as caught:
        load_database(path)
    assert str(path) in str(caught.value)

from __future__ import annotations

import json
from dataclasses import dataclass
from enum import IntEnum
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from daq import RunInfo
from wheelsoil.to_json import plain, to_json


class Colour(IntEnum):
    DARK_RED = 3


@dataclass(frozen=True)
class Thing:
    name: str
    values: np.ndarray
    where: Path


def test_every_kind_of_value_becomes_plain():
    thing = Thing("a", np.array([1.5, np.nan, np.inf]), Path("x/y"))
    assert plain(thing) == {"name": "a", "values": [1.5, None, None], "where": "x/y"}
    assert plain({1: {Colour.DARK_RED}, "n": np.int64(4)}) == {"1": ["dark_red"], "n": 4}
    assert plain(np.bool_(True)) is True
    assert plain(RunInfo(id="r", pass_number=2))["pass_number"] == 2


def test_a_value_without_plain_form_is_refused():
    with pytest.raises(TypeError, match="object has no plain form"):
        plain({"x": object()})


@given(st.recursive(st.none() | st.booleans() | st.integers(-(2**53), 2**53) | st.floats() | st.text(), st.lists))
def test_json_is_strict_and_keeps_what_json_can_hold(value):
    def reject(name):
        raise AssertionError(name)

    text = to_json(value)
    back = json.loads(text, parse_constant=reject)
    assert to_json(back) == text

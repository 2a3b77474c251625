"""What no bus can carry in the text of a database: cantools would take gigabytes for such lengths and positions.

The text is looked at before cantools has it. In a DBC and a SYM file a line may end between any two words, so that
statements are searched in the whole text; KCD and ARXML are XML.
"""

from __future__ import annotations

import contextlib
import re
from collections.abc import Callable, Iterator
from typing import Any
from xml.parsers import expat

from daq.errors import shortened
from daq.limits import LONGEST_ARXML_BITS, LONGEST_MESSAGE_BYTES, MOST_MESSAGES_OF_A_RANGE, MOST_MULTIPLEXER_VALUES

MOST_BITS = 8 * LONGEST_MESSAGE_BYTES

Finding = tuple[int, int, str]
"""First and last character of what is too long, and why."""

_STRING = re.compile(r'"(?:[^"\\]|\\.)*"', re.DOTALL)
_DBC_LENGTH = re.compile(r"\bBO_\s+\d+\s+\w+\s*:\s*(\d+)")
_DBC_BITS = re.compile(r"\bSG_\s+\w+(?:\s+\w+)?\s*:\s*(\d+)\s*\|\s*(\d+)")
_DBC_VALUES = re.compile(r"\bSG_MUL_VAL_\s+\d+\s+\w+\s+\w+\s+([\d\s,-]+)")
_RANGE = re.compile(r"(\d+)\s*-\s*(\d+)")
_SYM_LENGTH = re.compile(r"\b(?:Len|DLC)\s*=\s*(\d+)")
_SYM_BITS = re.compile(r"\bSig\s*=\s*\S+\s+(?:[A-Za-z]\w*\s+)?(\d+)")
_SYM_VARIABLE = re.compile(r"\b(?:Var|Mux)\s*=\s*\S+\s+(?:[A-Za-z]\w*\s+)?(\d+)\s*,\s*(\d+)")
_SYM_RANGE = re.compile(r"\bID\s*=\s*([0-9A-Fa-f]+)h\s*-\s*([0-9A-Fa-f]+)h")
_KCD_BITS = ("offset", "length")
_ARXML_BITS = ("LENGTH", "POSITION", "OFFSET")


def too_long(text: str, kind: str) -> list[Finding]:
    """Return what no bus can carry in the text of a "dbc", "sym", "kcd" or "arxml" file."""
    if kind in ("kcd", "arxml"):
        return list(_in_xml(text, _kcd_fault if kind == "kcd" else _arxml_fault))
    plain = _STRING.sub(lambda found: re.sub(r"[^\n]", "_", found[0]), text)  # what people wrote is no statement
    return sorted(_in_dbc(plain) if kind == "dbc" else _in_sym(plain))


def _in_dbc(text: str) -> Iterator[Finding]:
    yield from _messages(text, _DBC_LENGTH)
    yield from _signals(text, _DBC_BITS)
    left = MOST_MULTIPLEXER_VALUES
    for found in _DBC_VALUES.finditer(text):
        for low, high in _RANGE.findall(found[1]):
            left -= max(_count(high) - _count(low), 0) + 1
        if left < 0:
            yield *found.span(), f"more than {MOST_MULTIPLEXER_VALUES:,} values of multiplexers"
            left = 0


def _in_sym(text: str) -> Iterator[Finding]:
    yield from _messages(text, _SYM_LENGTH)
    yield from _signals(text, _SYM_BITS)
    yield from _signals(text, _SYM_VARIABLE)
    for found in _SYM_RANGE.finditer(text):
        if max(len(found[1]), len(found[2])) > 8 or int(found[2], 16) - int(found[1], 16) >= MOST_MESSAGES_OF_A_RANGE:
            yield *found.span(), f"more than {MOST_MESSAGES_OF_A_RANGE:,} identifiers in a range"


def _messages(text: str, length: re.Pattern[str]) -> Iterator[Finding]:
    for found in length.finditer(text):
        if _count(found[1]) > LONGEST_MESSAGE_BYTES:
            yield *found.span(), of_length(found[1])


def _signals(text: str, bits: re.Pattern[str]) -> Iterator[Finding]:
    for found in bits.finditer(text):
        if any(_count(digits) > MOST_BITS for digits in found.groups()):
            yield *found.span(), of_bits()


def of_length(length: object) -> str:
    """Return what is said of a message that is too long."""
    return f"a message of {shortened(str(length))} bytes; at most {LONGEST_MESSAGE_BYTES} are possible"


def of_bits() -> str:
    """Return what is said of a signal that is too long, or too far behind."""
    return f"a signal beyond bit {MOST_BITS}, the last of the longest message"


def _count(digits: str) -> int:
    """Return a number, or one that is too large for anything; Python refuses those of more than 4,300 digits."""
    digits = digits.lstrip("0")
    return int(digits or "0") if len(digits) < 20 else 10**20


def _kcd_fault(path: list[str], attributes: dict[str, str], text: str) -> str:
    tag = path[-1]
    if tag == "Message" and not text and _number(attributes.get("length", "auto")) > LONGEST_MESSAGE_BYTES:
        return of_length(attributes["length"])
    if tag in ("Signal", "Multiplex") and any(_number(attributes.get(key, "0")) > MOST_BITS for key in _KCD_BITS):
        return of_bits()
    return ""


def _arxml_fault(path: list[str], _: dict[str, str], text: str) -> str:
    if path[-1].endswith("FRAME-LENGTH") and _number(text) > LONGEST_MESSAGE_BYTES:
        return of_length(text)
    if path[-1].endswith(_ARXML_BITS) and _number(text) > LONGEST_ARXML_BITS:
        return f"a {path[-1]} of {shortened(text)}; at most {LONGEST_ARXML_BITS:,} are possible"
    return ""


def _number(text: str) -> float:
    """Return the magnitude of a number as KCD and AUTOSAR write it, 0 where it is none."""
    text = text.strip()
    for read in (lambda: int(text, 0), lambda: int(text), lambda: float(text), lambda: float.fromhex(text)):
        try:
            return abs(read())
        except OverflowError:
            return float("inf")
        except ValueError:
            continue
    return float("inf") if len(text) > 4000 and text.isdigit() else 0.0


def _in_xml(text: str, fault: Callable[[list[str], dict[str, str], str], str]) -> Iterator[Finding]:
    """Yield what is too long in XML; what is no XML is left to cantools, which says so."""
    found: list[Finding] = []
    parser = expat.ParserCreate(namespace_separator="}")
    path: list[str] = []
    pieces: list[str] = []

    def note(why: str) -> None:
        start = 0
        for _line in range(parser.CurrentLineNumber - 1):
            start = text.find("\n", start) + 1
        found.append((start, start, why))

    def start(tag: str, attributes: dict[str, str]) -> None:
        path.append(tag.rpartition("}")[2])
        pieces.clear()
        if attributes and (why := fault(path, attributes, "")):
            note(why)

    def end(_: str) -> None:
        if pieces and (why := fault(path, {}, "".join(pieces))):
            note(why)
        pieces.clear()
        path.pop()

    def entity(*_: Any) -> None:
        note("an entity of its own, which no database has")
        raise _StopError

    parser.StartElementHandler, parser.EndElementHandler = start, end
    parser.CharacterDataHandler = pieces.append
    parser.EntityDeclHandler = entity
    with contextlib.suppress(expat.ExpatError, _StopError):
        parser.Parse(text.encode(), True)
    return iter(found)


class _StopError(Exception):
    """What follows need not be read."""

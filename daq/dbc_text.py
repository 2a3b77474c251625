"""The text of a DBC file: its encoding, where cantools stumbles, and what a lenient load leaves out."""

from __future__ import annotations

import re
from collections.abc import Iterable
from dataclasses import dataclass

_BLOCK = re.compile(r"^\s*BO_\s+(\d+)\s+(\S+?)\s*:", re.MULTILINE)
_DANGLING = re.compile(r"^\s*((?:VAL_|SIG_VALTYPE_) \d+ \w+)\s*$", re.MULTILINE)
_OVERLONG = re.compile(r"(Standard|Extended) frame id 0x[0-9a-f]+ is more than (\d+) bits")
_SYNTAX = re.compile(r"[Ii]nvalid syntax at line (\d+), column (\d+)")
_IN_MESSAGE = re.compile(r"^The signals? (\w+)(?: and (\w+) are overlapping| does not fit) in message (\w+)")
_MULTIPLEXER = re.compile(r"\s*SG_\s+\S+\s+(?:m\d+)?M\s*:")
_WITH_SEMICOLON = ("VAL_", "CM_", "BA_", "SIG_VALTYPE_", "VAL_TABLE_", "SIG_GROUP_", "BO_TX_BU_", "SG_MUL_VAL_")
_STATEMENTS = ("BO_", "SG_", *_WITH_SEMICOLON)


@dataclass(frozen=True)
class BadLine:
    """A line that cantools refuses.

    Attributes
    ----------
    number : int
        Counted from 1.
    text : str
    why : str
    end : int
        Last line of what must go with it (the block of a message, a statement of several lines).
    """

    number: int
    text: str
    why: str
    end: int

    def __str__(self) -> str:
        more = f" (and the {self.end - self.number} lines behind it)" if self.end > self.number else ""
        return f"line {self.number}: {self.text.strip()}: {self.why}{more}"


def decode_text(content: bytes) -> str:
    """Return the text of a DBC: UTF-8 where it is that, else Windows-1252 as Vector's tools write it."""
    try:
        text = content.decode("utf-8-sig")
    except UnicodeDecodeError:
        text = content.decode("cp1252", errors="replace")
    return text.replace("\r\n", "\n").replace("\r", "\n")


def bad_lines(text: str, complaint: str) -> list[BadLine]:
    """Return the lines that a complaint of cantools is about; none when it cannot be traced to lines."""
    lines = text.split("\n")
    dangling = _DANGLING.findall(complaint)
    if dangling and "unused" in complaint:
        return _dangling_lines(lines, dangling)
    overlong = _OVERLONG.search(complaint)
    if overlong:
        return _overlong_blocks(lines)
    syntax = _SYNTAX.search(complaint)
    if syntax:
        return _statement_at(lines, int(syntax[1]), int(syntax[2]))
    clash = _IN_MESSAGE.search(complaint)
    return _signal_lines(lines, clash[3], [n for n in clash.group(1, 2) if n], complaint) if clash else []


def without(text: str, bad: Iterable[BadLine]) -> str:
    """Return the text with these lines emptied, so that line numbers stay."""
    lines = text.split("\n")
    for line in bad:
        lines[line.number - 1 : line.end] = [""] * (line.end - line.number + 1)
    return "\n".join(lines)


def _dangling_lines(lines: list[str], names: list[str]) -> list[BadLine]:
    found = []
    for name in names:
        keyword, number, signal = name.split()
        pattern = re.compile(rf"^\s*{keyword}\s+{number}\s+{signal}\b")
        why = f"there is no signal {signal} in a message {number}"
        found += [
            BadLine(i, line, why, _statement_end(lines, i)) for i, line in enumerate(lines, 1) if pattern.match(line)
        ]
    return found


def _overlong_blocks(lines: list[str]) -> list[BadLine]:
    found = []
    for i, line in enumerate(lines, 1):
        block = _BLOCK.match(line)
        if not block:
            continue
        number = int(block[1])
        bits, kind = (29, "a 29-bit") if number & 0x8000_0000 else (11, "an 11-bit")
        if (number & 0x7FFF_FFFF) >> bits:
            why = f"0x{number & 0x7FFFFFFF:X} is too long for {kind} identifier (29-bit ones have bit 31 set in a DBC)"
            found.append(BadLine(i, line, why, _block_end(lines, i)))
    return found


def _statement_at(lines: list[str], number: int, column: int) -> list[BadLine]:
    """Return the statement with a syntax error, or nothing when leaving it out could change its neighbours."""
    if not 1 <= number <= len(lines):
        return []
    line = lines[number - 1]
    why = f"syntax error at column {column}"
    first = line.split(maxsplit=1)[0] if line.strip() else ""
    if first in _STATEMENTS and column > line.index(first) + 1:
        start, end = number, _statement_end(lines, number)
        if first == "BO_" or _MULTIPLEXER.match(line):
            start = _block_start(lines, number)
            end = _block_end(lines, start)
        return [BadLine(start, lines[start - 1], why, end)] if start else []
    before = next((i for i in range(number - 1, 0, -1) if lines[i - 1].strip()), 0)
    unended = before and ";" not in lines[before - 1] and lines[before - 1].split()[0] in _WITH_SEMICOLON
    return [BadLine(before, lines[before - 1], "the statement has no end (;)", before)] if unended else []


def _signal_lines(lines: list[str], message: str, signals: list[str], complaint: str) -> list[BadLine]:
    inside, found = False, []
    for i, line in enumerate(lines, 1):
        block = _BLOCK.match(line)
        inside = block[2] == message if block else inside
        name = re.match(r"\s*SG_\s+(\w+)", line)
        if inside and name and name[1] in signals:
            found.append(BadLine(i, line, complaint.rstrip("."), i))
    return found


def _block_end(lines: list[str], start: int) -> int:
    """Return the last line of the ``BO_`` block that starts at line `start`."""
    end = start
    for i in range(start + 1, len(lines) + 1):
        line = lines[i - 1].strip()
        if re.match(r"SG_\s", line):
            end = i
        elif line and not line.startswith("//"):
            break
    return end


def _block_start(lines: list[str], inside: int) -> int:
    """Return the line of the ``BO_`` that line `inside` belongs to, 0 where there is none."""
    return next((i for i in range(inside, 0, -1) if lines[i - 1].lstrip().startswith("BO_ ")), 0)


def _statement_end(lines: list[str], start: int) -> int:
    """Return the line that ends the statement at line `start`: its own, or for a long text that of its semicolon."""
    if not lines[start - 1].lstrip().startswith(_WITH_SEMICOLON):
        return start
    text = ""
    for i in range(start, len(lines) + 1):
        text += lines[i - 1].replace('\\"', "")
        if text.count('"') % 2 == 0 and ";" in re.sub(r'"[^"]*"', "", text):
            return i
    return start

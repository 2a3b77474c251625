"""Made-up DBCs: random places of signals, and multiplexing of both kinds."""

from __future__ import annotations

from hypothesis import strategies as st

HEAD = 'VERSION ""\nBU_: A\n'
SCALES = st.one_of(
    st.sampled_from(["1", "0.1", "-0.5", "2", "1e-05", "3", "0.0078125", "1.0", "-1"]),
    st.floats(1e-6, 1e6).map(repr),
    st.integers(-1000, 1000).filter(bool).map(str),
)
OFFSETS = st.one_of(st.sampled_from(["0", "-40", "0.5", "-67.67"]), st.floats(-1e6, 1e6).map(repr))


@st.composite
def signals(draw: st.DrawFn) -> tuple[int, str, str]:
    """Message length, ``SG_`` line without its name, and SIG_VALTYPE_ number (0 = integer)."""
    length = draw(st.sampled_from([*range(1, 9), 12, 16, 24, 48, 64]))
    real = draw(st.sampled_from([0, 0, 0, 1, 2]))
    possible = [n for n in {0: range(1, 65), 1: (16, 32), 2: (64,)}[real] if n <= 8 * length]
    if not possible:
        real, possible = 0, list(range(1, 8 * length + 1))
    bits = draw(st.sampled_from(possible))
    first = draw(st.integers(0, 8 * length - bits))
    big = draw(st.booleans())
    start = 8 * (first // 8) + 7 - first % 8 if big else first
    sign = draw(st.sampled_from("+-"))
    line = f'{start}|{bits}@{0 if big else 1}{sign} ({draw(SCALES)},{draw(OFFSETS)}) [0|0] "" A'
    return length, line, str(real)


def dbc(lines: list[tuple[int, str, str]]) -> bytes:
    text = HEAD
    for i, (length, line, _) in enumerate(lines):
        text += f"BO_ {256 + i} M{i}: {length} A\n SG_ S{i} : {line}\n\n"
    for i, (_, _, real) in enumerate(lines):
        text += f"SIG_VALTYPE_ {256 + i} S{i} : {real};\n" if real != "0" else ""
    return text.encode()


MULTIPLEXED = """VERSION ""
BU_: A
BO_ 100 Simple: 8 A
 SG_ Which M : 0|4@1+ (1,0) [0|0] "" A
 SG_ Always : 4|4@1+ (1,0) [0|0] "" A
 SG_ Zero m0 : 8|16@1- (0.1,0) [0|0] "degC" A
 SG_ One m1 : 8|12@1+ (1,0) [0|0] "" A
 SG_ AlsoOne m1 : 31|8@0- (1,0) [0|0] "" A

BO_ 101 Nested: 8 A
 SG_ Outer M : 0|8@1+ (1,0) [0|0] "" A
 SG_ Inner m3M : 8|8@1+ (1,0) [0|0] "" A
 SG_ Plain m1 : 8|8@1+ (2,0) [0|0] "" A
 SG_ Deep m0 : 16|16@1- (1,0) [0|0] "" A
 SG_ Ranged m0 : 32|8@1+ (1,0) [0|0] "" A

BO_ 102 Negative: 8 A
 SG_ Side M : 0|8@1- (1,0) [0|0] "" A
 SG_ Left m255 : 8|8@1+ (1,0) [0|0] "" A
 SG_ Right m1 : 8|8@1+ (1,0) [0|0] "" A

SG_MUL_VAL_ 101 Inner Outer 3-3;
SG_MUL_VAL_ 101 Plain Outer 1-1;
SG_MUL_VAL_ 101 Deep Inner 0-0, 5-9;
SG_MUL_VAL_ 101 Ranged Inner 7-200;
"""

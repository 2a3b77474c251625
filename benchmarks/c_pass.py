"""The same decoding as one pass of generated C: how near numpy comes to what the machine can do."""

from __future__ import annotations

import ctypes
import subprocess
from collections.abc import Callable
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from daq.can import Database, FrameBatch, Message, RawKind, SignalPlan, compile_plan

_HEAD = """#include <math.h>
#include <stdint.h>
#include <string.h>
void decode(const uint8_t *frame, int64_t n, int64_t **times, double **out, int64_t *counts) {
  for (; n > 0; n--, frame += 24) {
    int64_t time; uint32_t id; uint64_t le, be;
    memcpy(&time, frame, 8); memcpy(&id, frame + 8, 4); memcpy(&le, frame + 16, 8);
    if (frame[13] & 7) continue;
    be = __builtin_bswap64(le);
    const int length = frame[14];
    switch (id) {
"""


def compile_pass(folder: Path, known: list[Database]) -> Callable[[FrameBatch], list[NDArray[np.float64]]]:
    """Compile a decoder of 11-bit, 8-byte integer messages with gcc -O3.

    Returns
    -------
    callable
        Of a batch on one bus; gives the columns of all signals, in the order of the databases.
    """
    messages = [message for database in known for message in database.messages]
    body, column = "", 0
    for number, message in enumerate(messages):
        body += f"    case {message.can_id}: {{ int64_t i = counts[{number}]++; times[{number}][i] = time;\n"
        for plan in compile_plan(message).values():
            body += f"      out[{column}][i] = {_value(plan)};\n"
            column += 1
        body += "      break; }\n"
    source, library = folder / "pass.c", folder / "pass.so"
    source.write_text(f"{_HEAD}{body}    }}\n  }}\n}}\n", encoding="utf-8")
    command = ["gcc", "-O3", "-march=native", "-shared", "-fPIC", "-o", str(library), str(source)]
    subprocess.run(command, check=True, capture_output=True)
    function = ctypes.CDLL(str(library)).decode
    return lambda batch: _run(function, batch, messages)


def _value(plan: SignalPlan) -> str:
    physical = f"{_raw(plan)} * {float(plan.signal.scale)!r} + {float(plan.signal.offset)!r}"
    needs = [f"length >= {plan.end_byte}"]
    for field, ids in plan.selection.needs if plan.selection else ():
        word = f"(le >> {8 * field.offset + field.shift} & {(1 << field.length) - 1})"
        needs.append("(" + " || ".join(f"{word} == {value}" for value in ids.tolist()) + ")")
    return f"{' && '.join(needs)} ? {physical} : NAN"


def _raw(plan: SignalPlan) -> str:
    signal = plan.signal
    word, first = ("be", 64 - signal.first_bit - signal.length_bits) if signal.big_endian else ("le", signal.first_bit)
    left, right = 64 - first - signal.length_bits, 64 - signal.length_bits
    kind = "int64_t" if signal.kind is RawKind.SIGNED else "uint64_t"
    return f"(double)(int64_t)(({kind})({word} << {left}) >> {right})"


def _run(function: ctypes._CFuncPtr, batch: FrameBatch, messages: list[Message]) -> list[NDArray[np.float64]]:
    numbers = np.bincount(batch.frames["can_id"], minlength=2048)
    sizes = [int(numbers[message.can_id]) for message in messages]
    times = [np.empty(size, np.int64) for size in sizes]
    columns = [np.empty(size) for message, size in zip(messages, sizes, strict=True) for _ in message.signals]
    counts = np.zeros(len(messages), np.int64)
    function(
        ctypes.c_void_p(batch.frames.ctypes.data),
        ctypes.c_int64(len(batch)),
        (ctypes.c_void_p * len(times))(*(array.ctypes.data for array in times)),
        (ctypes.c_void_p * len(columns))(*(array.ctypes.data for array in columns)),
        ctypes.c_void_p(counts.ctypes.data),
    )
    return columns

"""The harness of the benchmarks: where the table goes, which marks are missed, what is measured."""

import math
import subprocess
import sys
import time
from pathlib import Path

import pytest

from benchmarks.__main__ import NAMES, RESULTS, BenchmarkError, in_own_process, main, run
from benchmarks.table import (
    Mark,
    Row,
    at_least,
    at_most,
    compared,
    compared_with_start,
    judged,
    page,
    rate_of,
    times,
    with_verdict,
)
from benchmarks.timing import command_cost, cpu_seconds, side_by_side

ROOT = Path(__file__).parents[2]
TRACKED = ROOT / "benchmarks" / "results.md"


def spin(seconds: float) -> None:
    """Work for so much processor time."""
    end = time.process_time() + seconds
    while time.process_time() < end:
        pass


def test_the_table_goes_to_out_and_the_tracked_one_stays(tmp_path: Path) -> None:
    tracked = TRACKED.read_bytes()
    results = tmp_path / "bench" / "results.md"
    missed = judged("twice two", "5", 5, at_most(4, "s"))
    assert run(["sums"], results, lambda _: [missed, Row("sums", "4")]) == 0
    whole, marks = (results.with_name(name).read_text(encoding="utf-8") for name in ("results.md", "marks.md"))
    assert all("| twice two | 5 | - | - | <= 4 s | **no** |" in text for text in (whole, marks))
    assert "| sums |" in whole and "| sums |" not in marks
    assert TRACKED.read_bytes() == tracked
    assert RESULTS == ROOT / "out" / "bench" / "results.md"
    assert "/out/" in (ROOT / ".gitignore").read_text(encoding="utf-8").splitlines()


def test_only_bench_keep_renews_the_tracked_table() -> None:
    def recipe(target: str) -> str:
        command = ["make", "--dry-run", "--no-print-directory", target]
        return subprocess.run(command, cwd=ROOT, check=True, capture_output=True, text=True).stdout

    assert "-m benchmarks" in recipe("bench")
    assert str(TRACKED.relative_to(ROOT)) not in recipe("bench")
    assert recipe("bench-keep").splitlines()[-1] == "cp out/bench/marks.md benchmarks/results.md"


def test_a_benchmark_that_fails_is_in_the_table_and_the_others_go_on(tmp_path: Path) -> None:
    def measure(name: str) -> list[Row]:
        if name == "broken":
            raise BenchmarkError("exit status 1")
        return [Row("sound", "1 s")]

    assert run(["broken", "sound"], tmp_path / "results.md", measure) == 1
    assert (tmp_path / "results.md").read_text(encoding="utf-8").splitlines()[-2:] == [
        "| broken: failed | exit status 1 | - | - | stated | - |",
        "| sound | 1 s | - | - | stated | - |",
    ]


def test_a_benchmark_runs_in_a_process_of_its_own() -> None:
    with pytest.raises(BenchmarkError, match="exit status 1"):
        in_own_process("none_of_this_name")


def test_unknown_names_are_refused(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["logs", "bench_nothing"]) == 2
    said = capsys.readouterr().err
    assert "no benchmark nothing" in said
    assert all(name in said for name in NAMES)


@pytest.mark.parametrize(
    ("mark", "reached", "missed", "text"),
    [
        (at_least(4, "x"), 4.0, 3.99, ">= 4x"),
        (at_most(1.5, "s"), 1.5, 1.51, "<= 1.5 s"),
        (at_least(10, "Mframes/s"), math.inf, math.nan, ">= 10 Mframes/s"),
        (at_most(1, "us"), -1.0, math.nan, "<= 1 us"),
    ],
)
def test_a_mark_is_reached_or_missed(mark: Mark, reached: float, missed: float, text: str) -> None:
    assert mark.reached(reached)
    assert not mark.reached(missed)
    assert str(mark) == text
    assert judged("a", "b", missed, mark).line().endswith(f"| {text} | **no** |")
    assert judged("a", "b", reached, mark).line().endswith(f"| {text} | yes |")


def test_a_ratio_above_one_means_that_we_are_faster() -> None:
    as_text = rate_of(1_000_000)
    row = compared("read", [0.1, 0.2, 9.0], "peer", [0.5, 0.1, 0.6], as_text, at_least(2.5, "x"), ", checked")
    assert row == Row("read", "5 Mframes/s, checked", "peer: 2 Mframes/s", "2.50x", ">= 2.5x", True)
    slower = compared("read", [0.2], "peer", [0.1], as_text, at_least(1, "x"))
    assert (slower.ratio, slower.reached) == ("0.50x", False)
    assert compared("read", [0.2], "peer", [0.1], as_text).line().endswith("| 0.50x | stated | - |")
    assert [times(ratio) for ratio in (0.876, 9.64, 85.4, 162.2)] == ["0.88x", "9.64x", "85.4x", "162x"]


def test_a_process_of_ours_may_take_its_start_and_a_multiple_of_the_peer() -> None:
    row = compared_with_start("read", [2.0, 2.0], [0.5, 0.7], "peer", [1.0, 2.0], 1.5, lambda s: f"{s:.2f} s")
    assert row == Row("read", "2.00 s", "start of a process and 1.5 x peer: 2.85 s", "1.43x", ">= 1x", True)


def test_the_page_counts_marks_that_are_set() -> None:
    rows = [judged("a", "1", 1, at_least(2, "x")), judged("b", "1", 1, at_most(2, "x")), Row("c", "1 s")]
    assert "1 of 2 marks reached" in page(rows, 0.1)


def test_functions_take_turns_after_a_call_that_does_not_count() -> None:
    calls: list[str] = []
    found = side_by_side({"a": lambda: calls.append("a"), "b": lambda: calls.append("b")}, 2)
    assert calls == ["a", "b", "a", "b", "a", "b"]
    assert {name: len(seconds) for name, seconds in found.items()} == {"a": 2, "b": 2}


def test_waiting_costs_no_processor_time_and_work_does() -> None:
    assert cpu_seconds(lambda: time.sleep(0.1)) < 0.05
    assert cpu_seconds(lambda: spin(0.05)) >= 0.05
    spinning = "import time\nwhile time.process_time() < 0.1: pass"
    assert cpu_seconds(lambda: subprocess.run([sys.executable, "-c", spinning], check=True)) >= 0.1


@pytest.mark.skipif(not Path("/proc/self/smaps_rollup").exists(), reason="memory of processes is counted by Linux only")
def test_a_command_holds_what_all_its_processes_hold_at_once() -> None:
    holding = "import time; held = b'x' * 40_000_000; time.sleep(0.6)"
    both = f"import subprocess, sys; subprocess.Popen([sys.executable, '-c', {holding!r}]); {holding}"
    assert (
        80 < command_cost([sys.executable, "-c", both]).peak_mb < 80 + command_cost([sys.executable, "-c", ""]).peak_mb
    )


def test_a_wrong_verdict_misses_every_mark() -> None:
    reached, stated = judged("diagnose", "1 s", 1, at_most(2, "s")), Row("diagnose", "1 s")
    assert (
        with_verdict(reached, "named slope", right=True).line()
        == "| diagnose | 1 s, named slope | - | - | <= 2 s | yes |"
    )
    assert with_verdict(reached, "named slope", right=False).line().endswith("<= 2 s, a right verdict | **no** |")
    assert with_verdict(stated, "named slope", right=False).line().endswith("| a right verdict | **no** |")


def test_a_command_costs_what_its_children_cost() -> None:
    spinning = "import time\nwhile time.process_time() < 0.1: pass"
    child = f"import subprocess, sys, time; subprocess.run([sys.executable, '-c', {spinning!r}]); time.sleep(0.2)"
    cost = command_cost([sys.executable, "-c", child])
    assert cost.cpu_s >= 0.1
    assert cost.wall_s >= 0.3
    with pytest.raises(subprocess.CalledProcessError):
        command_cost([sys.executable, "-c", "raise SystemExit(3)"])

"""One thread for linear algebra; processes give the same results in order, and end with their parent."""

from __future__ import annotations

import multiprocessing
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest
from threadpoolctl import threadpool_info, threadpool_limits

from daq import DataError, Fault, FloatArray, WheelsoilError
from model import in_parallel, one_thread, processes
from model.cores import LEAST_ROWS, spread


@pytest.fixture(autouse=True)
def no_process_is_left() -> Iterator[None]:
    """Of those of other tests some may still run."""
    before = set(multiprocessing.active_children())
    yield
    assert set(multiprocessing.active_children()) <= before


def threads() -> set[int]:
    import scipy.linalg  # noqa: F401

    return {pool["num_threads"] for pool in threadpool_info() if pool["user_api"] == "blas"}


@pytest.mark.parametrize("fails", [False, True])
def test_one_thread_inside_and_the_callers_outside(fails: bool) -> None:
    inside = []

    @one_thread
    def work(x: int) -> int:
        inside.append(threads())
        if fails:
            raise ValueError
        return 2 * x

    threads()
    with threadpool_limits(limits=2, user_api="blas"):
        before = threads()
        if fails:
            with pytest.raises(ValueError):
                work(3)
        else:
            assert work(3) == 6
        assert threads() == before
    assert inside == [{1}]


def test_without_a_number_of_processes_all_is_done_here() -> None:
    assert list(in_parallel(lambda _: os.getpid(), range(3))) == [os.getpid()] * 3


IN_PARALLEL = "list(in_parallel(Worker().work, range(4)))"
WITH_SPREAD = "with spread([Worker(), Worker()]) as ask: ask('work', 1)"


@pytest.mark.skipif(sys.platform != "linux", reason="processes are copied on Linux only")
class TestProcesses:
    """Closures over local data, run by copies of this process."""

    def test_results_come_in_the_order_of_the_items(self) -> None:
        offset = np.arange(3.0)

        def work(i: int) -> tuple[int, FloatArray]:
            time.sleep(0.02)
            return os.getpid(), i + offset

        with processes(2):
            found = list(in_parallel(work, range(7)))
        assert os.getpid() in {pid for pid, _ in found} and len({pid for pid, _ in found}) == 2
        np.testing.assert_array_equal([x for _, x in found], np.arange(7.0)[:, None] + offset)

    def test_within_a_process_there_are_no_others(self) -> None:
        def inner(_: int) -> tuple[int, list[int]]:
            return os.getpid(), list(in_parallel(lambda _: os.getpid(), range(3)))

        with processes(2):
            for own, inside in in_parallel(inner, range(2)):
                assert inside == [own] * 3

    def test_an_error_comes_as_it_is(self) -> None:
        def fails(i: int) -> int:
            if i == 1:
                raise DataError(Fault("no samples", "run-2", "none", "some"))
            return i

        with processes(2), pytest.raises(DataError, match="no samples") as caught:
            list(in_parallel(fails, range(3)))
        assert caught.value.faults == (Fault("no samples", "run-2", "none", "some"),)

    def test_a_process_that_ends_is_an_error_with_a_next_step(self) -> None:
        mine = os.getpid()

        def ends(i: int) -> int:
            time.sleep(0.05)
            if os.getpid() != mine:
                os.kill(os.getpid(), signal.SIGKILL)
            return i

        with processes(2), pytest.raises(WheelsoilError, match="--jobs 1"):
            list(in_parallel(ends, range(4)))

    @pytest.mark.parametrize(
        ("sent", "work"),
        [
            (signal.SIGINT, IN_PARALLEL),
            (signal.SIGKILL, WITH_SPREAD),
            pytest.param(signal.SIGINT, WITH_SPREAD, marks=pytest.mark.slow),
            pytest.param(signal.SIGKILL, IN_PARALLEL, marks=pytest.mark.slow),
        ],
    )
    def test_with_the_parent_all_end(self, tmp_path: Path, sent: signal.Signals, work: str) -> None:
        """Ctrl-C and a kill of the parent alone leave nobody working."""
        script = (
            "import os, pathlib, time\n"
            "from model.cores import in_parallel, processes, spread\n"
            f"folder = pathlib.Path({str(tmp_path)!r})\n"
            "class Worker:\n"
            "    def work(self, i):\n"
            "        (folder / str(os.getpid())).touch()\n"
            "        time.sleep(60)\n"
            "with processes(2):\n"
            f"    {work}\n"
        )
        parent = subprocess.Popen([sys.executable, "-c", script], stderr=subprocess.DEVNULL)
        wait_until(lambda: len(list(tmp_path.iterdir())) == 2)
        parent.send_signal(sent)
        parent.wait(20)
        wait_until(lambda: not any(Path(f"/proc/{path.name}").exists() for path in tmp_path.iterdir()))


class Counter:
    """Keeps what it has seen."""

    def __init__(self, name: str) -> None:
        self.name = name
        self.seen: list[int] = []

    def add(self, number: int) -> tuple[str, list[int], int]:
        if number < 0:
            raise DataError(Fault("a negative number", self.name, str(number), "a count"))
        self.seen.append(number)
        return self.name, self.seen, os.getpid()

    def end(self) -> None:
        if self.name == "b":
            os.kill(os.getpid(), signal.SIGKILL)


@pytest.mark.parametrize("count", [1, 2, 3, 9])
def test_spread_objects_keep_what_they_have_seen_in_their_own_process(count: int) -> None:
    with processes(count), spread([Counter(name) for name in "abcd"]) as ask:
        ask("add", 1)
        found = ask("add", 2)
    assert [name for name, _, _ in found] == list("abcd")
    assert all(seen == [1, 2] for _, seen, _ in found)
    assert len({pid for _, _, pid in found}) == (min(count, 4) if sys.platform == "linux" else 1)


@pytest.mark.skipif(sys.platform != "linux", reason="processes are copied on Linux only")
@pytest.mark.parametrize(("rows", "count"), [(LEAST_ROWS - 1, 1), (LEAST_ROWS, 2)])
def test_no_process_is_started_for_little_work(rows: int, count: int) -> None:
    def work(_: int) -> int:
        time.sleep(0.1)
        return os.getpid()

    with processes(2), spread([Counter("a"), Counter("b")], rows=rows) as ask:
        assert len({pid for _, _, pid in ask("add", 1)}) == count
        assert len(set(in_parallel(work, range(4), rows=rows))) == count


@pytest.mark.parametrize("count", [1, 2])
def test_an_error_of_a_spread_object_comes_as_it_is(count: int) -> None:
    with processes(count), spread([Counter(name) for name in "ab"]) as ask:
        with pytest.raises(DataError, match="a negative number") as caught:
            ask("add", -1)
        assert caught.value.faults[0].where == "a"
        assert [seen for _, seen, _ in ask("add", 3)] == [[3], [3]]


@pytest.mark.skipif(sys.platform != "linux", reason="processes are copied on Linux only")
def test_a_process_of_spread_objects_that_ends_is_an_error_with_a_next_step() -> None:
    with processes(2), pytest.raises(WheelsoilError, match="--jobs 1"), spread([Counter(name) for name in "ab"]) as ask:
        ask("end")


def test_nothing_spread_is_nothing() -> None:
    with processes(2), spread([]) as ask:
        assert ask("add", 1) == []


def wait_until(true: Callable[[], bool]) -> None:
    end = time.monotonic() + 20
    while not true():
        assert time.monotonic() < end
        time.sleep(0.02)

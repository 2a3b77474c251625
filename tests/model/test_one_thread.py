"""Linear algebra of the diagnosis runs in one thread, and the caller's setting comes back."""

from __future__ import annotations

import pytest
from threadpoolctl import threadpool_info, threadpool_limits

from model.one_thread import one_thread


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

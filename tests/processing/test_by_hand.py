"""What a person keeps of a run, sample by sample."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from property_settings import examples
from synthetic_run import forces, speeds, vehicle

from daq import ConfigError
from processing import ProcessedRun, Reason, keep_only
from processing.pipeline import process
from wheelsoil.wording.run_summary import summary_table


def run_of_20_s() -> ProcessedRun:
    return process({**speeds(20.0, slip=0.2), **forces(20.0)}, vehicle())


RUN = run_of_20_s()
TIMES = st.floats(0.0, float(RUN.time_s[-1]))


@examples(60)
@given(st.lists(st.tuples(TIMES, TIMES).map(sorted).map(tuple), min_size=1, max_size=4))
def test_a_sample_is_used_if_it_was_and_lies_inside(keep):
    kept = keep_only(RUN, keep)
    inside = np.array([any(first <= t <= last for first, last in keep) for t in RUN.time_s])
    np.testing.assert_array_equal(kept.used, RUN.used & inside)
    np.testing.assert_array_equal(kept.reason[~RUN.used], RUN.reason[~RUN.used])
    assert set(kept.reason[RUN.used & ~inside]) <= {Reason.BY_HAND}
    assert sum(kept.quality.shares.values()) == pytest.approx(1.0)
    assert kept.quality.shares.get("BY_HAND", 0.0) == np.mean(RUN.used & ~inside)


def test_all_of_a_run_is_that_run():
    whole = keep_only(RUN, [(0.0, float(RUN.time_s[-1]))])
    np.testing.assert_array_equal(whole.reason, RUN.reason)
    assert whole.quality == RUN.quality


def test_the_summary_says_what_was_left_out_by_hand():
    assert "by hand" in dict(summary_table(keep_only(RUN, [(5.0, 6.0)])))["left out"]


def test_an_end_may_be_rounded_up_and_no_more():
    end_s = float(RUN.time_s[-1])
    keep_only(RUN, [(5.0, np.ceil(end_s))])
    with pytest.raises(ConfigError) as caught:
        keep_only(RUN, [(5.0, end_s + 2.0), (end_s + 1.0, end_s + 1.5), (0.0, 1.0)], "choice.toml")
    assert [fault.where for fault in caught.value.faults] == ["choice.toml", "choice.toml"]
    assert "within 0 to" in str(caught.value)


def test_a_standstill_counts_only_where_it_is_kept_whole():
    channels = {**speeds(20.0, speed=lambda t: np.clip(t - 5.0, 0.0, 2.0)), **forces(20.0)}
    del channels["driving_torque"]  # with it, the wheel is stalled
    still = process(channels, vehicle())
    (stand,) = still.quality.standstills
    end_s = stand.start_s + stand.duration_s
    assert keep_only(still, [(0.0, end_s + 1.0)]).quality.standstills == (stand,)
    assert keep_only(still, [(0.0, end_s - 0.5), (end_s, 15.0)]).quality.standstills == ()

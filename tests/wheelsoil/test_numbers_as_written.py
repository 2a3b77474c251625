"""Numbers as a report writes them, at the edges of each rule."""

from __future__ import annotations

import math

import pytest

from daq import Note, moment
from model import DiagnosisCode
from model.diagnosis import Detectable
from wheelsoil.web.bidi import in_texts
from wheelsoil.wording.grounds_text import undetectable
from wheelsoil.wording.names import chance, named_with_unit, shares_percent
from wheelsoil.wording.numbers import count, interval, measured, number, signed, typeset

NAN, INF = math.nan, math.inf


@pytest.mark.parametrize(
    ("shares", "said"),
    [
        ((0.7715, 0.0725, 0.0245, 0.1315), [77.2, 7.3, 2.4, 13.1]),
        ((1 / 3, 1 / 3, 1 / 3), [33.4, 33.3, 33.3]),
        ((1.0, 0.0), [100.0, 0.0]),
        ((0.9, 0.1), [90.0, 10.0]),
        ((), []),
    ],
)
def test_shares_add_up_to_100_percent(shares, said):
    assert shares_percent(shares) == said
    assert not shares or round(sum(said), 6) == 100.0


@pytest.mark.parametrize(
    ("value", "digits", "said"),
    [
        (0.0, 3, "0"),
        (1.0, 3, "1.00"),
        (9.994, 3, "9.99"),
        (9.996, 3, "10.0"),
        (-0.012345, 3, "−0.0123"),
        (1234.5, 3, "1\u202f234"),
        (9_999_999.0, 7, "9\u202f999\u202f999"),
        (16_667_475.0, 3, "16\u202f667\u202f475"),
        (1.2345e9, 3, "1.23 × 10⁹"),
        (0.000123, 3, "0.000123"),
        (-0.0000123, 3, "−1.23 × 10⁻⁵"),
        (NAN, 3, "–"),
        (INF, 3, "∞"),
    ],
)
def test_a_number_has_its_significant_digits(value: float, digits: int, said: str) -> None:
    assert number(value, digits) == said


@pytest.mark.parametrize(
    ("value", "sigma", "said"),
    [(0.123456, 0.012, "0.123"), (0.123456, 0.0099, "0.1235"), (123.4, 12.0, "123"), (5.0, 0.0, "5.000")],
)
def test_a_value_has_two_digits_of_its_error(value: float, sigma: float, said: str) -> None:
    assert measured(value, sigma) == said


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("median -1.08e+03 to 599 N", "median −1\u202f080 to 599 N"),
        ("of 12,300 samples, 50% of run-1 (-0.2)", "of 12\u202f300 samples, 50 % of run-1 (−0.2)"),
        ("2210 N, above 1000 : 1, in 2026", "2\u202f210 N, above 1\u202f000 : 1, in 2026"),
        ("reads -140.3 +- 10.6 N", "reads −140.3 ± 10.6 N"),
        ("write latency_s = -0.02, or --max-gap 1", "write latency_s = -0.02, or --max-gap 1"),
        ("2026-09-15 in a-12,3 with 3.1e-05", "2026-09-15 in a-12,3 with 3.1 × 10⁻⁵"),
    ],
)
def test_a_page_writes_the_numbers_of_a_sentence_its_own_way(text: str, said: str) -> None:
    assert typeset(text) == said
    page = f'<p style="width:5%">{text}</p><code>{text}</code>'
    assert in_texts(page, typeset) == f'<p style="width:5%">{said}</p><code>{text}</code>'


def test_what_is_beyond_the_plausible_is_not_detectable() -> None:
    sizes = {
        "load_gain": Detectable("relative", 1.64, "1"),
        "slope": Detectable("angle_rad", math.inf, "rad"),
        "drawbar_pull_zero": Detectable("offset_n", 13.4, "N"),
        "vasilev": Detectable("H_m", 0.01, "m"),
    }
    assert undetectable(sizes) == {"load_gain", "slope"}
    light = Note(DiagnosisCode.PRIOR_SCALED, values={"share": 0.0025, "load_n": 25.0})
    assert undetectable(sizes, [light]) == {"load_gain", "slope", "drawbar_pull_zero"}


def test_signs_counts_and_intervals() -> None:
    assert (signed(-0.04, "+.1f"), signed(-3.0, "+.1f"), signed(3.0, "+.1f")) == ("0.0", "−3.0", "+3.0")
    assert count(1_234_567) == "1\u202f234\u202f567"
    assert interval(0.1, 0.2) == "0.100 … 0.200"
    assert interval(0.1, NAN) == interval(NAN, 0.1) == interval(0.1, INF) == "–"


def test_names_end_in_their_unit() -> None:
    assert named_with_unit("torque_noise_nm") == ("torque noise", "N m")
    assert named_with_unit("drawbar_pull_noise_n") == ("drawbar pull noise", "N")
    assert named_with_unit("ground_speed_mps") == ("ground speed", "m/s")
    assert named_with_unit("m") == ("m", "")


def test_a_probability_has_one_decimal_and_is_never_certain() -> None:
    said = [chance(p) for p in (0.0, 0.0004, 0.9064, 0.9994, 0.9995, 1.0, NAN)]
    assert said == ["< 0.1 %", "< 0.1 %", "90.6 %", "99.9 %", "> 99.9 %", "> 99.9 %", "-"]


def test_a_time_has_milliseconds() -> None:
    assert moment(1_700_000_000_123_456_789) == "2023-11-14T22:13:20.123Z"
    assert moment(46_408_584_700_000) == "46408.585 s, no date"

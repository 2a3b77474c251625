"""Every label of the catch-all reads on its own, behind any channel; a finding's size is what it says it is."""

from __future__ import annotations

import re

import pytest
from diagnosis_support import linearised

from model.diagnosis.core.result import Finding
from model.diagnosis.core.verdict_words import shape_words
from model.diagnosis.findings.where_wrong import _said
from model.diagnosis.time_series.basis import basis


@pytest.fixture(scope="module")
def labels() -> list[str]:
    _, samples, linear = linearised(2)
    return [label.partition("|")[2] for label in basis(samples, linear).labels]


def test_every_label_reads_on_its_own(labels: list[str]) -> None:
    said = [shape_words(label) for label in labels]
    assert len(set(said)) == len(set(labels)), "what differed still does"
    for text in said:
        assert not re.search(r" - \d", text), "a minus sign is none of a dash"
        assert text not in (
            "load, driving",
            "load, braking",
            "load squared",
            "large torque",
            "torque over the campaign",
        )
        assert not re.match(r"(torque|drawbar pull) -?\d", text), "a simulated one, not the finding's channel"
        assert not re.match(r"ground speed .*\d$", text), "a speed has its unit"
    assert "braking, slip -0.05 to -0.15" in said
    assert "growing with load, driving" in said


def test_a_campaigns_name_stays_before_it() -> None:
    load = _said(Finding("drawbar_pull", "a: b: load, driving", 1.0, 4.0), ("a", "a: b"))
    assert (load.where, load.campaign, load.slips) == ("a: b: growing with load, driving", "a: b", None)
    slip = _said(Finding("drawbar_pull", "clay: braking, slip - 0.3 to 0.6", 1.0, 4.0), ("clay",))
    assert (slip.where, slip.campaign) == ("clay: braking, slip -0.3 to -0.6", "clay")
    assert slip.slips == (-1.0, -0.3), "the outer hat goes on"
    assert _said(Finding("sinkage", "slip 0.05 to 0.4", 1.0, 4.0), ()).slips == (0.05, 0.4)
    assert shape_words("run: 1, 0 to 20 s") == "run: 1, 0 to 20 s"

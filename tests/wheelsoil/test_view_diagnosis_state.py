"""A kept diagnosis stands on the page at once; one that was cancelled, or no longer holds, leaves a word of it."""

from __future__ import annotations

import threading
from concurrent.futures import Future
from contextlib import nullcontext
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import pytest

from wheelsoil.view.analysis_session import AnalysisSession
from wheelsoil.view.campaigns import DiagnosisOnPage, NotReadyError, ViewedCampaign
from wheelsoil.workflows import Files


class Helpers:
    """Helper processes that only note what is asked for and cancelled."""

    def __init__(self) -> None:
        self.asked: list[Future[Any]] = []
        self.dropped: list[Any] = []

    def ask(self, *_: Any) -> Future[Any]:
        self.asked.append(Future())
        return self.asked[-1]

    def drop(self, asked: Any) -> None:
        self.dropped.append(asked)


def discard(campaign: ViewedCampaign, *changed: str) -> list[Any]:
    """Change keys of the choice; return what is cancelled for it."""
    helpers = Helpers()
    session = cast(AnalysisSession, SimpleNamespace(_quick=helpers, _slow=helpers))
    AnalysisSession._discard_results(session, campaign, set(changed))
    return helpers.dropped


@pytest.fixture
def campaign() -> ViewedCampaign:
    """Return a campaign without runs."""
    return ViewedCampaign("c1", "clay", Path(), [])


def test_a_change_of_the_choice_cancels_a_diagnosis_and_says_so(campaign: ViewedCampaign) -> None:
    running: Future[dict[str, Any]] = Future()
    campaign.diagnosis = DiagnosisOnPage("running", running)
    assert discard(campaign, "run") == [running]
    said = campaign.diagnosis.ended
    assert campaign.diagnosis.state == "none" and said == "it was cancelled because the choice was changed"
    assert discard(campaign, "cutoff_hz") == [] and campaign.diagnosis.ended == said


def test_a_diagnosis_of_another_choice_is_not_silently_gone(campaign: ViewedCampaign) -> None:
    campaign.diagnosis = done = DiagnosisOnPage("done", found={})
    discard(campaign, "slip_threshold")
    assert campaign.diagnosis is done
    discard(campaign, "run")
    assert campaign.diagnosis.ended == "the choice was changed since the last diagnosis"


def test_a_fit_that_another_choice_ended_says_that(campaign: ViewedCampaign) -> None:
    campaign.fits = [Future()]
    pending = list(campaign.fits)
    assert discard(campaign, "slip_threshold") == pending
    assert campaign.fits == [] and campaign.fits_ended == "the choice was changed in the meantime"
    asked = SimpleNamespace(result=lambda: discard(campaign, "run"))
    helper = SimpleNamespace(ask=lambda *_, **__: asked)
    session = SimpleNamespace(lock=nullcontext(), campaign=lambda _: campaign, _quick=helper, files=Files())
    with pytest.raises(NotReadyError, match="no fit: the choice was changed in the meantime"):
        AnalysisSession.fit(cast(AnalysisSession, session), "c1")


@pytest.mark.parametrize("kept", [{"verdict": "named"}, None])
def test_a_kept_diagnosis_stands_there_without_being_asked_for(
    campaign: ViewedCampaign, kept: dict[str, Any] | None, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(ViewedCampaign, "members", lambda _: ())
    helpers = Helpers()
    known: dict[str, Any] = {"paths": (), "against": "", "files": SimpleNamespace(soil=None), "lock": threading.RLock()}
    session = cast(Any, SimpleNamespace(_quick=helpers, **known))
    session._put_kept = lambda *given: AnalysisSession._put_kept(session, *given)
    for _ in range(2):
        AnalysisSession._recall(session, campaign)
    [asked] = helpers.asked
    asked.set_result(kept)
    assert campaign.diagnosis.state == ("done" if kept else "none") and campaign.diagnosis.found == kept

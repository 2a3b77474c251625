"""Files of a folder in which there is nothing: they cost only themselves, and named directly they are an error."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest
from cli_support import invoke, ok, small_campaign

from daq.recording import Recording
from wheelsoil.workflows import report_of

HEAD_BYTES = 5000


@pytest.fixture(scope="module")
def campaign(tmp_path_factory) -> Path:
    """Return a campaign folder whose first run's file is whole."""
    return small_campaign(tmp_path_factory.mktemp("campaign") / "wet", runs=1)


def recordings(campaign: Path) -> list[Path]:
    return sorted(campaign.glob("*.mcap"))


@pytest.fixture(params=[0, 20, HEAD_BYTES], ids=["empty", "20 bytes", "cut in its attachments"])
def head(request, campaign, tmp_path) -> tuple[Path, Path]:
    """Return a folder of recordings that carry everything, and the file in it that was barely begun."""
    data = recordings(campaign)[0].read_bytes()
    assert Recording.open(recordings(campaign)[0]).contents.chunks[0].offset > HEAD_BYTES
    folder = tmp_path / "runs"
    folder.mkdir()
    shutil.copy(recordings(campaign)[0], folder)
    begun = folder / "a-begun.mcap"
    begun.write_bytes(data[: request.param])
    return folder, begun


@pytest.mark.parametrize(
    "command", [["info"], ["process"], ["export", "-o", "{out}", "--force"]], ids=lambda one: one[0]
)
def test_in_a_folder_it_costs_only_itself(head, command, tmp_path):
    folder, begun = head
    args = [text.format(out=tmp_path / "out") for text in command]
    alone = ok(args[0], recordings(folder)[-1], *args[1:])
    done = ok(args[0], folder, *args[1:])
    listed = "\nset aside  a-begun: " if command[0] == "process" else ""
    assert done.out.startswith(alone.out + listed) and (listed or done.out == alone.out)
    assert f"{begun}: skipped: " in done.err


@pytest.mark.parametrize(
    "head",
    [pytest.param(0, marks=pytest.mark.slow), pytest.param(20, marks=pytest.mark.slow), HEAD_BYTES],
    indirect=True,
)
def test_fit_goes_on_without_it(head):
    folder, begun = head
    done, alone = (invoke("fit", path) for path in (folder, recordings(folder)[-1]))
    assert f"{begun}: skipped: " in done.err
    assert done.code == alone.code and done.out.startswith(f"{alone.out}\nset aside  a-begun: ")
    [aside] = invoke("fit", folder, "--json").json["runs_set_aside"]
    assert (aside["run"], aside["cause"]) == ("a-begun", "unreadable") and aside["reason"] and aside["next_step"]


def test_a_report_names_it(head):
    folder, _ = head
    report = report_of([folder], diagnose=False)
    assert [run["run"] for run in report.numbers()["runs_set_aside"]] == ["a-begun"]
    assert report.head.badge is not None and report.head.badge[1].startswith("▲ 1 of 2 runs ")


@pytest.mark.parametrize("beside", [False, True], ids=["alone", "vehicle.toml beside it"])
def test_named_directly_it_is_an_error(head, campaign, beside):
    folder, begun = head
    if beside:
        for file in (*campaign.glob("*.toml"), *campaign.glob("*.dbc")):
            shutil.copy(file, folder)
        (folder / "runs.toml").unlink(missing_ok=True)
        ok("info", folder)
    done = invoke("info", begun)
    assert done.code == 3
    assert str(begun) in done.err


def test_a_folder_of_nothing_else_is_an_error(head):
    folder, begun = head
    recordings(folder)[-1].unlink()
    assert invoke("info", folder).code == 3
    assert begun.exists()


def test_recover_makes_no_file_of_it(head):
    folder, begun = head
    before = sorted(folder.iterdir())
    done = invoke("recover", begun)
    assert done.code == 3
    assert str(begun) in done.err
    assert sorted(folder.iterdir()) == before

"""A run that is impossible as it is declared: refused with the line that mends it, set aside, or accepted."""

from __future__ import annotations

import shutil
from dataclasses import replace
from pathlib import Path

import pytest
from cli_support import invoke
from implausible import implausible

from daq.runs import SetAsideRun, open_runs
from processing import ProcessOptions
from wheelsoil.wording.plausibility_text import plausibility_sentence, refusal
from wheelsoil.workflows import process_runs
from wheelsoil.workflows.runs import doubted_by_most

_TURNED = ('driving_torque = "WFT_Moments.My"', 'driving_torque = "-WFT_Moments.My"')
_KNOTS = ('ground_speed = "GNSS_2.Speed"', 'ground_speed = {signal = "GNSS_2.Speed", unit = "m/s"}')


def _copy(campaign: Path, folder: Path, change: tuple[str, str], runs: tuple[str, ...]) -> Path:
    for name in runs:
        shutil.copy(campaign / name, folder)
    for name in ("vehicle.toml", "terrain.toml"):
        text = (campaign / name).read_text(encoding="utf-8")
        (folder / name).write_text(text.replace(*change), encoding="utf-8")
    return folder


@pytest.mark.parametrize("command", ["process", "fit", "sinkage", "diagnose", "report"])
def test_a_turned_torque_is_refused_with_the_line_that_mends_it(
    campaign: Path, tmp_path: Path, command: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    found = invoke(command, _copy(campaign, tmp_path, _TURNED, ("run-1.mcap",)))
    said = " ".join(found.err.split())
    assert found.code == 2
    assert "impossible as it is declared" in said and "run-1" in said
    assert 'write driving_torque = "WFT_Moments.My"' in said
    assert "--accept-implausible" in said


def test_a_run_that_is_accepted_is_noted(campaign: Path, tmp_path: Path) -> None:
    folder = _copy(campaign, tmp_path, _TURNED, ("run-1.mcap", "run-2.mcap"))
    found = invoke("sinkage", folder, "--accept-implausible", "--json")
    assert "run-1, run-2: the run is impossible as it is declared" in " ".join(found.err.split())
    assert "set aside" not in found.err
    assert [text.partition(":")[0] for text in found.json["remarks"]] == ["run-1, run-2"]


def test_info_goes_on_with_a_note(campaign: Path, tmp_path: Path) -> None:
    folder = _copy(campaign, tmp_path, _TURNED, ("run-1.mcap",))
    found = invoke("info", folder / "run-1.mcap", "--vehicle", folder / "vehicle.toml", "--json")
    assert found.code == 0
    assert "driving torque seems to have the wrong sign" in " ".join(found.err.split())
    assert "driving torque seems to have the wrong sign" in found.json[0]["doubts"][0]


def test_a_refused_run_among_others_is_set_aside(campaign: Path, tmp_path: Path) -> None:
    good = campaign / "run-1.mcap"
    folder = _copy(campaign, tmp_path, _TURNED, ("run-2.mcap",))
    found = invoke("process", good, folder, "--json")
    assert found.code == 0, found.err
    assert [(one["run"]["id"], "set_aside" in one) for one in found.json] == [("run-1", False), ("run-2", True)]
    assert "set aside" in found.err and "run-2" in found.err


def test_who_processes_is_given_the_line_that_mends_it(campaign: Path, tmp_path: Path) -> None:
    said: list[SetAsideRun] = []
    folder = _copy(campaign, tmp_path, _TURNED, ("run-2.mcap",))
    found = process_runs(open_runs([campaign / "run-1.mcap", folder]), ProcessOptions(), set_aside=said.append)
    assert [run.id for run, _ in found] == ["run-1"]
    [aside] = said
    assert (aside.run, aside.cause, aside.drive_again) == ("run-2", "misdeclared", False)
    assert aside.reason.startswith("the run is impossible") and "write driving_torque" in aside.next_step


def test_a_weak_doubt_that_few_runs_share_is_not_told(campaign: Path) -> None:
    """What vehicle.toml says is of all runs; a strong doubt, and one of most runs, stay."""
    [(run, sound), *_] = process_runs(open_runs([campaign / "run-1.mcap"]), ProcessOptions())

    def told(*chances: float | None) -> list[bool]:
        notes = [() if p is None else (implausible("unit:driving_torque=lbf ft", sound=p),) for p in chances]
        pairs = [(run, replace(sound, quality=replace(sound.quality, notes=own))) for own in notes]
        return [bool(found.quality.notes) for _, found in doubted_by_most(pairs)]

    assert told(0.4, None, None) == [False] * 3
    assert told(0.01, None, None) == [True, False, False]
    assert told(0.4, 0.4, None) == [True, True, False]
    assert told(0.4, None) == [True, False]


def test_a_channel_that_never_changes_is_named_before_a_unit() -> None:
    note = implausible("unit:ground_speed=kt")
    held = replace(note, values={**note.values, "held": {"ground_speed": 40.0}})
    step = refusal(held, "").next_step
    assert step.startswith("ground speed stays the same for 40.0 s: check the sensor and drive again. If it is sound, ")
    assert "knots" in step


def test_a_pasted_unit_is_read(campaign: Path, tmp_path: Path) -> None:
    """The line that is printed is one that vehicle.toml takes."""
    text = refusal(implausible("unit:ground_speed=kt"), "").next_step
    line = text.split("write ")[1].split(" under")[0]
    assert line == 'ground_speed = {signal = "GNSS.Speed", unit = "kt"}'
    folder = _copy(campaign, tmp_path, (_KNOTS[0], line.replace("GNSS.Speed", "GNSS_2.Speed")), ("run-1.mcap",))
    assert invoke("process", folder, "--accept-implausible").code == 0


@pytest.mark.parametrize(
    ("mend", "said"),
    [
        ("sign:driving_torque", 'the wrong sign (more than 99.9 %): write driving_torque = "-WFT.My"'),
        ("sign:drawbar_pull", 'write drawbar_pull = {signal = "WFT.Fx", unit = "kN"}'),
        ("unit:drawbar_pull=kgf", 'write drawbar_pull = {signal = "WFT.Fx", unit = "kgf", sign = -1}'),
        ("unit:radius_m=in", "[wheel] radius_m seems to be in inches (more than 99.9 %): write radius_m = 0.4699"),
        ("declared:ground_speed=kt", "ground speed seems to be in m/s, and is taken for knots"),
        ("declared:ground_speed=kt", 'write ground_speed = {signal = "GNSS.Speed", unit = "m/s"}'),
        ("exchanged:ground_speed,driving_torque", 'write ground_speed = "WFT.My" and driving_torque = "GNSS.Speed"'),
        ("unit:vertical_load=kN,drawbar_pull=kN", "vertical load and drawbar pull seem to be in kN"),
    ],
)  # fmt: skip
def test_the_cure_is_a_line_to_paste(mend: str, said: str) -> None:
    assert said in plausibility_sentence(implausible(mend).values)


def test_several_mistakes_are_all_listed() -> None:
    said = plausibility_sentence(implausible("unit:ground_speed=kt", "unit:ground_speed=mph", sound=0.02).values)
    assert said.startswith("the run is improbable as it is declared (sound with 2 %)")
    assert "one of these" in said and "knots (49 %)" in said and "mph (49 %)" in said

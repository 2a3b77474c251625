"""Every code of a note has its sentence, and every sentence its code."""

from __future__ import annotations

from itertools import chain

from daq import Note, RecordingCode, Severity
from model import BevameterCode, DiagnosisCode, FitCode, LackCode, SinkageCode, StepCode
from processing import RunCode, ZeroCode
from wheelsoil.wording import diagnosis_notes, model_notes, run_notes
from wheelsoil.wording.notes import note_text, noted_of_runs, texts_of

CODES = (RecordingCode, RunCode, ZeroCode, LackCode, DiagnosisCode, FitCode, BevameterCode, SinkageCode, StepCode)
SENTENCES = {**diagnosis_notes.SENTENCES, **model_notes.SENTENCES, **run_notes.SENTENCES}


def test_every_code_has_one_sentence_and_every_sentence_a_code() -> None:
    codes = list(chain.from_iterable(CODES))
    assert len(set(map(str, codes))) == len(codes), "no code stands for two facts"
    assert set(SENTENCES) == set(codes)


def test_a_sentence_is_made_of_the_values() -> None:
    gaps = Note(RunCode.CHANNEL_GAPS, Severity.DOUBT, {"role": "ground_speed", "share": 0.25})
    assert note_text(gaps) == "ground_speed is missing for 25 % of the run, and those samples are excluded"
    assert texts_of([gaps, gaps]) == [note_text(gaps)], "each once"
    assert noted_of_runs([("a", [gaps]), ("b", [gaps])]) == [f"all runs: {note_text(gaps)}"]
    assert noted_of_runs([("a", []), ("b", [gaps])]) == [f"b: {note_text(gaps)}"]


def test_of_many_standstills_the_first_four_are_listed() -> None:
    values = {"role": "driving_torque", "levels": [1.0, 2.0, 3.0, 4.0, 5.0], "sigmas": [0.5] * 5, "brakes": ("held",)}
    text = note_text(Note(RunCode.ZERO_AT_STANDSTILL, Severity.REMARK, values))
    assert "reads 1.0 ± 0.5, 2.0 ± 0.5, 3.0 ± 0.5, 4.0 ± 0.5 N" in text


def test_severities_are_ordered() -> None:
    assert Severity.REMARK < Severity.DOUBT < Severity.FAULT

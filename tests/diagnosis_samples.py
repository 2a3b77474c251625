"""Diagnoses made by hand, for what prints and draws them."""

from __future__ import annotations

from dataclasses import replace
from typing import get_args

import numpy as np

from daq import Note
from model import DiagnosisCode, LackCode, SinkageCode, StepCode
from model.diagnosis import (
    Adequacy,
    Candidate,
    Cause,
    CauseSet,
    Detectable,
    Diagnosis,
    Finding,
    Gain,
    Inconsistent,
    Kind,
    Linearisation,
    NextRun,
    ParameterEstimate,
    Scores,
    Shape,
    SoilEstimate,
)
from model.diagnosis.core.result import PlotData, Proposal, Verdict
from wheelsoil.wording.verdict import sentence_of

MORE_LOAD = Note(StepCode.MORE_LOAD, values={"load_n": 12_900.0, "added_kg": 500.0})
BRAKING = Note(StepCode.BRAKING, values={"slip": -0.6})

BROKEN_BOUND = Note(
    SinkageCode.TORQUE_SUSPECT,
    values={
        "campaign": "",
        "broken": 14,
        "rows": 20,
        "excess_n": 240.0,
        "sigmas": 6.1,
        "friction": 1.2,
        "less_torque_nm": 110.0,
        "more_sinkage_m": 0.02,
        "larger_radius": 0.1,
        "more_pull_n": 240.0,
    },
)


def seen(campaign: str = "clay", runs: tuple[str, ...] = ("run-1", "run-2"), samples: int = 120) -> PlotData:
    """Return samples of runs whose drawbar pull lacks what grows with slip."""
    rng = np.random.default_rng(3)
    n = samples * len(runs)
    time_s = np.tile(np.arange(samples) / 5.0, len(runs))
    slip = 0.35 + 0.4 * np.sin(0.6 * time_s)
    load = 9000.0 + 300.0 * np.cos(0.8 * time_s)
    base = {"dp": 800.0 * np.tanh(6 * slip) - 0.04 * load, "t": 0.47 * load * np.tanh(5 * slip)}
    missing = {"dp": -220.0 * np.maximum(slip, 0), "t": 60.0 * np.maximum(slip, 0)}
    sigma = {"dp": np.full(n, 35.0), "t": np.full(n, 12.0)}
    measured = {c: base[c] + missing[c] + sigma[c] * rng.standard_normal(n) for c in base}
    return PlotData(
        campaign=campaign,
        runs=runs,
        run=np.repeat(np.arange(len(runs)), samples),
        time_s=time_s,
        since_first_run_s=time_s + np.repeat(600.0 * np.arange(len(runs)), samples),
        campaign_time=np.linspace(-0.5, 0.5, n),
        slip=slip,
        ground_speed_mps=2.0 + 0.5 * np.sin(0.2 * time_s),
        vertical_load_n=load,
        line_position=np.linspace(-1, 1, n),
        measured=measured,
        base=base,
        extended={c: base[c] + missing[c] for c in base},
        base_sigma=sigma,
        signatures={"vasilev": missing, "bulldozing": {c: 0.9 * x + 4 for c, x in missing.items()}},
    )


def cause(key: str, name: str, form: str, probability: float, *parameters: ParameterEstimate) -> Cause:
    """Return a physical cause."""
    return Cause(name, form, "physical", key, probability, 0.62 if form else 1.0, parameters)


def diagnosis(verdict: Verdict = "named") -> Diagnosis:
    """Return a diagnosis with a value in every field that its verdict may have."""
    sinkage = cause(
        "vasilev", "slip_sinkage", "vasilev", 0.97, ParameterEstimate("H_m", "m", 0.051, (0.04, 0.06), 5e-3)
    )
    pushing = cause("bulldozing", "bulldozing", "", 0.4, ParameterEstimate("fraction", "1", 0.2, (np.nan, np.nan), 0.1))
    scores = Scores(120.0, 31.0, 0.91, -3200.0)
    none = Candidate("none", 0.93 if verdict == "nothing_detectable" else 0.02)
    return Diagnosis(
        verdict=verdict,
        causes={"named": (sinkage,), "one_of": (replace(sinkage, probability=0.55), pushing)}.get(verdict, ()),
        candidates=(
            Candidate("slip_sinkage", 0.97),
            *sorted((Candidate("bulldozing", 0.03), none), key=lambda each: -each.probability),
            Candidate("slope", 1e-5),
        ),
        what_is_wrong=(
            Finding("drawbar_pull", Shape(Kind.SLIP, "dp", (0.4, 0.9)), -122.0, -8.3),
            Finding("driving_torque", Shape(Kind.GROUND_SPEED, "t", (2.0, 2.5), "m/s", campaign="clay"), 31.0, 4.1),
        ),
        gain=Gain(
            base={"dp": scores, "t": replace(scores, R0=40.0)},
            extended={"dp": replace(scores, R0=66.0, R2=0.97, log_likelihood=-3100.0), "t": replace(scores, R0=30.0)},
            reduction_percent=45.0,
            interval95=(35.0, 52.0),
            log_likelihood_gain=211.0,
            chosen=(("vasilev",), ()),
        ),
        inconsistent=(Inconsistent("driving_torque", 14, BROKEN_BOUND),),
        adequacy=Adequacy(0.97 if verdict == "unexplained" else 0.02, 0.5, verdict != "unexplained", "probability"),
        linearisation=Linearisation(1214, 1210, 5, converged=verdict != "unexplained"),
        proposal=Proposal("dp = -130 N s^2", 12.0) if verdict == "unexplained" else None,
        minimum_detectable={
            "vasilev": Detectable("H_m", 0.012, "m"),
            "bulldozing": Detectable("fraction", 0.11, "1"),
            "drawbar_pull_zero": Detectable("offset_n", 32.0, "N"),
            "slope": Detectable("angle_rad", np.inf, "rad"),
            "speed_bias": Detectable("offset_mps", 0.02, "m/s"),
        },
        next_run=(NextRun(MORE_LOAD, ("slip_sinkage", "bulldozing"), 6.3), NextRun(BRAKING, (), 1.2)),
        not_identifiable={"slope": Note(LackCode.ONE_DIRECTION), "speed_bias": Note(LackCode.ONE_DIRECTION)},
        notes=(Note(DiagnosisCode.SOIL_SIGMA_ASSUMED, values={"campaigns": ("clay",)}),),
        noise={"dp_n": 35.0, "speed_mps": 0.04, "run_scatter": float("nan")},
        soils=(
            SoilEstimate("clay", {"cohesion_pa": 4100.0, "tan_phi": 0.22}, {"cohesion_pa": 300.0, "tan_phi": 0.01}),
        ),
        plot_data=(seen(),),
        stages_s={"look": 0.8, "evidence": 0.2},
        sets=(CauseSet(("slip_sinkage",), 0.9), CauseSet(("slip_sinkage", "bulldozing"), 0.06)),
    )


SENTENCES = {verdict: sentence_of(diagnosis(verdict)) for verdict in get_args(Verdict)}
"""What is said of each."""

"""The figure of a measurement cause shows the cause: the samples lie on its correction."""

from __future__ import annotations

import tomllib
from dataclasses import replace

import numpy as np
import pytest
from diagnosis_samples import diagnosis, seen

from daq import OUTPUTS, VehicleConfig, parse_mapping
from model.diagnosis import Cause, ParameterEstimate
from model.effects import EFFECTS, Correction, Remedy
from model.effects.speed_errors import SpeedLatency
from model.effects.transducer import DrawbarPullZero
from model.effects.wheel_forces import INERTIA_KGM2, MASS_KG
from wheelsoil.report.cause_figure import cause_figure
from wheelsoil.report.inputs import ReportInputs
from wheelsoil.report.recommendation import of_diagnosis
from wheelsoil.wording.mending import mending_of

VEHICLE = VehicleConfig.model_validate({"wheel": {"radius_m": 0.5, "width_m": 0.3, "outboard_mass_kg": 10}})


def cause(key: str, value: float) -> Cause:
    [parameter] = EFFECTS[key].parameters
    size = ParameterEstimate(parameter.name, parameter.unit, value, (0.9 * value, 1.1 * value), 0.05 * abs(value))
    return Cause(EFFECTS[key].name, "", EFFECTS[key].kind, key, 0.99, 1.0, (size,))


ADDED = {
    "torque_zero": ("t", 80.0, lambda data: 80.0 + 0.0 * data.slip),
    "drawbar_pull_zero": ("dp", -90.0, lambda data: -90.0 + 0.0 * data.slip),
    "crosstalk": ("dp", 0.02, lambda data: 0.02 * data.vertical_load_n),
    "drawbar_pull_gain": ("dp", 0.15, lambda data: 0.15 * data.base["dp"]),
    "torque_gain": ("t", -0.1, lambda data: -0.1 * data.base["t"]),
}


@pytest.mark.parametrize("key", ADDED)
def test_samples_lie_on_the_correction(key: str) -> None:
    channel, value, added = ADDED[key]
    data = seen()
    change = {channel: added(data)}
    extended = data.base | {channel: data.base[channel] + change[channel]}
    noise = {c: data.base_sigma[c] * np.random.default_rng(1).standard_normal(len(data.slip)) for c in data.base}
    measured = {c: extended[c] + noise[c] for c in data.base}
    data = replace(data, measured=measured, extended=extended, signatures={key: change})
    found = replace(diagnosis(), causes=(cause(key, value),), plot_data=(data,))
    assert found.main_channel == channel
    inputs = ReportInputs((), None, "", VEHICLE, "clay", diagnosed=found)
    # the soil that is fitted beside it may change the pull more
    drawing = cause_figure(inputs, of_diagnosis(found), "dp")
    assert drawing is not None and OUTPUTS[channel].name in drawing.title
    line, points = drawing.curves
    assert list(line["x"]) == list(points["x"])
    assert np.max(np.abs(line["y"] - points["y"])) < 1.5 * data.base_sigma[channel][0]
    low, high = change[channel].min(), change[channel].max()
    assert np.all((line["y"] > low - 1.0) & (line["y"] < high + 1.0)) and np.ptp(line["y"]) >= 0.5 * (high - low)


def test_an_effect_of_another_package_has_sentence_and_figure(monkeypatch: pytest.MonkeyPatch) -> None:
    class WetBridge(DrawbarPullZero):
        name, error_text = "wet_bridge", "Water in the bridge {lifts/lowers} the {channel} by {size}"

    monkeypatch.setattr(EFFECTS, "_effects", EFFECTS._effects | {"wet_bridge": WetBridge})
    data = seen()
    data = replace(data, signatures={"wet_bridge": {"dp": -90.0 + 0.0 * data.slip}})
    found = replace(diagnosis(), causes=(cause("wet_bridge", -90.0),), plot_data=(data,))
    drawing = cause_figure(ReportInputs((), None, "", VEHICLE, "clay", diagnosed=found), of_diagnosis(found), "dp")
    assert drawing is not None
    assert drawing.title == "Water in the bridge lowers the drawbar pull by 90.0 N (81.0 to 99.0)"


def test_a_cause_over_slip_has_no_figure_of_its_own() -> None:
    found = diagnosis()
    assert cause_figure(ReportInputs((), None, "", VEHICLE, "clay", diagnosed=found), of_diagnosis(found), "dp") is None


def test_what_is_to_be_pasted_holds_the_value() -> None:
    assert mending_of(cause("wheel_radius", 0.03), VEHICLE).paste == "[wheel]\nrolling_radius_m = 0.5150"
    assert mending_of(cause("wheel_radius", 0.03), VehicleConfig()).paste == ""
    assert mending_of(cause("speed_latency", 0.15), VEHICLE).paste.endswith("latency_s = 0.150")
    said = mending_of(cause("wheel_inertia", 0.5), VEHICLE).paste.splitlines()
    assert said[1:] == [f"outboard_mass_kg = {10 + MASS_KG / 2:g}", f"outboard_inertia_kgm2 = {INERTIA_KGM2 / 2:g}"]
    assert "0.870 times" in mending_of(cause("drawbar_pull_gain", 0.15), VEHICLE).what


def test_what_cannot_be_below_zero_is_said_of_its_own_kind() -> None:
    late = mending_of(cause("speed_latency", -0.07), VEHICLE).paste
    assert late.endswith("= 0  # these runs ask for -0.070, which cannot be: check latency_s of the other sensors, too")
    _, mass, inertia = mending_of(cause("wheel_inertia", -0.5), VEHICLE).paste.splitlines()
    assert mass.endswith(f"# these runs ask for {10 - MASS_KG / 2:.3g}, which cannot be") and "sensors" not in inertia
    assert mending_of(cause("speed_latency", -1e-9), VEHICLE).paste.endswith("latency_s = 0.000")


@pytest.mark.parametrize("key", [key for key, effect in EFFECTS.items() if len(effect.parameters) == 1])
@pytest.mark.parametrize("share", [1.0, 0.1, -0.1, -1.0])
def test_the_reader_takes_every_line_to_paste(key: str, share: float) -> None:
    """Of every effect, up to both bounds of its size; commands beside them are no lines."""
    [parameter] = EFFECTS[key].parameters
    paste = mending_of(cause(key, share * (parameter.upper if share > 0 else -parameter.lower)), VEHICLE).paste
    said = "\n".join(line for line in paste.splitlines() if not line.startswith(("wheelsoil ", "cp ", "mv ")))
    raw = VEHICLE.model_dump(mode="json", exclude_unset=True)
    for table, values in tomllib.loads(said).items():
        raw[table] = {**raw.get(table, {}), **values}
    parse_mapping(raw, VehicleConfig, "vehicle.toml")
    latencies = [sensor["latency_s"] for sensor in raw.get("sensors", {}).values() if "latency_s" in sensor]
    assert all(latency >= 0 for latency in latencies)


def test_an_effect_of_another_package_says_how_it_is_mended(monkeypatch: pytest.MonkeyPatch) -> None:
    class Late(SpeedLatency):
        name = "late"
        remedy = Remedy("Check the wheel speed.", (Correction("latency_s", -2.0, "wheel_speed", form=".2f"),))

    class Unsaid(Late):
        name, remedy = "unsaid", None

    monkeypatch.setattr(EFFECTS, "_effects", EFFECTS._effects | {"late": Late, "unsaid": Unsaid})
    said = mending_of(cause("late", -0.15), VEHICLE)
    assert (said.what, said.paste) == ("Check the wheel speed.", "[sensors.wheel_speed]\nlatency_s = 0.30")
    assert mending_of(cause("unsaid", 1.0), VEHICLE).what.startswith("Check the sensor of this cause")


@pytest.mark.parametrize(
    ("correction", "line"),
    [
        (Correction("lug_height_m", 0.02), "# lug_height_m: add 0.01 to what it is"),
        (Correction("camber_deg", -1.5), "# camber_deg: add -0.75 to what it is"),
        (Correction("camber_deg", share_of="camber_deg"), "# camber_deg: add 0.5 of camber_deg to what it is"),
        (Correction("sigma", 0.1, "ground_speed"), "# sigma: add 0.05 to what it is"),
    ],
)
def test_a_number_that_vehicle_toml_does_not_have_is_no_crash(correction: Correction, line: str) -> None:
    assert line == correction.line(VEHICLE, 0.5)

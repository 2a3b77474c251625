"""What to do after a diagnosis: each step with its reason, and the command or the lines of a file to paste."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from daq import VehicleConfig, number
from model import LackCode
from model.diagnosis import Cause, Diagnosis, NextRun
from wheelsoil.wording.names import listed, plain_name, upper
from wheelsoil.wording.notes import key_text, naming_text, odds_text, step_text

_LIFTED = 'wheelsoil zero spin.mcap --vehicle vehicle.toml\n# then:\n[transducer]\nzero_file = "zero.toml"'
_RELEASED = '[vehicle]\nstandstill_brakes = "released"'


MENDED = ("wheel_inertia",)
"""Causes of the wheel that are mended in vehicle.toml, as those of the measurement are."""


@dataclass(frozen=True)
class Step:
    """A thing to do next, why, and the command or the lines of a file to paste; where there are several, its campaign.

    `what` then begins with the campaign.
    """

    what: str
    why: str = ""
    paste: str = ""
    campaign: str = ""


def next_steps(found: Diagnosis, vehicle: VehicleConfig) -> list[Step]:
    """Return what removes the named causes of the measurement, then the runs that decide most; may be empty."""
    named = found.causes if found.verdict == "named" else ()
    steps = [mending_of(cause, vehicle) for cause in named if cause.name in MENDED or cause.kind == "measurement"]
    missing = missing_step(found) if steps or not found.next_run else None
    steps += [missing] if missing is not None else []
    return [*steps, *map(_step_of_run, found.next_run)]


def step_of(found: Diagnosis) -> Step:
    """Return the step that a verdict asks for where nothing has to be mended and no run decides."""
    if found.grounds.undecided is not None:
        faults = found.grounds.undecided.values.get("faults", ())
        told = dict.fromkeys(fault.next_step for fault in faults if fault.next_step)
        return Step(upper("; ".join(told) or "give what is missing") + ".")
    if found.verdict == "unexplained":
        return Step(
            "Look at what is wrong, and where: nothing known explains it, so do not rely on the model there. "
            "Check zeros, signs and configuration first, and whether all runs are on one soil."
        )
    if found.verdict == "named":
        advice = "Save the recommended model for fit, simulate and report."
        return Step(advice, paste="wheelsoil diagnose FOLDER -o model.toml")
    return Step("No further run is asked for; see the minimum detectable effect.")


def _step_of_run(run: NextRun) -> Step:
    parted = listed([plain_name(name) for name in run.separates])
    tells = f"expected odds {odds_text(run.expected_log_bayes_factor)}"
    if named := naming_text(run):
        tells = f"right name: {named}; {tells}"
    cost = f"; takes about as long as {number(run.cost_runs, 2)} runs" if run.cost_runs > 1 else ""
    reason = [f"Separates {parted}; {tells}{cost}."] if parted else []
    written = [f"Write {key}."] if (key := key_text(run)) else []
    what = step_text(run) if run.campaign else upper(step_text(run))
    return Step(what, " ".join([*reason, *written]), campaign=run.campaign)


def mending_of(cause: Cause, vehicle: VehicleConfig) -> Step:
    """Return how to remove a measurement cause, or to check it where no file can."""
    rule = _RULES.get(cause.name)
    value = cause.parameters[0].value if cause.parameters else 0.0
    return rule(value, vehicle) if rule else Step("Check the sensor of this cause, and repeat the diagnosis.")


def missing_step(found: Diagnosis) -> Step | None:
    """Return what would make the causes identifiable that the verdict says are not; None where no line does."""
    if any(why.code is LackCode.NOT_AT_STANDSTILL for why in found.not_identifiable.values()):
        return Step("Record a standstill with released brakes, and declare it in vehicle.toml.", paste=_RELEASED)
    return None


def _zero(_: float, __: VehicleConfig) -> Step:
    return Step("Determine the zero with the wheel lifted, and name its file in vehicle.toml.", paste=_LIFTED)


def _drift(_: float, __: VehicleConfig) -> Step:
    return Step(
        "Determine the zero with the wheel lifted before and after the runs; processing interpolates between them.",
        paste="wheelsoil zero before.mcap after.mcap --vehicle vehicle.toml",
    )


def _latency(value: float, vehicle: VehicleConfig) -> Step:
    line = f"[sensors.ground_speed]\nlatency_s = {vehicle.latency_s('ground_speed') + value:.3f}"
    return Step("Check the delay of the ground speed; these runs ask for this one in vehicle.toml.", paste=line)


def _radius(value: float, vehicle: VehicleConfig) -> Step:
    wheel = vehicle.wheel
    line = f"[wheel]\nradius_m = {wheel.radius_m * (1 + value):.4f}" if wheel else ""
    return Step("Measure the rolling radius on firm ground; these runs ask for this one in vehicle.toml.", paste=line)


def _inertia(value: float, vehicle: VehicleConfig) -> Step:
    wheel = vehicle.wheel
    mass = (wheel.outboard_mass_kg if wheel else 0.0) + _MASS_KG * value
    inertia = (wheel.outboard_inertia_kgm2 if wheel else 0.0) + _INERTIA_KGM2 * value
    lines = f"[wheel]\noutboard_mass_kg = {number(mass, 3)}\noutboard_inertia_kgm2 = {number(inertia, 3)}"
    return Step("Weigh what is outside the transducer; these runs ask for these values in vehicle.toml.", paste=lines)


def _gain(what: str) -> Callable[[float, VehicleConfig], Step]:
    def rule(value: float, _: VehicleConfig) -> Step:
        return Step(f"Calibrate the {what}: these runs ask for {1 / (1 + value):.3f} times today's scale in the DBC.")

    return rule


def _check(what: str) -> Callable[[float, VehicleConfig], Step]:
    return lambda _value, _vehicle: Step(what)


_MASS_KG, _INERTIA_KGM2 = 75.0, 8.0
"""What a scale of 1 of `wheel_inertia` stands for."""
_RULES: dict[str, Callable[[float, VehicleConfig], Step]] = {
    "torque_zero": _zero,
    "drawbar_pull_zero": _zero,
    "load_zero": _zero,
    "zero_drift": _drift,
    "speed_latency": _latency,
    "wheel_radius": _radius,
    "wheel_inertia": _inertia,
    "drawbar_pull_gain": _gain("drawbar pull"),
    "torque_gain": _gain("driving torque"),
    "load_gain": _gain("vertical load"),
    "crosstalk": _check("Check the transducer's tilt on the hub and its cross-talk matrix, and repeat the diagnosis."),
    "body_pitch": _check("Hold the transducer's stator at the hub's carrier, not at the body, and repeat the runs."),
    "speed_bias": _check("Compare ground speed with rim speed where the wheel rolls freely, and repeat the diagnosis."),
}

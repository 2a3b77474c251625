"""Bad input to processing: one clear message each, never a traceback of another kind."""

import numpy as np
import pytest
from synthetic_run import channel, forces, speeds, stamps, vehicle

from daq import ConfigError, DataError, VehicleConfig, WheelsoilError
from daq.config import TransducerSection
from processing import ProcessOptions, require_roles
from processing.options import NEEDED_ROLES
from processing.pipeline import process

SPEEDS = NEEDED_ROLES["process"]


@pytest.mark.parametrize(
    ("given", "words"),
    [
        ({"rate_hz": 0.0}, ["rate_hz"]),
        ({"rate_hz": float("nan"), "max_gap_s": -1.0}, ["rate_hz", "max_gap_s"]),
        ({"rate_hz": 0.5}, ["rate_hz", "1 to 10000"]),
        ({"cutoff_hz": 30.0}, ["cutoff_hz", "at most 10 Hz"]),
        ({"min_speed_mps": -0.1}, ["min_speed_mps"]),
        ({"purpose": "fitt"}, ["fitt", "nearest: fit"]),
    ],
)
def test_wrong_options_are_named_together(given: dict, words: list[str]) -> None:  # type: ignore[type-arg]
    with pytest.raises(ConfigError) as caught:
        ProcessOptions(**given)
    for word in words:
        assert word in str(caught.value)


@pytest.mark.parametrize("purpose", NEEDED_ROLES)
def test_every_missing_role_is_named_at_once(purpose: str) -> None:
    with pytest.raises(ConfigError) as caught:
        require_roles([], purpose)
    for role in NEEDED_ROLES[purpose]:
        assert f"{role!r}" in str(caught.value)
        assert f'add {role} = "Message.Signal"' in str(caught.value)
    require_roles(NEEDED_ROLES[purpose], purpose)


def test_a_rotating_transducer_needs_its_angle() -> None:
    with pytest.raises(ConfigError, match="wheel_angle"):
        require_roles(NEEDED_ROLES["fit"], "fit", rotating=True)
    require_roles(NEEDED_ROLES["process"], "process", rotating=True)
    config = vehicle(transducer=TransducerSection(frame="wheel"))
    with pytest.raises(ConfigError, match="wheel_angle"):
        process(speeds(5.0) | forces(5.0), config)


def _empty(role: str) -> dict:  # type: ignore[type-arg]
    return {role: channel(role, np.zeros(0), np.zeros(0))}


@pytest.mark.parametrize(
    ("channels", "config", "kind", "words"),
    [
        (dict, vehicle(), ConfigError, ["ground_speed", "wheel_speed"]),
        (lambda: speeds(5.0), VehicleConfig(), ConfigError, ["[wheel]"]),
        (lambda: speeds(5.0) | _empty("ground_speed"), vehicle(), DataError, ["no sample of ground_speed"]),
        (
            lambda: speeds(5.0) | forces(5.0) | _empty("drawbar_pull"),
            vehicle(),
            DataError,
            ["no sample of drawbar"],
        ),
        (
            lambda: speeds(5.0) | {"ground_speed": channel("v", 100 + stamps(5.0, 20.0), np.ones(100))},
            vehicle(),
            DataError,
            ["never there at the same time", "ground_speed 2023-", "wheel_speed 2023-"],
        ),
        (lambda: {role: channel(role, np.zeros(1), np.ones(1)) for role in SPEEDS}, vehicle(), DataError, ["short"]),
    ],
)
def test_what_cannot_be_processed_says_why(channels, config, kind, words) -> None:  # type: ignore[no-untyped-def]
    with pytest.raises(kind) as caught:
        purpose = "fit" if "vertical_load" in channels() else "process"
        process(channels(), config, options=ProcessOptions(purpose=purpose))
    assert isinstance(caught.value, WheelsoilError)
    for word in words:
        assert word in str(caught.value)


def test_the_purpose_is_checked() -> None:
    with pytest.raises(ConfigError, match="which fit with torque needs"):
        process(speeds(5.0), vehicle(), options=ProcessOptions(purpose="fit_torque"))


@pytest.mark.parametrize("fill", [np.nan, np.inf, 0.0])
def test_speeds_that_say_nothing_are_a_result(fill: float) -> None:
    at = stamps(10.0, 20.0)
    run = process({role: channel(role, at, np.full(len(at), fill)) for role in SPEEDS}, vehicle())
    assert not run.used.any()
    assert sum(run.quality.shares.values()) == pytest.approx(1.0)

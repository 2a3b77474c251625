"""What is handed over: vehicle.toml, terrain.toml, runs.toml, a vendor's DBC, and runs as frames. No truth."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from math import degrees, hypot
from pathlib import Path

import numpy as np
import tomli_w
from blind.driving import INFLATION_KPA, Plan
from blind.field import FieldDay, driven
from blind.ground import LABORATORY, SPREAD, UNIT_WEIGHT_N_M3, Ground
from blind.vendors import Vendor

from daq import Channel, FloatArray, RunInfo, TerrainConfig, VehicleConfig
from daq.can import FrameBatch, Message, encode, load_database, merge
from daq.logs import write_candump
from daq.recording import RecordingWriter

BUS = "can1"


def vehicle_config(day: FieldDay, *, wheel_axes: bool = False, bus: str = BUS) -> VehicleConfig:
    """Return vehicle.toml: what the owner knows, and of the brakes only whether they were released."""
    suite, vendor, own = day.suite, day.vendor, day.world.vehicle
    latencies = {
        **dict.fromkeys(("drawbar_pull", "vertical_load", "driving_torque", "wheel_angle"), suite.force_latency_s),
        "wheel_speed": suite.wheel_latency_s,
        **dict.fromkeys(("latitude", "longitude"), suite.gnss_transport_s),
        "ground_speed": suite.gnss_latency_s,
    }
    sigmas = {
        "drawbar_pull": suite.pull_n,
        "driving_torque": suite.torque_nm,
        "vertical_load": suite.load_n,
        "ground_speed": hypot(suite.speed_mps, suite.speed_white_mps),
    }
    sensors = {
        role: {"latency_s": round(latency, 5)}
        | ({"sigma": round(sigmas[role], 4)} if vendor.declares_sigma and role in sigmas else {})
        for role, latency in latencies.items()
        if role in vendor.signals
    }
    brakes = {} if day.stance.held else {"standstill_brakes": "released"}
    rotated = {"frame": "wheel", "angle_offset_deg": 25.0, "angle_direction": -1} if wheel_axes else {}
    return VehicleConfig.model_validate(
        {
            "vehicle": {"name": f"{vendor.name} test vehicle", "mass_kg": round(own.mass_kg, 1), **brakes},
            "wheel": {
                "radius_m": own.radius_m,
                "width_m": own.width_m,
                "position": "rear left",
                "outboard_mass_kg": own.outboard_kg,
                "outboard_inertia_kgm2": own.outboard_kgm2,
            },
            "bus": [{"channel": bus, "dbc": [f"{vendor.name}.dbc"], "bitrate": 1_000_000, "fd": vendor.fd}],
            "signals": {role: name for role, (name, _) in vendor.signals.items()},
            "sensors": sensors,
            "transducer": {"zero": "lifted", **rotated},
        }
    )


def terrain_config(soil: str | Ground) -> TerrainConfig:
    """Return terrain.toml: the laboratory's values and how sure it is of them."""
    ground = LABORATORY[soil] if isinstance(soil, str) else soil
    return TerrainConfig.model_validate(
        {
            "soil": {
                "name": ground.name,
                "cohesion_kpa": ground.cohesion / 1e3,
                "friction_angle_deg": degrees(np.arctan(ground.friction)),
                "shear_modulus_m": ground.shear_modulus,
                "sinkage_exponent": ground.exponent,
                "cohesive_modulus_kn": ground.cohesive / 1e3,
                "frictional_modulus_kn": ground.frictional / 1e3,
                "unit_weight_kn_m3": UNIT_WEIGHT_N_M3 / 1e3,
            },
            "uncertainty": {
                "cohesion_kpa": SPREAD["cohesion"],
                "friction_angle_deg": SPREAD["friction"],
                "shear_modulus_m": SPREAD["shear_modulus"],
                "sinkage_exponent": SPREAD["exponent"],
                "cohesive_modulus_kn": SPREAD["cohesive"],
                "frictional_modulus_kn": SPREAD["frictional"],
            },
        }
    )


def run_info(plan: Plan, file: str = "") -> RunInfo:
    """Return a run's entry of runs.toml."""
    return RunInfo(
        file=file,
        id=f"r{plan.index + 1}",
        direction="out" if plan.direction > 0 else "back",
        pass_number=plan.passes,
        added_load_kg=round(plan.added_load_kg, 1),
        inflation_kpa=INFLATION_KPA,
    )


def write_campaign(
    folder: Path, day: FieldDay, hidden: Sequence[tuple[str, float]], *, runs: int | None = None, bus: str = BUS
) -> None:
    """Write a campaign folder that any command takes."""
    vendor = day.vendor
    vehicle = vehicle_config(day, wheel_axes=vendor.wheel_axes, bus=bus)
    carried = {
        f"{vendor.name}.dbc": vendor.dbc.encode(),
        "vehicle.toml": _toml(vehicle),
        "terrain.toml": _toml(terrain_config(day.laboratory)),
    }
    folder.mkdir(parents=True, exist_ok=True)
    for name, content in carried.items():
        (folder / name).write_bytes(content)
    entries = []
    for plan, channels in list(zip(day.plans, driven(day, hidden), strict=True))[:runs]:
        info = run_info(plan, f"{plan.index + 1:02d}.{'mcap' if vendor.log == 'mcap' else 'log'}")
        frames = frames_of(vendor, channels, day.world.vehicle.radius_m, bus)
        if vendor.log == "mcap":
            with RecordingWriter(
                folder / info.file, run=info, attachments=carried, flush_every_s=None, sync_every_s=None
            ) as writer:
                writer.write_frames(frames)
        else:
            write_candump([frames], folder / info.file)
        entries.append(info.model_dump(mode="json", exclude_none=True))
    (folder / "runs.toml").write_text(tomli_w.dumps({"run": entries}), encoding="utf-8")


def frames_of(vendor: Vendor, channels: Mapping[str, Channel], radius_m: float, bus: str = BUS) -> FrameBatch:
    """Encode a run."""
    channels = _in_wheel_axes(channels) if vendor.wheel_axes else channels
    messages = {m.name: m for m in load_database(vendor.dbc.encode(), f"{vendor.name}.dbc").messages}
    content: dict[str, dict[str, FloatArray]] = {}
    stamps = {}
    for role, (name, factor) in vendor.signals.items():
        message, signal = name.lstrip("-").split(".")
        factor *= radius_m if role == "wheel_speed" and vendor.rim_speed else 1.0
        content.setdefault(message, {})[signal] = channels[role].values * factor
        stamps[message] = channels[role].time_ns
    return merge([_encoded(messages[name], values, stamps[name], bus) for name, values in content.items()])


def _encoded(message: Message, values: dict[str, FloatArray], time_ns: object, bus: str) -> FrameBatch:
    encoded = encode(message, values, time_ns, bus)  # type: ignore[arg-type]
    assert not encoded.saturated, encoded.saturated
    return encoded.frames


def _in_wheel_axes(channels: Mapping[str, Channel]) -> dict[str, Channel]:
    """Turn the forces with the wheel, and send the angle as this vendor counts it."""
    psi = channels["wheel_angle"].values
    x, z = channels["drawbar_pull"], channels["vertical_load"]
    turned = {
        "drawbar_pull": x.values * np.cos(psi) - z.values * np.sin(psi),
        "vertical_load": x.values * np.sin(psi) + z.values * np.cos(psi),
        "wheel_angle": np.mod(-psi + np.radians(25.0), 2 * np.pi),
    }
    return {
        role: Channel(role, channel.unit, channel.time_ns, turned.get(role, channel.values))
        for role, channel in channels.items()
    }


def _toml(config: VehicleConfig | TerrainConfig) -> bytes:
    return tomli_w.dumps(config.model_dump(mode="json", exclude_none=True, exclude_defaults=True)).encode()

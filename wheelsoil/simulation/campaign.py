"""A simulated campaign: runs of the virtual test as frames, and a campaign folder for every command.

terrain.toml and vehicle.toml contain what a test engineer knows; only manifest.toml contains the true values (hidden
effect, seed, soil of the field).
"""

from __future__ import annotations

import hashlib
import re
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import asdict, dataclass, replace
from math import radians
from pathlib import Path
from typing import Any, Literal

import numpy as np
import tomli_w
from pydantic import BaseModel, ValidationError

from daq import (
    SOIL_KEYS,
    STANDARD_GRAVITY_MPS2,
    Channel,
    ConfigError,
    FloatArray,
    RunInfo,
    RutReading,
    SoilSection,
    TerrainConfig,
    VehicleConfig,
)
from daq.can import Decoder, FrameBatch, load_database, resolve_roles, shipped_dbc
from model.effects import EFFECTS, Effect, parted
from model.simulation import (
    HELD_IN,
    TRUTH_QUADRATURE,
    TRUTH_RATE_HZ,
    SensedRun,
    Stance,
    Steering,
    TransducerSetup,
    VirtualRun,
    VirtualSetup,
    drawn_soil,
    lifted_run,
    virtual_stretches,
    whole,
)
from model.wheel_soil import LABORATORY_SPREAD, Soil, WheelSoilModel, soil_from_terrain
from processing import LEVEL_DEG
from wheelsoil import __version__
from wheelsoil.simulation.options import LAYOUTS, SimulationOptions
from wheelsoil.simulation.ruts import drawn_rebound_m, rut_readings, slips_read
from wheelsoil.simulation.vehicle import (
    AXLES,
    axle_of,
    config_of_wheels,
    frame_batches,
    frames_of_wheels,
    place_m,
    side_of,
    vehicle_config,
    virtual_frames,
)

Format = Literal["mcap", "candump", "both"]

BUS = "can0"
MANIFEST_FILE = "manifest.toml"
_BETWEEN_RUNS_S = 600.0
_ANGLE_OFFSET_DEG = 40.0
"""Offset of the encoder of a transducer in wheel axes, an arbitrary angle."""
_TRIES = 1000
_CYCLE = re.compile(rb'(BA_ "GenMsgCycleTime" BO_ \d+ )\d+;')
_ROUNDING = 1e-9
"""Tolerance of a covariance's positive definiteness, relative to the variances."""


@dataclass(frozen=True)
class SimulatedCampaign:
    """What `simulate_campaign` has written: the files of the runs, recordings first, and the frames in all of them."""

    folder: Path
    files: tuple[Path, ...]
    frames: int


def simulated_setup(options: SimulationOptions) -> VirtualSetup:
    """Return the vehicle, its driver and its sensors."""
    setup = VirtualSetup(duration_s=options.duration_s)
    transducer = replace(setup.transducer, rate_hz=options.transducer_rate_hz)
    if options.wheel_axes:
        zero = "spin" if options.lifted else transducer.zero  # the weight turns: no tare takes it off
        transducer = replace(transducer, frame="wheel", angle_offset_deg=_ANGLE_OFFSET_DEG, zero=zero)
    k, ring, gnss, length_m = options.noise, setup.wheel_speed, setup.gnss, setup.vehicle.wheelbase_m
    return replace(
        setup,
        steering=Steering(radians(options.steering_deg), length_m, place_m("", length_m))
        if options.steering_deg
        else None,
        motion_sigmas=tuple(k * sigma for sigma in setup.motion_sigmas),
        stance=true_stance(options),
        transducer=_quieter(transducer, k),
        wheel_speed=replace(ring, pitch_error=k * ring.pitch_error, eccentricity=k * ring.eccentricity),
        gnss=replace(
            gnss,
            speed_noise_mps=k * gnss.speed_noise_mps,
            speed_white_noise_mps=k * gnss.speed_white_noise_mps,
            position_noise_m=k * gnss.position_noise_m,
        ),
    )


def setup_of_wheel(options: SimulationOptions, wheel: str) -> VirtualSetup:
    """Return the vehicle, its driver and its sensors as they are at one wheel, by its id; empty: the only one.

    What the rear wheels do not carry at rest, and of an added load, the front wheels do.
    """
    setup = simulated_setup(options)
    if not wheel:
        return setup
    rear = setup.vehicle
    front = replace(
        rear,
        static_load_n=0.5 * rear.mass_kg * STANDARD_GRAVITY_MPS2 - rear.static_load_n,
        added_load_share=0.5 - rear.added_load_share,
        load_transfer=-rear.load_transfer,
    )
    transducer = replace(setup.transducer, side=side_of(wheel))
    steering = setup.steering and replace(setup.steering, wheel_m=place_m(wheel, rear.wheelbase_m))
    return replace(setup, vehicle=front if axle_of(wheel) == 1 else rear, transducer=transducer, steering=steering)


def simulated_vehicle(options: SimulationOptions) -> VehicleConfig:
    """Return vehicle.toml."""
    if options.wheels == 1:
        return vehicle_config(simulated_setup(options), options.wheel, BUS)
    setups = {wheel: setup_of_wheel(options, wheel) for wheel in LAYOUTS[options.wheels]}
    return config_of_wheels(setups, options.wheel, _buses(options))


def _buses(options: SimulationOptions) -> dict[str, str]:
    """Return the bus of each wheel's transducer: three messages at 1 kHz fill half of one."""
    return {wheel: f"{BUS[:-1]}{number}" for number, wheel in enumerate(LAYOUTS[options.wheels])}


def _quieter(setup: TransducerSetup, factor: float) -> TransducerSetup:
    x, z = setup.zero_offset_n
    return replace(
        setup,
        drawbar_pull_noise_n=factor * setup.drawbar_pull_noise_n,
        load_noise_n=factor * setup.load_noise_n,
        lateral_noise_n=factor * setup.lateral_noise_n,
        torque_noise_nm=factor * setup.torque_noise_nm,
        white_noise_n=factor * setup.white_noise_n,
        white_noise_nm=factor * setup.white_noise_nm,
        zero_offset_n=(factor * x, factor * z),
    )


def true_stance(options: SimulationOptions) -> Stance:
    """Return the tilt of the ground and the brakes at the standstills, drawn where they are not given."""
    rng = _stream(options, 0, 0)
    tilt_deg, held = float(rng.uniform(-LEVEL_DEG, LEVEL_DEG)), bool(rng.random() < HELD_IN)
    return Stance(
        tilt_deg if options.tilt_deg is None else options.tilt_deg, options.brakes or ("held" if held else "released")
    )


def true_soil(options: SimulationOptions) -> Soil:
    """Return the true soil of the field: the laboratory's, or one drawn from its uncertainty.

    Relative one-sigmas are used as in `model.simulation.drawn_soil`; if terrain.toml states no uncertainty, they are
    `model.wheel_soil.LABORATORY_SPREAD`. With a covariance the soil is normally distributed in the keys and units of
    ``[soil]``; a draw with a value out of range or without stiffness is repeated. `ConfigError` where the covariance is
    not positive semi-definite, or no soil can be drawn from it.
    """
    laboratory, terrain, rng = options.laboratory_soil, options.terrain, _stream(options, 0)
    stated = terrain.uncertainty
    if not options.draw_soil:
        return laboratory
    if stated is None:
        return drawn_soil(laboratory, rng)
    if stated.covariance is None:
        sigmas = [getattr(stated, key) or 0.0 for key in SOIL_KEYS]
        return drawn_soil(laboratory, rng, dict(zip(LABORATORY_SPREAD, sigmas, strict=True)))
    root = _root(np.array(stated.covariance), options.soil)
    mean = np.array([getattr(terrain.soil, key) for key in SOIL_KEYS])
    for _ in range(_TRIES):
        soil = _soil(terrain.soil, mean + root @ rng.standard_normal(len(SOIL_KEYS)))
        if soil and soil.stiffness(options.wheel.width_m) > 0:
            return soil
    raise ConfigError.of(
        "no soil can be drawn from the covariance",
        options.soil,
        f"{_TRIES} draws, each with a value out of its range",
        next_step="check the covariance: its rows are " + ", ".join(SOIL_KEYS),
    )


def _root(covariance: FloatArray, where: str) -> FloatArray:
    """Return the lower Cholesky factor of the covariance."""
    variances = np.diag(covariance)
    sigma = np.sqrt(np.where(variances > 0, variances, 0.0))
    scale = np.where(sigma > 0, sigma, 1.0)
    correlation = covariance / np.outer(scale, scale)
    try:
        if not (np.isfinite(covariance).all() and np.allclose(correlation, correlation.T) and (variances >= 0).all()):
            raise np.linalg.LinAlgError
        root = np.linalg.cholesky(correlation + _ROUNDING * np.eye(len(covariance)))
    except np.linalg.LinAlgError:
        raise ConfigError.of(
            "the covariance is not positive semi-definite",
            where,
            expected="symmetric, no variance or combination of them below zero",
            next_step="use the covariance that `wheelsoil soil` writes, or relative one-sigmas under [uncertainty]",
        ) from None
    return np.asarray(sigma[:, np.newaxis] * root)


def _soil(laboratory: SoilSection, values: FloatArray) -> Soil | None:
    drawn = laboratory.model_dump() | dict(zip(SOIL_KEYS, values.tolist(), strict=True))
    try:
        return soil_from_terrain(TerrainConfig(soil=SoilSection(**drawn)))
    except ValidationError:
        return None


def simulated_run(options: SimulationOptions, index: int) -> VirtualRun:
    """Return one run of a campaign at once; as `simulated_stretches`."""
    return whole(simulated_stretches(options, index))


def simulated_stretches(options: SimulationOptions, index: int, wheel: str = "") -> Iterator[VirtualRun]:
    """Yield one run of a campaign at one wheel, stretch by stretch; it does not depend on the others.

    From index 0 loads and directions alternate. `wheel` is the id of one of several, which share the drive and the GNSS
    fixes. `DataError` where the soil does not carry the wheel.
    """
    acting = _effects_at(options, wheel, "physical")
    model = WheelSoilModel(
        options.wheel, true_soil(options), [effect for effect, _ in acting], options.reading, TRUTH_QUADRATURE
    )
    interval_s = options.duration_s + _BETWEEN_RUNS_S
    elapsed_s = index * interval_s
    info = _info(options, index)
    number = LAYOUTS[options.wheels].index(wheel)
    if wheel:
        passages = (info.pass_number - 1) * AXLES + axle_of(wheel)
        info = info.model_copy(update={"pass_number": passages})
    return virtual_stretches(
        setup_of_wheel(options, wheel),
        model,
        {key: value for effect, values in acting for key, value in effect.keyed(values).items()},
        info,
        start_ns=_start_ns(options, elapsed_s),
        elapsed_s=elapsed_s,
        rng=_stream(options, 2 + index),
        ring=_stream(options, 0, 7, number) if number else _stream(options, 1),
        own=_stream(options, 0, 6, index, number) if wheel else None,
        campaign_s=(options.runs - 1) * interval_s + options.duration_s,
        faults=_effects_at(options, wheel, "measurement"),
    )


def _stream(options: SimulationOptions, *number: int) -> np.random.Generator:
    """Return an independent stream: 0 the soil, (0, 0) the stance, (0, 1) and (0, 2) the lifted wheel before and after.

    (0, 3) is the rebound of ruts, (0, 4, run) their readings, (0, 5) the set of a model file, 1 the toothed ring,
    from 2 on the runs; (0, 6, run, wheel) is what is of one of several wheels alone, (0, 7, wheel) its ring.
    """
    return np.random.default_rng(np.random.SeedSequence(options.seed, spawn_key=number))


def lifted_runs(options: SimulationOptions) -> tuple[SensedRun, ...]:
    """Return the recordings of the lifted wheel before and after the runs; none where none is asked for."""
    between_s = options.duration_s + _BETWEEN_RUNS_S
    campaign_s = (options.runs - 1) * between_s + options.duration_s
    return tuple(
        lifted_run(
            simulated_setup(options),
            RunInfo(id=f"lifted-{name}"),
            start_ns=_start_ns(options, elapsed_s),
            elapsed_s=elapsed_s,
            campaign_s=campaign_s,
            wheel_radius_m=options.wheel.radius_m,
            rng=_stream(options, 0, number),
            ring=_stream(options, 1),
            faults=_effects_at(options, "", "measurement"),
        )
        for number, (name, elapsed_s) in enumerate(
            (("before", -_BETWEEN_RUNS_S), ("after", campaign_s + _BETWEEN_RUNS_S)) if options.lifted else (), 1
        )
    )


def simulated_ruts(options: SimulationOptions, index: int) -> tuple[RutReading, ...]:
    """Return the rut readings of one run, drawn from its true sinkage; none where none is asked for."""
    slips = slips_read(options.rut, index, options.runs)
    if not len(slips):
        return ()
    rebound_m = drawn_rebound_m(_stream(options, 0, 3))
    return rut_readings(simulated_run(options, index).truth, slips, rebound_m, _stream(options, 0, 4, index))


def _start_ns(options: SimulationOptions, elapsed_s: float) -> int:
    return round((options.start.timestamp() + elapsed_s) * 1e6) * 1000


def _effects_at(options: SimulationOptions, wheel: str, kind: str) -> list[tuple[type[Effect], Mapping[str, float]]]:
    """Return the effects of a kind that act at a wheel."""
    alone = options.faulty_wheel if kind == "measurement" else ""
    chosen = [
        (EFFECTS[name], values) for name, values in options.effects.items() if (parted(name)[1] or alone) in ("", wheel)
    ]
    return [(effect, values) for effect, values in chosen if effect.kind == kind]


def _info(options: SimulationOptions, index: int) -> RunInfo:
    return RunInfo(
        id=f"run-{index + 1}",
        direction="back" if index % 2 else "out",
        pass_number=options.pass_number[index % len(options.pass_number)],
        added_load_kg=options.added_load_kg[index % len(options.added_load_kg)],
        inflation_kpa=options.inflation_kpa[index % len(options.inflation_kpa)] if options.inflation_kpa else None,
    )


def campaign_frames(options: SimulationOptions) -> Iterator[tuple[RunInfo, Iterator[FrameBatch]]]:
    """Yield each run with its frames, which are calculated as they are taken."""
    for index in range(options.runs):
        wheels = {wheel: simulated_stretches(options, index, wheel) for wheel in LAYOUTS[options.wheels]}
        stretches = (dict(zip(wheels, runs, strict=True)) for runs in zip(*wheels.values(), strict=True))
        yield _info(options, index), frames_of_wheels(stretches, _buses(options))


def simulated_roles(options: SimulationOptions, index: int) -> tuple[dict[str, Channel], VehicleConfig, RunInfo]:
    """Return one run as input of the processing: encoded into frames and decoded again, without a file.

    Returns
    -------
    channels : mapping role -> Channel, in SI; without positions
    """
    vehicle = vehicle_config(simulated_setup(options), options.wheel, BUS)
    databases = {BUS: tuple(load_database(shipped_dbc(name)) for name in vehicle.bus[0].dbc)}
    roles = [role for role in vehicle.signals if role not in ("latitude", "longitude")]
    references = resolve_roles(vehicle, databases, (), roles)
    run = simulated_run(options, index)
    decoded = Decoder(databases, {reference.name for reference in references.values()}).decode(virtual_frames(run, BUS))
    return {role: ref.to_si(decoded[ref.key]) for role, ref in references.items()}, vehicle, run.info


def simulate_campaign(
    folder: Path, options: SimulationOptions, *, kind: Format = "mcap", decoded: bool = False, force: bool = False
) -> SimulatedCampaign:
    """Write a campaign folder.

    Parameters
    ----------
    folder : Path
        Created if it does not exist; otherwise it must be empty.
    kind : "mcap", "candump" or "both"
        File format of the runs; runs.toml names the recordings if there are any.
    decoded : bool
        Whether recordings contain decoded topics beside the raw frames.
    force : bool
        Write into a folder that is not empty, and replace files of the same names.

    Raises
    ------
    ConfigError
        The folder is not usable.
    DataError
        The soil cannot carry the wheel.
    RecordingError, HardwareError
        The files cannot be written.
    """
    _check_folder(folder, force=force)
    vehicle = simulated_vehicle(options)
    carried = {
        "vehicle.toml": to_toml(vehicle),
        "terrain.toml": to_toml(options.terrain),
        **{name: shipped_dbc(name).read_bytes() for name in vehicle.bus[0].dbc},
    }
    carried["wft.dbc"] = _CYCLE.sub(rf"\g<1>{round(1000 / options.transducer_rate_hz)};".encode(), carried["wft.dbc"])
    with _nothing_left_of_a_failure(folder):
        for name, content in carried.items():
            (folder / name).write_bytes(content)
        suffixes = {"mcap": (".mcap",), "candump": (".log",), "both": (".mcap", ".log")}[kind]
        infos: list[RunInfo] = []
        files: list[Path] = []
        entries: list[dict[str, Any]] = []
        for index, (run, batches) in enumerate(campaign_frames(options)):
            paths = [folder / f"{run.id}{suffix}" for suffix in suffixes]
            info = run.model_copy(update={"file": paths[0].name})
            counted = _Counted(batches)
            _write_run(paths, info, counted, carried, vehicle, decoded=decoded)
            infos.append(info.model_copy(update={"rut": simulated_ruts(options, index)}))
            files += paths
            entries.append({"file": paths[0].name, "frames": counted.frames, "frames_sha256": counted.hash.hexdigest()})
        for lifted in lifted_runs(options):
            paths = [folder / f"{lifted.info.id}{suffix}" for suffix in suffixes]
            _write_run(paths, lifted.info, frame_batches([lifted], BUS), carried, vehicle, decoded=decoded)
            files += paths
        (folder / "runs.toml").write_bytes(runs_toml(infos))
        (folder / MANIFEST_FILE).write_bytes(_manifest(options, entries))
    files.sort(key=lambda path: suffixes.index(path.suffix))
    return SimulatedCampaign(folder, tuple(files), sum(entry["frames"] for entry in entries))


def runs_toml(infos: list[RunInfo]) -> bytes:
    """Return runs.toml, one ``[[run]]`` table each."""
    return tomli_w.dumps({"run": [info.model_dump(mode="json", exclude_none=True) for info in infos]}).encode()


def to_toml(config: BaseModel) -> bytes:
    """Return a validated model as TOML, without keys at their default."""
    return tomli_w.dumps(config.model_dump(mode="json", exclude_none=True, exclude_defaults=True)).encode()


def frames_sha256(frames: FrameBatch) -> str:
    """Return the hash of the frames themselves: their records of 24 (FD: 80) bytes, in order, uncompressed."""
    return hashlib.sha256(frames.frames.tobytes()).hexdigest()


def _check_folder(folder: Path, *, force: bool) -> None:
    if folder.exists() and not folder.is_dir():
        raise ConfigError.of("the output is a file", folder, next_step="name a folder")
    if not folder.parent.is_dir():
        raise ConfigError.of("no such folder", folder.parent, next_step="create it or choose another output")
    if not force and folder.is_dir() and any(folder.iterdir()):
        raise ConfigError.of("the folder is not empty", folder, next_step="choose another name, or --force")


@contextmanager
def _nothing_left_of_a_failure(folder: Path) -> Iterator[None]:
    """Make a folder if it does not exist; on any error take out what was added, and the folder if it is new."""
    before = set(folder.iterdir()) if folder.is_dir() else None
    folder.mkdir(exist_ok=True)
    try:
        yield
    except BaseException:
        for path in set(folder.iterdir()) - (before or set()):
            path.unlink()
        if before is None:
            folder.rmdir()
        raise


class _Counted:
    """Batches on their way into a file, counted and hashed as `frames_sha256` does."""

    def __init__(self, batches: Iterable[FrameBatch]) -> None:
        self._batches = batches
        self.frames = 0
        self.hash = hashlib.sha256()

    def __iter__(self) -> Iterator[FrameBatch]:
        for batch in self._batches:
            self.frames += len(batch)
            self.hash.update(batch.frames.tobytes())
            yield batch


def _write_run(
    paths: list[Path],
    info: RunInfo,
    batches: Iterable[FrameBatch],
    carried: dict[str, bytes],
    vehicle: VehicleConfig,
    *,
    decoded: bool,
) -> None:
    """Write one run into each of its files, or none where that fails."""
    from daq.logs import write_candump
    from daq.recording import Recording

    try:
        for path in paths:
            if path.suffix == ".mcap":
                _write_recording(path, info, batches, carried, vehicle, decoded=decoded)
                batches = Recording.open(path).frame_batches()
            else:
                write_candump(batches, path)
    except BaseException:
        for path in paths:
            path.unlink(missing_ok=True)
        raise


def _write_recording(
    path: Path,
    info: RunInfo,
    batches: Iterable[FrameBatch],
    carried: dict[str, bytes],
    vehicle: VehicleConfig,
    *,
    decoded: bool,
) -> None:
    from daq.recording import DecodedWriter, RecordingWriter

    databases = {bus.channel: tuple(load_database(carried[name], name) for name in bus.dbc) for bus in vehicle.bus}
    decoder = Decoder(databases)
    # the same command repeats what a crash would lose, so the size of a chunk is not limited
    with RecordingWriter(
        path, run=info, attachments=carried, overwrite=True, flush_every_s=None, sync_every_s=None
    ) as writer:
        topics = DecodedWriter(writer, vehicle, databases) if decoded else None
        for batch in batches:
            writer.write_frames(batch)
            if topics:
                topics.write(decoder.decode(batch))


def _manifest(options: SimulationOptions, runs: list[dict[str, Any]]) -> bytes:
    soil = true_soil(options)
    manifest = {
        "command": options.command,
        "wheelsoil_version": __version__,
        "numpy_version": np.__version__,
        "truth": {
            "seed": options.seed,
            "reading": options.reading,
            "rate_hz": TRUTH_RATE_HZ,
            "quadrature": asdict(TRUTH_QUADRATURE),
            "wheel": asdict(options.wheel),
            **({"wheels": list(LAYOUTS[options.wheels])} if options.wheels > 1 else {}),
            **({"faulty_wheel": options.faulty_wheel} if options.faulty_wheel else {}),
            **({"model_set": options.model_set} if options.model_set else {}),
            "soil": asdict(soil),
            **asdict(true_stance(options)),
            **({"steering_deg": options.steering_deg} if options.steering_deg else {}),
            "effect": [{"name": name, "parameters": dict(values)} for name, values in options.effects.items()],
        },
        "run": runs,
    }
    return f"# True values of these runs. No processing reads this file.\n{tomli_w.dumps(manifest)}".encode()

"""``wheelsoil zero``."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from daq import ConfigError, Fault, number
from wheelsoil.cli.options import Json, LenientDbc, OneWheel, Vehicle
from wheelsoil.console import print_json, print_pairs, print_table, say

if TYPE_CHECKING:
    from daq import Note, Quantity, WheelSection
    from processing.transducer_zero import Drift
    from wheelsoil.workflows.zero import Found


def zero_command(
    recordings: Annotated[
        list[Path],
        typer.Argument(
            metavar="RECORDING...",
            help="Recordings of a lifted wheel, turning evenly or at rest. Two or more give the drift.",
        ),
    ],
    vehicle: Vehicle = None,
    wheel: OneWheel = None,
    output: Annotated[
        Path | None,
        typer.Option("--output", "-o", metavar="FILE", help="Append to this file (default: beside vehicle.toml)."),
    ] = None,
    from_s: Annotated[
        float | None, typer.Option("--from", metavar="S", help="Start of the used interval, after the first sample.")
    ] = None,
    to_s: Annotated[
        float | None, typer.Option("--to", metavar="S", help="End of the used interval, after the first sample.")
    ] = None,
    on_ground: Annotated[
        bool,
        typer.Option(
            "--on-ground", help="The wheel stands on level ground with released brakes: pull and torque only."
        ),
    ] = False,
    max_drift: Annotated[
        str | None,
        typer.Option("--max-drift", metavar="UNIT=VALUE,...", help="Fail beyond this drift, e.g. N=50,Nm=10."),
    ] = None,
    lenient_dbc: LenientDbc = False,
    json: Json = False,
) -> None:
    """Determine a transducer's zero from a lifted wheel: stationary and rotating part of every channel, with sigma.

    Appends to zero.toml; `log` attaches it if vehicle.toml names it, and `process` subtracts it. With two or more
    recordings the drift between them is printed. The exit code is 1 beyond --max-drift, or if that is not comparable.
    """
    from daq.runs import one_wheel, open_runs
    from wheelsoil.wording.notes import texts_of
    from wheelsoil.workflows.zero import all_compared, append, check_place, drifts, find_zeros, too_far, zero_path

    most = _limits(max_drift)
    first = one_wheel(open_runs(recordings[:1], vehicle=vehicle, lenient_dbc=lenient_dbc), wheel)[0]
    target = zero_path(first, vehicle, output)
    check_place(target)
    found = find_zeros(
        recordings, vehicle=vehicle, wheel=wheel, from_s=from_s, to_s=to_s, on_ground=on_ground, lenient_dbc=lenient_dbc
    )
    rows, remarks = drifts(found)
    append(target, found)
    beyond = too_far(rows, most)
    unknown = bool(most) and not all_compared(found)
    if json:
        print_json(_as_json(target, found, rows, remarks))
    else:
        _print(found, rows)
    for result in found:
        for text in texts_of(result.remarks):
            say(f"{result.run.path.name}: {text}")
    for text in texts_of(remarks):
        say(f"drift: {text}")
    say(f"wrote {target}")
    usual = zero_path(first, vehicle, None)
    if not first.vehicle.transducer.zero_file or target.resolve() != usual.resolve():
        say(f"  {_to_do(target, usual.parent, first.vehicle.wheel)}")
    for row in beyond:
        say(f"{row.channel}: {row.part} moved by {row.change:+.4g} {row.unit}, beyond --max-drift {max_drift}")
    if unknown:
        say("--max-drift cannot be checked: it needs two or more recordings of the same kind")
    if beyond or unknown:
        raise typer.Exit(1)


def _to_do(written: Path, folder: Path, wheel: WheelSection | None) -> str:
    """Return the next step if vehicle.toml, in a folder, does not name the written file."""
    put = "" if written.resolve().parent == folder.resolve() else "put it beside vehicle.toml, and "
    section = f"[wheel.transducer] of wheel {wheel.id} in" if wheel and wheel.id else "[transducer] of"
    line = f'{put}add under {section} vehicle.toml: zero_file = "{written.name}"'
    return f"vehicle.toml does not name it, so `log` does not attach it and `process` does not subtract it; {line}"


def _limits(text: str | None) -> dict[Quantity, float]:
    """Return the largest drift of forces and moments, in SI, from ``UNIT=VALUE,...``."""
    from daq import Quantity, find_unit

    limits: dict[Quantity, float] = {}
    faults = []
    for part in text.split(",") if text else ():
        name, _, value = part.partition("=")
        unit = find_unit(name, (Quantity.FORCE, Quantity.MOMENT))
        try:
            most = float(value)
        except ValueError:
            most = -1.0
        if unit is None or not 0 < most < float("inf"):
            faults.append(Fault(f"--max-drift {part!r} is not understood", expected="UNIT=VALUE,..., e.g. N=50,Nm=10"))
        else:
            limits[unit.quantity] = most * unit.factor
    ConfigError.stop_if_any(faults)
    return limits


def _as_json(target: Path, found: Sequence[Found], rows: Sequence[Drift], remarks: Sequence[Note]) -> dict[str, Any]:
    from wheelsoil.to_json import plain

    return {
        "file": target,
        "zeros": [
            plain(result.determination.model_dump(mode="json"))
            | {"check": result.check, "outliers": result.outliers, "remarks": result.remarks}
            for result in found
        ],
        "drift": [plain(row) | {"significant": row.significant} for row in rows],
        "remarks": remarks,
    }


def _print(found: Sequence[Found], rows: Sequence[Drift]) -> None:
    for result in found:
        print_pairs(_facts(result))
        print()
        print_table(
            ["channel", "unit", "offset", "sigma", "cos", "sin", "sigma", "2/rev"],
            [
                [
                    name,
                    zero.unit,
                    f"{zero.offset:.2f}",
                    f"{zero.offset_sigma:.2f}",
                    *(_or_dash(value) for value in (zero.cos, zero.sin, zero.rotating_sigma, zero.twice)),
                ]
                for name, zero in result.determination.channels.items()
            ],
            left=2,
        )
        print()
    if rows:
        print_table(
            ["drift", "part", "unit", "change", "sigma", ""],
            [
                [
                    row.channel,
                    row.part,
                    row.unit,
                    f"{row.change:+.2f}",
                    f"{row.sigma:.2f}",
                    "significant" if row.significant else "within 3 sigma",
                ]
                for row in rows
            ],
            left=3,
        )


def _facts(result: Found) -> list[tuple[str, str]]:
    zero, check = result.determination, result.check
    how = f"{zero.revolutions} revolutions at {abs(zero.speed_radps):.2f} rad/s" if zero.speed_radps else "one angle"
    if not zero.revolutions and zero.angle_deg is not None:
        how = f"at {zero.angle_deg:.1f} deg"
    lines = [
        ("recording", str(result.run.path)),
        ("time", f"{zero.time_utc:%Y-%m-%d %H:%M:%S}Z"),
        ("method", f"{zero.method}, {how}, {zero.frame} axes" + (", on the ground" if zero.on_ground else "")),
        ("used", f"{zero.start_s:.2f} to {zero.start_s + zero.duration_s:.2f} s"),
    ]
    if zero.temperature_degc is not None:
        lines.append(("temperature", f"{zero.temperature_degc:.0f} degC"))
    if check:
        lines.append(
            ("outboard mass", f"{check.mass_kg:.2f} ± {check.mass_sigma_kg:.2f} kg, declared {check.declared_kg:g} kg")
        )
        if check.angle_error_deg == check.angle_error_deg:
            error = f"{check.angle_error_deg:+.2f} ± {check.angle_error_sigma_deg:.2f} deg"
            lines.append(("error of the wheel angle", f"{error}, by the direction of the weight"))
    spikes: Mapping[str, int] = {name: count for name, count in result.outliers.items() if count}
    if spikes:
        lines.append(("excluded spikes", ", ".join(f"{name} {count:,}" for name, count in spikes.items())))
    return lines


def _or_dash(value: float | None) -> str:
    return "-" if value is None else number(value) if abs(value) >= 1e4 else f"{value:.2f}"

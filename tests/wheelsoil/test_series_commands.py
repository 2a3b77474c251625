"""A run as decoded series goes the whole way: info, import, process, fit and diagnose, like the frames it came from."""

from __future__ import annotations

import re
import shutil
from collections.abc import Mapping
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from cli_support import invoke, ok
from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory

from daq import Channel, IntArray
from daq.recording import Recording
from daq.runs import open_runs
from processing.pipeline import process

ROOT = Path(__file__).parents[2]
CLAY = ROOT / "recordings" / "clay"
WANTED = ("vertical_load", "drawbar_pull", "driving_torque", "wheel_speed", "ground_speed", "ground_speed_valid")


def write_csv(path: Path, channels: Mapping[str, Channel]) -> None:
    """Write the channels side by side, in kN where they are forces, each group with its own time in seconds."""
    groups: dict[tuple[int, ...], list[str]] = {}
    for role in WANTED:
        time_ns = channels[role].time_ns
        groups.setdefault((len(time_ns), int(time_ns[0])), []).append(role)
    columns: list[tuple[str, list[str]]] = []
    for i, roles in enumerate(groups.values()):
        seconds = [f"{t // 10**9}.{t % 10**9:09d}" for t in channels[roles[0]].time_ns.tolist()]
        columns.append((f"time_{i} [s]", seconds))
        for role in roles:
            factor, unit = (1e-3, "kN") if channels[role].unit == "N" else (1.0, channels[role].unit)
            columns.append((f"{role} [{unit}]", [repr(v * factor) for v in channels[role].values.tolist()]))
    longest = max(len(cells) for _, cells in columns)
    rows = ([cells[i] if i < len(cells) else "" for _, cells in columns] for i in range(longest))
    path.write_text("\n".join([",".join(name for name, _ in columns), *map(",".join, rows)]) + "\n")


def series_vehicle(source: Path, target: Path) -> None:
    """Write the vehicle.toml of a campaign with columns in place of signals and without its bus."""
    text = source.read_text()
    text = re.sub(r"\[\[bus\]\].*?(?=\n\[)", "", text, flags=re.S)
    signals = "\n".join(f'{role} = "{role}"' for role in WANTED)
    target.write_text(re.sub(r"\[signals\].*?(?=\n\[)", f"[signals]\n{signals}\n", text, flags=re.S))


@pytest.fixture(scope="module")
def campaign(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a folder with the first three sample runs on clay as CSV."""
    folder = tmp_path_factory.mktemp("series")
    for run in open_runs([CLAY / f"run-{i}.mcap" for i in (1, 2, 3)], vehicle=CLAY / "vehicle.toml"):
        write_csv(folder / f"{run.id}.csv", run.channels())
    series_vehicle(CLAY / "vehicle.toml", folder / "vehicle.toml")
    shutil.copy(CLAY / "terrain.toml", folder)
    shutil.copy(CLAY / "runs.toml", folder)
    runs = (folder / "runs.toml").read_text().split("[[run]]")
    (folder / "runs.toml").write_text("[[run]]".join(runs[:4]).replace(".mcap", ".csv"))
    return folder


@pytest.fixture(scope="module")
def imported_run(campaign: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return its first run as a recording."""
    target = tmp_path_factory.mktemp("imported") / "run-1.mcap"
    ok("import", campaign / "run-1.csv", "-o", target)
    return target


def test_series_are_processed_like_the_frames_that_they_came_from(campaign: Path, imported_run: Path) -> None:
    (frames,) = open_runs([CLAY / "run-1.mcap"])
    direct, imported = (open_runs([path])[0] for path in (campaign / "run-1.csv", imported_run))
    kept = {role: frames.channels()[role] for role in WANTED}
    wanted = process(kept, frames.vehicle, frames.info)
    for run in (direct, imported):
        found = process(run.channels(), run.vehicle, frames.info)
        assert found.start_ns == wanted.start_ns
        np.testing.assert_allclose(found.slip, wanted.slip, rtol=1e-9, atol=1e-12)
        np.testing.assert_allclose(found.drawbar_pull_n, wanted.drawbar_pull_n, rtol=1e-9, atol=1e-9)
        np.testing.assert_array_equal(found.reason, wanted.reason)


def test_a_recording_of_series_holds_what_the_file_held(campaign: Path, imported_run: Path) -> None:
    (direct,), (imported,) = open_runs([campaign / "run-1.csv"]), open_runs([imported_run])
    assert direct.series is not None and imported.series is not None
    assert imported.series.topics == direct.series.topics
    for role, channel in direct.channels().items():
        np.testing.assert_array_equal(imported.channels()[role].time_ns, channel.time_ns)
        np.testing.assert_array_equal(imported.channels()[role].values, channel.values)
    recording = Recording.open(imported_run)
    assert "vehicle.toml" in recording.attachments and not recording.loss
    with imported_run.open("rb") as file:  # an independent reader
        reader = make_reader(file, decoder_factories=[DecoderFactory()])
        *_, message = next(iter(reader.iter_decoded_messages(["/series/time_0_s"])))
    assert message.vertical_load_k_n == direct.channels()["vertical_load"].values[0] / 1e3


def test_series_go_down_to_a_diagnosis(campaign: Path) -> None:
    said = ok("diagnose", campaign, "--effects", "vasilev,lyasko,slope,torque_zero", "--most-causes", 1, "--json").json
    assert said["verdict"] in ("named", "one_of")
    assert said["candidates"][0]["name"] == "slip_sinkage"
    fitted = ok("fit", campaign, "--json").json
    assert fitted


def test_info_shows_every_column_before_anything_is_declared(campaign: Path, tmp_path: Path) -> None:
    shutil.copy(campaign / "run-1.csv", tmp_path / "run.csv")
    (facts,) = ok("info", tmp_path / "run.csv", "--json").json
    assert facts["kind"] == "delimited text"
    columns = {signal["name"]: signal for message in facts["messages"] for signal in message["signals"]}
    assert columns["vertical_load [kN]"]["unit"] == "kN"
    assert 5.5 < columns["vertical_load [kN]"]["least"] < columns["vertical_load [kN]"]["most"] < 10
    rates = sorted(message["rate_hz"] for message in facts["messages"])
    assert rates[0] == pytest.approx(20, rel=0.01) and rates[-1] == pytest.approx(1000, rel=0.01)
    assert "vertical_load [kN]" in ok("info", tmp_path / "run.csv").out


def test_info_says_what_is_missing_of_a_message(tmp_path: Path) -> None:
    time_ns: IntArray = np.arange(1000) * 10_000_000
    kept = (np.arange(1000) < 300) | (np.arange(1000) >= 600)
    table = pa.table({"time_ns": time_ns[kept], "Fz [N]": np.ones(700)})
    pq.write_table(table, tmp_path / "run.parquet")
    (facts,) = ok("info", tmp_path / "run.parquet", "--json").json
    (message,) = facts["messages"]
    assert message["missing_share"] == pytest.approx(0.3, abs=0.002)
    assert message["longest_gap_s"] == pytest.approx(3.01) and message["gap_at_s"] == pytest.approx(2.99)
    assert "30.0 %" in ok("info", tmp_path / "run.parquet").out


def test_info_of_a_log_takes_its_dbcs_by_an_option(tmp_path: Path) -> None:
    (run,) = open_runs([CLAY / "run-1.mcap"])
    from daq.logs import write_candump

    write_candump(run.frame_batches(), tmp_path / "run.log")
    (bare,) = ok("info", tmp_path / "run.log", "--json").json
    assert {message["name"] for message in bare["messages"]} == {
        f"0x{row['can_id']:03X}" for row in bare["coverage"]["ids"]
    }
    named = ok("info", tmp_path / "run.log", "--dbc", f"can0={CLAY / 'wft.dbc'}", "--json").json[0]
    assert "WFT_Forces" in {message["name"] for message in named["messages"]}


def test_several_files_of_one_run_are_one_recording(campaign: Path, tmp_path: Path) -> None:
    for name, columns in (("forces", ("vertical_load",)), ("gnss", ("ground_speed",))):
        (run,) = open_runs([campaign / "run-1.csv"])
        channel = run.channels()[columns[0]]
        table = pa.table({"time_ns": channel.time_ns, f"{columns[0]} [{channel.unit}]": channel.values})
        pq.write_table(table, tmp_path / f"{name}.parquet")
    ok("import", tmp_path / "forces.parquet", tmp_path / "gnss.parquet", "-o", tmp_path / "run.mcap")
    (joined,) = open_runs([tmp_path / "run.mcap"])
    assert joined.series is not None and joined.series.topics.keys() == {"forces", "gnss"}
    blocks = [block for together in joined.series.blocks() for block in together]
    assert sum(len(block) for block in blocks if block.topic == "gnss") == 800


@pytest.mark.parametrize(
    ("signals", "what"),
    [
        ('vertical_load = "FZ"', "no column is called 'FZ'"),
        ('vertical_load = "force"', "has no unit, where force is needed"),
        ('vertical_load = {signal = "force", unit = "furlong"}', "has the unknown unit 'furlong'"),
        ('vertical_load = {signal = "force", unit = "kN", sgn = 1}', "unknown key"),
        ('vertical_load = "speed [km/h]"', "measures speed"),
        ('vertical_load = "twice"', "is there several times"),
    ],
)
def test_a_wrong_role_is_said(tmp_path: Path, signals: str, what: str) -> None:
    (tmp_path / "run.csv").write_text("time [s],force,speed [km/h],twice [N],twice [kN]\n0.0,1,2,3,4\n0.5,1,2,3,4\n")
    (tmp_path / "vehicle.toml").write_text(f"[wheel]\nradius_m = 0.4\nwidth_m = 0.2\n[signals]\n{signals}\n")
    result = invoke("process", tmp_path / "run.csv")
    assert result.code == 2 and what in result.err and "Traceback" not in result.err


def test_a_stated_unit_and_sign_hold(tmp_path: Path) -> None:
    (tmp_path / "run.csv").write_text("time [s],force\n0.0,1\n0.5,2\n")
    text = '[signals]\nvertical_load = {signal = "force", unit = "kN", sign = -1}\n'
    (tmp_path / "vehicle.toml").write_text(text)
    (run,) = open_runs([tmp_path / "run.csv"])
    assert run.channels()["vertical_load"].values.tolist() == [-1000.0, -2000.0]


@pytest.mark.parametrize("kind", ["csv", *(pytest.param(kind, marks=pytest.mark.slow) for kind in ("parquet", "mat"))])
def test_our_own_exports_and_tables_read_back(kind: str, tmp_path: Path) -> None:
    ok("export", CLAY / "run-1.mcap", "-o", tmp_path / kind, "--format", kind, "--signal", "WFT_Forces.Fz")
    (file,) = (tmp_path / kind).iterdir()
    (facts,) = ok("info", file, "--json").json
    (message,) = facts["messages"]
    assert message["samples"] == 40_000
    assert [(s["name"].split()[0], s["unit"]) for s in message["signals"]] == [("Fz", "N")]
    ok("process", CLAY / "run-1.mcap", "-o", tmp_path / f"table.{kind}")
    (facts,) = ok("info", tmp_path / f"table.{kind}", "--json").json
    (message,) = facts["messages"]
    units = {signal["name"].split(" [")[0]: signal["unit"] for signal in message["signals"]}
    assert units["vertical_load_n"] == "N" and message["rate_hz"] == pytest.approx(100)

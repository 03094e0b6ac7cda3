"""Sessions as others open them: read back by other people's readers, and by a strict one written here from the spec."""

import csv
import shutil
import subprocess
import sys

import pyarrow.parquet as pq
import pytest
from mcap.reader import make_reader

from truearc.cli.main import main
from truearc.hw.reason import unit_of
from truearc.robot.reasons import texts
from truearc.robot.recording.reader import TickReader
from truearc.robot.recording.session import load_trials
from truearc.robot.recording.tabular import FLOAT, INT, FlatTicks


def convert(session, to, out):
    assert main(["session", "convert", str(session), "--to", to, "-o", str(out), "--quiet"]) == 0
    return out


def ticks(session):
    return [tick for tick, _ in TickReader(session)]


def test_csv_has_a_row_a_tick_and_a_row_a_trial(plain, tmp_path):
    out = convert(plain, "csv", tmp_path / "week.csv")
    rows = list(csv.DictReader(out.open(encoding="utf-8")))
    recorded = ticks(plain)
    assert len(rows) == len(recorded)
    for row, tick in zip(rows, recorded, strict=True):
        assert int(row["inputs.t_ns"]) == tick.inputs.t_ns
        assert float(row["inputs.flywheels.0.velocity_rad_s"]) == tick.inputs.flywheels[0].velocity_rad_s
        assert row["estimate.distance_m"] == ("" if tick.estimate.distance_m is None
                                              else repr(tick.estimate.distance_m))
        assert row["verdict.fire"] == ("true" if tick.verdict.fire else "false")
        assert row["verdict.reasons"] == "; ".join(texts(tick.verdict.reasons))
        assert row["outcomes"] == "; ".join(f"trial {mark.trial} {mark.outcome}" for mark in tick.outcomes)
    trials = list(csv.DictReader((tmp_path / "week.trials.csv").open(encoding="utf-8")))
    assert [(trial["trial"], trial["outcome"], float(trial["hood_deg"])) for trial in trials] == [
        (str(trial.outcome.trial), trial.outcome.outcome, trial.shot.hood_deg) for trial in load_trials(plain)]


def test_parquet_says_the_same_with_units(plain, tmp_path):
    table = pq.read_table(convert(plain, "parquet", tmp_path / "s.parquet"))
    flat, recorded = FlatTicks(2), ticks(plain)
    assert table.column_names == [column.name for column in flat.columns] and table.num_rows == len(recorded)
    assert table.schema.field("command.hood_torque_nm").metadata == {b"unit": b"Nm"}
    for at in (0, 500, 980):
        row = [table[name][at].as_py() for name in table.column_names]
        assert row == flat.row(recorded[at])
    trials = pq.read_table(tmp_path / "s.trials.parquet").to_pylist()
    assert [trial["distance_m"] for trial in trials] == [trial.shot.distance_m for trial in load_trials(plain)]


def read_mcap(path):
    """Data of the messages of each topic, and the names of their schemas."""
    with path.open("rb") as file:
        messages = list(make_reader(file).iter_messages())
    return ({topic: [message.data for _, channel, message in messages if channel.topic == topic]
             for topic in ("/tick", "/trial")}, {schema.name for schema, _, _ in messages})


def test_mcap_has_the_ticks_and_trials_that_the_recording_has(plain, tmp_path):
    heard, schemas = read_mcap(plain / "telemetry.mcap")
    assert heard["/tick"] == [data for _, data in TickReader(plain)] and len(heard["/tick"]) > 1000
    assert heard["/trial"] == (plain / "trials.jsonl").read_bytes().splitlines()
    assert schemas == {"truearc.Tick", "truearc.Trial"}
    (heard, schemas), (recorded, names) = (read_mcap(path) for path in (
        convert(plain, "mcap", tmp_path / "s.mcap"), plain / "telemetry.mcap"))
    assert heard == recorded and schemas > names


def test_a_recording_is_never_written_over_and_nothing_is_left_of_a_failure(plain, tmp_path, capsys):
    before = (plain / "telemetry.mcap").read_bytes()
    assert main(["session", "convert", str(plain), "--to", "mcap", "-o", str(plain / "telemetry.mcap"), "--force"]) == 2
    assert "never written over" in capsys.readouterr().err
    assert (plain / "telemetry.mcap").read_bytes() == before
    assert main(["session", "convert", str(tmp_path / "nowhere"), "--to", "csv", "-o", str(tmp_path / "x.csv")]) == 2
    assert main(["session", "convert", str(plain), "--to", "csv", "-o", str(tmp_path / "no" / "x.csv")]) == 2
    assert list(tmp_path.iterdir()) == []


def test_without_pyarrow_parquet_says_what_to_install(plain, tmp_path):
    code = ("import sys; sys.modules['pyarrow'] = None\nfrom truearc.cli.main import main\n"
            f"sys.exit(main(['session', 'convert', {str(plain)!r}, '--to', 'parquet', '-o', "
            f"{str(tmp_path / 'x.parquet')!r}]))")
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert done.returncode == 2 and "truearc[sim]" in done.stderr and "Traceback" not in done.stderr


def test_a_recording_cut_short_is_converted_as_far_as_it_goes_and_says_so(plain, tmp_path, capsys):
    session = shutil.copytree(plain, tmp_path / "s")
    data = (session / "telemetry.mcap").read_bytes()
    (session / "telemetry.mcap").write_bytes(data[:100_000])
    convert(session, "csv", tmp_path / "s.csv")
    assert "truearc session recover" in capsys.readouterr().err
    (session / "telemetry.mcap").write_bytes(b"")
    assert main(["session", "convert", str(session), "--to", "csv", "-o", str(tmp_path / "t.csv")]) == 2
    assert "no ticks" in capsys.readouterr().err and not (tmp_path / "t.csv").exists()


@pytest.mark.parametrize("kept", [0, 1])
def test_trials_that_only_the_telemetry_has_are_converted_and_counted(plain, tmp_path, capsys, kept):
    session = shutil.copytree(plain, tmp_path / "s")
    convert(session, "csv", tmp_path / "whole.csv")
    lines = (session / "trials.jsonl").read_bytes().splitlines(keepends=True)
    assert "warning" not in capsys.readouterr().err
    (session / "trials.jsonl").write_bytes(b"".join(lines[:kept]))
    convert(session, "csv", tmp_path / "cut.csv")
    assert f"trials.jsonl: {2 - kept} of 2 trials were missing" in capsys.readouterr().err
    assert (tmp_path / "cut.trials.csv").read_text() == (tmp_path / "whole.trials.csv").read_text()


def test_every_number_of_a_tick_says_its_unit_or_needs_none():
    bare = {column.name.rpartition(".")[2] for column in FlatTicks(2).columns
            if column.kind in (FLOAT, INT) and not column.unit}
    assert bare == {"cycle", "axis_state", "axis_error", "faults", "frames", "motor_ratio", "p_two", "p_three",
                    "integral", "measurement", "rate", "trial", "0", "1", "2", "refused", "phase", "correction",
                    "trim", "push", "stuck_at", "jams", "differ", "failures"}
    assert unit_of("a.velocity_rad_s") == "rad/s" and unit_of("a.t_ns") == "ns" and unit_of("a.homed") == ""

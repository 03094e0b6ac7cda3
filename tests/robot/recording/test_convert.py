"""Sessions as others open them: read back by other people's readers, and by a strict one written here from the spec."""

import csv
import io
import json
import math
import shutil
import struct
import subprocess
import sys
from pathlib import Path

import pyarrow.parquet as pq
import pytest
from hypothesis import given
from hypothesis import strategies as st
from mcap.reader import make_reader

from truearc.cli.main import main
from truearc.hw.reason import unit_of
from truearc.robot.reasons import texts
from truearc.robot.recording.export.tabular import FLOAT, INT, TEXTS, FlatTicks
from truearc.robot.recording.reader import TickReader
from truearc.robot.recording.session import load_trials
from truearc_frc.wpilog_export import WpilogWriter, make_payload

HERE = Path(__file__).parent


def convert(session, to, out):
    assert main(["session", "convert", str(session), "--to", to, "-o", str(out), "--quiet"]) == 0
    return out


def ticks(session):
    return [tick for tick, _ in TickReader(session)]


def read_wpilog(data):
    """Signals, number -> (name, type, metadata), and records (number, t_us, payload)."""
    assert data[:8] == b"WPILOG\x00\x01"
    at = 12 + struct.unpack_from("<I", data, 8)[0]
    signals, records = {}, []
    while at < len(data):
        sizes = data[at]
        assert not sizes & 0x80
        at += 1
        fields = []
        for length in ((sizes & 3) + 1, (sizes >> 2 & 3) + 1, (sizes >> 4 & 7) + 1):
            fields.append(int.from_bytes(data[at:at + length], "little"))
            at += length
        number, size, t_us = fields
        payload = data[at:at + size]
        assert len(payload) == size
        at += size
        if number == 0:
            assert payload[0] == 0
            texts, place = [], 5
            for _ in range(3):
                length = struct.unpack_from("<I", payload, place)[0]
                texts.append(payload[place + 4:place + 4 + length].decode())
                place += 4 + length
            assert place == len(payload)
            signals[struct.unpack_from("<I", payload, 1)[0]] = tuple(texts)
        else:
            assert number in signals
            records.append((number, t_us, payload))
    return signals, records


def test_a_wpilog_has_every_signal_when_it_changes(plain, tmp_path):
    signals, records = read_wpilog(convert(plain, "wpilog", tmp_path / "s.wpilog").read_bytes())
    numbers = {name: number for number, (name, _, _) in signals.items()}
    assert signals[numbers["/estimate/hood_deg"]] == ("/estimate/hood_deg", "double", '{"unit": "deg"}')
    assert signals[numbers["/verdict/reasons"]][1] == "string[]"
    for name, get in (("/estimate/hood_deg", lambda tick: tick.estimate.hood_deg),
                      ("/inputs/flywheels/1/velocity_rad_s", lambda tick: tick.inputs.flywheels[1].velocity_rad_s)):
        held = {t_us: struct.unpack("<d", payload)[0]
                for number, t_us, payload in records if number == numbers[name]}
        value = None
        for tick in ticks(plain):
            value = held.get(tick.inputs.t_ns // 1000, value)
            assert math.isnan(value) if get(tick) is None else value == get(tick)
    trials = [json.loads(payload) for number, _, payload in records if number == numbers["/trial"]]
    assert [trial["outcome"]["outcome"] for trial in trials] == [trial.outcome.outcome for trial in load_trials(plain)]
    assert all(isinstance(t_us, int) for _, t_us, _ in records)
    assert [t_us for _, t_us, _ in records] == sorted(t_us for _, t_us, _ in records)


def test_wpilibs_own_reader_agrees(plain, tmp_path):
    """The reader behind AdvantageScope's and SysId's file format."""
    log = pytest.importorskip("wpiutil.log")
    path = convert(plain, "wpilog", tmp_path / "s.wpilog")
    signals, records = read_wpilog(path.read_bytes())
    reader = log.DataLogReader(str(path))
    assert reader.isValid() and reader.getVersion() == 0x0100 and reader.getExtraHeader() == "truearc"
    started, heard = {}, []
    getters = {"double": "getDouble", "int64": "getInteger", "boolean": "getBoolean", "string": "getString",
               "json": "getString", "string[]": "getStringArray", "double[]": "getDoubleArray"}
    for record in reader:
        if record.isStart():
            start = record.getStartData()
            started[start.entry] = (start.name, start.type, start.metadata)
            continue
        kind = started[record.getEntry()][1]
        value = bytes(record.getRaw()) if kind.startswith("struct") else getattr(record, getters[kind])()
        heard.append((record.getEntry(), record.getTimestamp(), value))
    assert started == signals and len(heard) == len(records)
    for (number, t_us, value), (entry, stamp, payload) in zip(heard, records, strict=True):
        assert (number, t_us) == (entry, stamp)
        if signals[number][1] == "double":
            assert struct.pack("<d", value) == payload
        elif signals[number][1] == "int64":
            assert struct.pack("<q", value) == payload
        elif signals[number][1].startswith("struct"):
            assert value == payload


def test_a_wpilog_has_poses_by_their_schemas_and_when_the_robot_was_enabled(plain, tmp_path):
    signals, records = read_wpilog(convert(plain, "wpilog", tmp_path / "s.wpilog").read_bytes())
    numbers = {name: number for number, (name, _, _) in signals.items()}
    schemas = {name.removeprefix("/.schema/struct:"): next(
        payload.decode() for at, _, payload in records if at == number)
        for name, number in numbers.items() if name.startswith("/.schema/struct:")}
    assert all(signals[numbers[f"/.schema/struct:{name}"]][1] == "structschema" for name in schemas)
    assert signals[numbers["/pose"]][1] == "struct:Pose2d" and signals[numbers["DS:enabled"]][1] == "boolean"

    def decode(kind, data):                       # by WPILib's struct schema language, as far as it is used
        fields = {}
        for field in schemas[kind].split(";"):
            inner, name = field.split()
            if inner == "double":
                fields[name], data = struct.unpack("<d", data[:8])[0], data[8:]
            else:
                fields[name], data = decode(inner, data)
        return fields, data

    poses = {t_us: decode("Pose2d", payload) for number, t_us, payload in records if number == numbers["/pose"]}
    enabled = {t_us: payload for number, t_us, payload in records if number == numbers["DS:enabled"]}
    pose, armed = None, None
    for tick in ticks(plain):
        pose, armed = poses.get(tick.inputs.t_ns // 1000, pose), enabled.get(tick.inputs.t_ns // 1000, armed)
        assert armed == (b"\1" if tick.memory.armed else b"\0")
        if tick.estimate.distance_m is None:
            assert pose is None
            continue
        found, rest = pose
        assert rest == b"" and found["translation"] == {"x": tick.estimate.distance_m, "y": 0.0}
        yaw = found["rotation"]["value"]          # the target, seen from the robot, lies to its right by the bearing
        ahead, left = (-found["translation"]["x"] * math.cos(yaw), found["translation"]["x"] * math.sin(yaw))
        assert math.degrees(math.atan2(-left, ahead)) == pytest.approx(tick.memory.last_sighting.bearing_deg, abs=1e-9)
    assert len(enabled) >= 2 and len(poses) > 10


@given(number=st.integers(1, 400), t_us=st.integers(0, 2**63 - 1), texts=st.lists(st.text(max_size=20), max_size=4))
def test_records_of_every_size_are_read_back(number, t_us, texts):
    file = io.BytesIO()
    log = WpilogWriter(file, "é")
    numbers = [log.start(f"/s{index}", TEXTS, "", 0) for index in range(number)]
    payload = make_payload(TEXTS, texts)
    assert payload is not None
    log.append(numbers[-1], t_us, payload)
    signals, records = read_wpilog(file.getvalue())
    assert len(signals) == number and records == [(number, t_us, payload)]
    assert struct.unpack_from("<I", payload)[0] == len(texts)


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


def test_a_recording_itself_has_ticks_and_trials(plain):
    heard, schemas = read_mcap(plain / "telemetry.mcap")
    assert heard["/tick"] == [data for _, data in TickReader(plain)] and len(heard["/tick"]) > 1000
    assert heard["/trial"] == (plain / "trials.jsonl").read_bytes().splitlines()
    assert schemas == {"truearc.Tick", "truearc.Trial"}


def test_mcap_has_what_the_recording_has(plain, tmp_path):
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

"""WPILOG of a session: read back by WPILib's own reader, and by a strict one written here from the spec."""

import io
import json
import math
import struct

import pytest
from hypothesis import given
from hypothesis import strategies as st
from wpiutil import log as wpilog

from tests.frc.test_dashboards import DASHBOARDS
from tests.robot.recording.test_convert import convert, ticks
from truearc.robot.recording.session import load_trials
from truearc.robot.recording.tabular import TEXTS
from truearc_frc.wpilog import WpilogWriter, make_payload


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
    path = convert(plain, "wpilog", tmp_path / "s.wpilog")
    signals, records = read_wpilog(path.read_bytes())
    reader = wpilog.DataLogReader(str(path))
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


def test_the_advantagescope_layout_shows_signals_that_are_there(plain, tmp_path):
    out = convert(plain, "wpilog", tmp_path / "s.wpilog")
    kinds = {"double": "Number", "int64": "Number", "boolean": "Boolean", "struct:Pose2d": "Pose2d"}
    there = {}
    for record in wpilog.DataLogReader(str(out)):
        if record.isStart():
            start = record.getStartData()         # good until the next record only
            there[start.name] = kinds.get(start.type)
    (hub,) = json.loads((DASHBOARDS / "advantagescope.json").read_text(encoding="utf-8"))["hubs"]
    sources = [source for tab in hub["state"]["tabs"]["tabs"] if tab["controller"]
               for sources in tab["controller"].values() if isinstance(sources, list) for source in sources]
    assert len(sources) > 15
    assert all(there[source["logKey"]] == source["logType"] for source in sources)

"""WPILOG of a session by WPILib's own reader, as AdvantageScope and SysId have it; layouts of dashboards."""

import io
import json
import math
import struct
from pathlib import Path
from typing import Any, NamedTuple

import pytest
from hypothesis import given
from hypothesis import strategies as st
from wpiutil import log as wpilog

from tests.robot.recording.test_convert import convert
from truearc.robot.recording.reader import TickReader
from truearc.robot.recording.session import load_trials
from truearc.robot.recording.tabular import TEXTS
from truearc_frc.keys import OURS
from truearc_frc.wpilog import WpilogWriter, make_payload

DASHBOARDS = Path(__file__).parents[2] / "examples" / "dashboards"
PUBLISHED = {"p_two", "p_three", "verdict", "reasons", "novelty", "hood_deg", "wheel_rad_s", "correction", "age_s",
             "lead_deg"}
GETTERS = {"double": "getDouble", "int64": "getInteger", "boolean": "getBoolean", "string": "getString",
           "json": "getString", "string[]": "getStringArray", "double[]": "getDoubleArray"}


class Log(NamedTuple):
    """signals: name -> (type, metadata); records: name -> time in us -> value; stamps: in the order of the file."""

    signals: dict[str, tuple[str, str]]
    records: dict[str, dict[int, Any]]
    stamps: list[int]


def read(reader: wpilog.DataLogReader) -> Log:
    assert reader.isValid() and reader.getVersion() == 0x0100
    names, log = dict[int, str](), Log({}, {}, [])
    for record in reader:
        if record.isStart():
            start = record.getStartData()         # good until the next record only
            names[start.entry], log.signals[start.name] = start.name, (start.type, start.metadata)
            log.records[start.name] = {}
            continue
        name = names[record.getEntry()]
        getter = GETTERS.get(log.signals[name][0])
        log.records[name][record.getTimestamp()] = getattr(record, getter)() if getter else bytes(record.getRaw())
        log.stamps.append(record.getTimestamp())
    return log


@pytest.fixture(scope="module")
def log(plain: Path, tmp_path_factory: pytest.TempPathFactory) -> Log:
    path = convert(plain, "wpilog", tmp_path_factory.mktemp("wpilog") / "s.wpilog")
    reader = wpilog.DataLogReader(str(path))
    assert reader.getExtraHeader() == "truearc"
    return read(reader)


def test_a_wpilog_has_every_signal_when_it_changes(log: Log, plain: Path) -> None:
    assert log.signals["/estimate/hood_deg"] == ("double", '{"unit": "deg"}')
    assert log.signals["/verdict/reasons"][0] == "string[]"
    for name, get in (("/estimate/hood_deg", lambda tick: tick.estimate.hood_deg),
                      ("/inputs/flywheels/1/velocity_rad_s", lambda tick: tick.inputs.flywheels[1].velocity_rad_s)):
        value = None
        for tick in [tick for tick, _ in TickReader(plain)]:
            value = log.records[name].get(tick.inputs.t_ns // 1000, value)
            assert math.isnan(value) if get(tick) is None else value == get(tick)
    trials = [json.loads(trial)["outcome"]["outcome"] for trial in log.records["/trial"].values()]
    assert trials == [trial.outcome.outcome for trial in load_trials(plain)]
    assert log.stamps == sorted(log.stamps)


def test_a_wpilog_has_poses_by_their_schemas_and_when_the_robot_was_enabled(log: Log, plain: Path) -> None:
    schemas = {name.removeprefix("/.schema/struct:"): next(iter(said.values())).decode()
               for name, said in log.records.items() if name.startswith("/.schema/struct:")}
    assert all(log.signals[f"/.schema/struct:{name}"][0] == "structschema" for name in schemas)
    assert log.signals["/pose"][0] == "struct:Pose2d" and log.signals["DS:enabled"][0] == "boolean"

    def decode(kind: str, data: bytes) -> tuple[dict[str, Any], bytes]:
        """By WPILib's struct schema language, as far as it is used."""
        fields: dict[str, Any] = {}
        for field in schemas[kind].split(";"):
            inner, name = field.split()
            if inner == "double":
                fields[name], data = struct.unpack("<d", data[:8])[0], data[8:]
            else:
                fields[name], data = decode(inner, data)
        return fields, data

    poses = {t_us: decode("Pose2d", payload) for t_us, payload in log.records["/pose"].items()}
    enabled = log.records["DS:enabled"]
    pose, armed = None, None
    for tick in [tick for tick, _ in TickReader(plain)]:
        pose, armed = poses.get(tick.inputs.t_ns // 1000, pose), enabled.get(tick.inputs.t_ns // 1000, armed)
        assert armed is tick.memory.armed
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
def test_records_of_every_size_are_read_back(number: int, t_us: int, texts: list[str]) -> None:
    file = io.BytesIO()
    writer = WpilogWriter(file, "é")
    numbers = [writer.start(f"/s{index}", TEXTS, "", 0) for index in range(number)]
    writer.append(numbers[-1], t_us, make_payload(TEXTS, texts))
    found = read(wpilog.DataLogReader(file.getvalue(), "s"))
    assert len(found.signals) == number and found.records[f"/s{number - 1}"] == {t_us: texts}


def test_the_advantagescope_layout_shows_signals_that_are_there(log: Log) -> None:
    kinds = {"double": "Number", "int64": "Number", "boolean": "Boolean", "struct:Pose2d": "Pose2d"}
    (hub,) = json.loads((DASHBOARDS / "advantagescope.json").read_text(encoding="utf-8"))["hubs"]
    sources = [source for tab in hub["state"]["tabs"]["tabs"] if tab["controller"]
               for sources in tab["controller"].values() if isinstance(sources, list) for source in sources]
    assert len(sources) > 15
    assert all(kinds[log.signals[source["logKey"]][0]] == source["logType"] for source in sources)


# --- layouts show topics that are published

def test_live_layouts_show_every_topic_once_by_its_type() -> None:
    (tab,) = json.loads((DASHBOARDS / "elastic.json").read_text(encoding="utf-8"))["tabs"]
    shown = [box["properties"]["topic"] for box in tab["grid_layout"]["containers"]]
    assert sorted(shown) == sorted(OURS + name for name in PUBLISHED)
    (hub,) = json.loads((DASHBOARDS / "advantagescope-live.json").read_text(encoding="utf-8"))["hubs"]
    drawn = [one for tab in hub["state"]["tabs"]["tabs"] if tab["type"] == 1             # line graphs
             for side in ("leftSources", "rightSources", "discreteSources") for one in tab["controller"][side]]
    assert sorted(one["logKey"] for one in drawn) == sorted(f"NT:{OURS}{name}" for name in PUBLISHED)
    types = {"verdict": "String", "reasons": "StringArray"}
    assert all(one["logType"] == types.get(one["logKey"].removeprefix(f"NT:{OURS}"), "Number") for one in drawn)

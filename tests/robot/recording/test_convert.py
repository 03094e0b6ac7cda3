"""Sessions as others open them: by other people's readers, JSON Schema and the official Foxglove schemas."""

import base64
import csv
import importlib
import json
import math
import re
import shutil
import subprocess
import sys
from collections import defaultdict
from pathlib import Path

import cv2
import msgspec
import numpy as np
import pyarrow.parquet as pq
import pytest
from google.protobuf.descriptor import FieldDescriptor
from jsonschema import Draft202012Validator
from mcap.reader import make_reader

import truearc as ta
from truearc.cli.main import main
from truearc.robot.reasons import texts
from truearc.robot.recording.export import SCHEMAS
from truearc.robot.recording.files import load_image, load_pictures
from truearc.robot.recording.reader import TickReader
from truearc.robot.recording.session import load_trials
from truearc.robot.recording.tabular import FlatTicks


def convert(session, to, out):
    assert main(["session", "convert", str(session), "--to", to, "-o", str(out), "--quiet"]) == 0
    return out


@pytest.fixture(scope="module")
def all_ticks(plain):
    return [tick for tick, _ in TickReader(plain)]


def test_csv_has_a_row_a_tick_and_a_row_a_trial(plain, all_ticks, tmp_path):
    out = convert(plain, "csv", tmp_path / "week.csv")
    rows = list(csv.DictReader(out.open(encoding="utf-8")))
    for row, tick in zip(rows, all_ticks, strict=True):
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


def test_parquet_says_the_same_with_units(plain, all_ticks, tmp_path):
    table = pq.read_table(convert(plain, "parquet", tmp_path / "s.parquet"))
    flat = FlatTicks(2)
    assert table.column_names == [column.name for column in flat.columns] and table.num_rows == len(all_ticks)
    assert table.schema.field("command.hood_torque_nm").metadata == {b"unit": b"Nm"}
    for at in (0, 500, 980):
        row = [table[name][at].as_py() for name in table.column_names]
        assert row == flat.row(all_ticks[at])
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


def test_a_recording_cut_short_is_converted_as_far_as_it_goes_and_says_so(plain, tmp_path, capsys):
    session = shutil.copytree(plain, tmp_path / "s")
    data = (session / "telemetry.mcap").read_bytes()
    (session / "telemetry.mcap").write_bytes(data[:100_000])
    convert(session, "csv", tmp_path / "s.csv")
    assert "truearc session recover" in capsys.readouterr().err
    assert main(["session", "replay", str(session), "--check"]) == 1
    assert any("cut short" in line for line in ta.shots_from_sessions([session], "cut").left_out)
    capsys.readouterr()
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


BELIEF = 'schema = "truearc.coefficients/1"\n[drag]\ncd = 0.5\n[magnus]\ncl = 0.05\n[wind_y]\nspeed_m_s = 2.0\n'
DASHBOARDS = Path(__file__).parents[3] / "examples" / "dashboards"


def export(session, out, *more):
    assert main(["session", "convert", str(session), "--to", "mcap", "-o", str(out), "--quiet", *more]) == 0
    return out


class Exported:
    """A file: by topic its schema, and (log time, message) of each of its messages; attachments and metadata."""

    def __init__(self, path):
        self.schemas, self.messages = {}, defaultdict(list)
        with path.open("rb") as file:
            reader = make_reader(file, validate_crcs=True)
            for schema, channel, message in reader.iter_messages():
                assert (schema.encoding, channel.message_encoding) == ("jsonschema", "json")
                self.schemas[channel.topic] = schema.name, json.loads(schema.data)
                self.messages[channel.topic].append((message.log_time, json.loads(message.data)))
            self.attachments = {one.name: one.data for one in reader.iter_attachments()}
            (metadata,) = reader.iter_metadata()
            self.metadata = metadata.metadata

    def only(self, topic):
        return [message for _, message in self.messages[topic]]


@pytest.fixture(scope="module")
def belief(tmp_path_factory):
    path = tmp_path_factory.mktemp("belief") / "belief.toml"
    path.write_text(BELIEF, encoding="utf-8")
    return path


@pytest.fixture(scope="module")
def path(plain, belief, tmp_path_factory):
    return export(plain, tmp_path_factory.mktemp("exported") / "s.mcap", "--belief", str(belief))


@pytest.fixture(scope="module")
def exported(path):
    return Exported(path)


def check_plain(schema):
    """What viewers read: an object of the five plain types, nested, and lists of them; no reference and no null."""
    assert schema["type"] == "object" and "$ref" not in schema and schema["description"]
    for field in schema["properties"].values():
        assert field["type"] in ("boolean", "string", "number", "integer", "object", "array")
        assert field["description"]
        inner = field["items"] if field["type"] == "array" else field
        assert inner["type"] in ("boolean", "string", "number", "integer", "object")
        if inner["type"] == "object":
            check_plain(inner | {"description": inner.get("description", "as the field")})


def test_every_message_fits_its_schema(exported):
    assert len(exported.schemas) == 22
    for topic, (name, schema) in exported.schemas.items():
        if topic in ("/tick", "/trial"):          # the recording's own, with references; its root says what it is
            assert schema["type"] == "object" and name in ("truearc.Tick", "truearc.Trial")
        else:
            check_plain(schema)
            assert schema["title"] == name
        Draft202012Validator.check_schema(schema)
        closed = Draft202012Validator({**schema, "additionalProperties": name in ("truearc.Tick", "truearc.Trial")})
        for message in exported.only(topic)[::7]:
            closed.validate(message)


def test_fields_say_their_units(exported):
    said = {f"{topic}.{field}": kind["description"] for topic, (_, schema) in exported.schemas.items()
            for field, kind in schema["properties"].items()}
    assert said["/estimate.hood_deg"] == "unit: deg" and said["/flywheels/motor_0.velocity_rad_s"] == "unit: rad/s"
    assert said["/estimate.motor_ratio"] == "unit: 1" and said["/estimate.closing_m_s"] == "unit: m/s"
    assert said["/shot.t_ns"].startswith("unit: ns, on the robot's own clock")
    for place, unit in said.items():
        assert unit != "unit: 1" or not place.endswith(("_m", "_s", "_v", "_a", "_deg", "_rad", "_nm", "_ns", "_px"))


def test_topics_have_what_the_ticks_have(exported, all_ticks):
    for topic, get in (("/estimate", lambda tick: tick.estimate), ("/aim", lambda tick: tick.aim),
                       ("/flywheels/motor_1", lambda tick: tick.inputs.flywheels[1]),
                       ("/hood/motor", lambda tick: tick.inputs.hood_motor)):
        wanted = [{key: value for key, value in msgspec.to_builtins(get(tick)).items() if value is not None}
                  for tick in all_ticks]
        assert exported.only(topic) == wanted
    assert [one["reasons"] for one in exported.only("/verdict")] == [texts(tick.verdict.reasons) for tick in all_ticks]
    assert exported.only("/battery") == [{"battery_v": tick.estimate.battery_v} for tick in all_ticks]
    shots = [tick.shot for tick in all_ticks if tick.shot is not None]
    assert [(one["trial"], one["distance_m"]) for one in exported.only("/shot")] == [
        (shot.trial, shot.distance_m) for shot in shots] and len(shots) == 2
    seen = [tick.inputs.sighting for tick in all_ticks if tick.inputs.sighting is not None]
    assert [one["t_ns"] for one in exported.only("/camera/sighting")] == [sighting.t_ns for sighting in seen]
    corners = [[part for corner in sighting.corners_px for part in corner] for sighting in seen]
    assert [one["corners_px"] for one in exported.only("/camera/sighting")] == corners


def test_log_says_the_reasons_when_they_change(exported, all_ticks):
    log = dict(exported.messages["/log"])
    said = None
    for tick in all_ticks:
        said = log.get(tick.inputs.t_ns, said)
        codes = [reason.code for reason in tick.verdict.reasons]
        if tick.inputs.t_ns in log:
            assert said["message"] == ("HOLD: " + "; ".join(texts(tick.verdict.reasons)) if codes else "FIRE")
            assert said["level"] == (3 if codes and tick.memory.request_t_ns else 2)
            written = codes
        assert codes == written
    assert len({message["message"] for message in log.values()}) > 10
    assert [one["message"] for one in log.values()].count("FIRE") == 2


def test_images_are_those_of_the_session(exported, plain):
    pictures = sorted(load_pictures(plain), key=lambda picture: picture.t_ns)
    assert [t_ns for t_ns, _ in exported.messages["/camera/image"]] == [picture.t_ns for picture in pictures]
    for message, picture in zip(exported.only("/camera/image"), pictures, strict=True):
        seen = cv2.imdecode(np.frombuffer(base64.b64decode(message["data"]), np.uint8), cv2.IMREAD_COLOR)
        assert message["format"] == "png" and np.array_equal(seen, load_image(plain, picture).image)
        assert message["timestamp"] == {"sec": picture.t_ns // 10**9, "nsec": picture.t_ns % 10**9}


def test_a_missing_image_is_counted_and_without_a_belief_no_flight_drawn(plain, tmp_path, capsys):
    session = shutil.copytree(plain, tmp_path / "s")
    (session / "frames" / load_pictures(session)[0].file).unlink()
    found = Exported(export(session, tmp_path / "s.mcap"))
    assert len(found.messages["/camera/image"]) == 1 and "1 images are named but missing" in capsys.readouterr().err
    assert [entity["id"] for update in found.only("/scene") for entity in update["entities"]] == ["target"]
    assert found.metadata["flights"].startswith("none")


def test_the_foxglove_layout_shows_topics_that_are_there(exported):
    shown = set(re.findall(r'"(/[a-z_/0-9]+)', (DASHBOARDS / "foxglove.json").read_text(encoding="utf-8")))
    assert len(shown) > 8 and shown <= set(exported.schemas)


def test_the_pose_stands_before_the_target_and_turns_as_the_bearing(exported, all_ticks):
    poses = dict(exported.messages["/pose"])
    assert len(poses) > 10
    pose = None
    for tick in all_ticks:
        pose = poses.get(tick.inputs.t_ns, pose)
        if tick.estimate.distance_m is not None:
            place, turn = pose["pose"]["position"], pose["pose"]["orientation"]
            yaw = 2.0 * math.atan2(turn["z"], turn["w"])
            forward = np.array([math.cos(yaw), math.sin(yaw)])
            to_target = -np.array([place["x"], place["y"]])
            right = math.degrees(math.atan2(-(forward[0] * to_target[1] - forward[1] * to_target[0]),
                                            forward @ to_target))
            assert np.hypot(*to_target) == tick.estimate.distance_m and place["z"] == 0.0
            assert right == pytest.approx(tick.memory.last_sighting.bearing_deg, abs=1e-9)
    for one, other in zip(exported.only("/pose"), exported.only("/tf"), strict=True):
        assert (one["pose"]["position"], one["pose"]["orientation"]) == (other["translation"], other["rotation"])
        assert (other["parent_frame_id"], other["child_frame_id"]) == (one["frame_id"], "robot")
    assert "Assumed" in exported.metadata["pose"]


def test_flights_are_the_beliefs_forecast(exported, plain, belief):
    entities = {entity["id"]: entity for update in exported.only("/scene") for entity in update["entities"]}
    assert set(entities) == {"target", "shot 0", "shot 1"}
    dataset = ta.shots_from_sessions([plain], "plain")
    forecast = ta.predict(dataset, ta.load_belief(belief)).rows
    for trial, row in zip(load_trials(plain), forecast, strict=True):
        entity = entities[f"shot {trial.outcome.trial}"]
        points = np.array([[point[axis] for axis in "xyz"] for point in entity["lines"][0]["points"]])
        assert points[0] == pytest.approx([trial.shot.distance_m, 0.0, dataset.rig.launcher.release_height_m])
        assert points[-1, 0] == pytest.approx(0.0, abs=1e-9) and points[-1, 2] == pytest.approx(row[1], abs=1e-3)
        assert points[-1, 1] < -0.001 and len(points) > 20       # wind to the robot's left: away from y
        assert {pair["key"]: pair["value"] for pair in entity["metadata"]}["mark"] == trial.outcome.outcome
        assert trial.outcome.outcome in entity["texts"][0]["text"]
    assert "not measured" in exported.metadata["flights"] and exported.attachments["belief.toml"] == belief.read_bytes()


def test_what_an_export_needs_is_named_where_it_is_not_installed(plain, belief, tmp_path, capsys):
    assert main(["session", "convert", str(plain), "--to", "csv", "-o", str(tmp_path / "x.csv"), "--belief",
                 str(belief)]) == 2
    assert "--belief: applies with --to mcap only" in capsys.readouterr().err
    for lacks, to, more, code in (("jax", "mcap", ["--belief", str(belief)], 2), ("jax", "mcap", [], 0),
                                  ("pyarrow", "parquet", [], 2)):
        program = (f"import sys; sys.modules[{lacks!r}] = None\nfrom truearc.cli.main import main\n"
                   "sys.exit(main(sys.argv[1:]))")
        words = ["session", "convert", str(plain), "--to", to, "-o", str(tmp_path / f"x.{to}"), "--quiet", *more]
        done = subprocess.run([sys.executable, "-c", program, *words], capture_output=True, text=True)
        assert done.returncode == code and ("truearc[sim]" in done.stderr) == (code == 2)
        assert "Traceback" not in done.stderr


def test_what_made_the_session_is_attached(exported, gated, plain, tmp_path):
    assert set(exported.attachments) == {"session.json", "config.json", "belief.toml"}
    session = shutil.copytree(gated, tmp_path / "s")
    (session / "aims").mkdir()
    (session / "aims" / "a1.json").write_text("{}", encoding="utf-8")
    found = Exported(export(session, tmp_path / "s.mcap"))
    assert set(found.attachments) == {"session.json", "config.json", "model.onnx", "aims/a1.json"}
    for name, data in found.attachments.items():
        assert data == (session / name).read_bytes()


OFFSET_NS = 1_770_000_000_123_456_789


@pytest.mark.parametrize(("header", "first_ns", "how"), [
    ({"wall_offset_ns": OFFSET_NS, "started": "2026-02-02T02:40:00+00:00"}, None, "at the start of the session"),
    ({"started": None}, 5_000_000, "emulated")])
def test_times_are_the_wall_clocks(plain, all_ticks, tmp_path, header, first_ns, how):
    session = shutil.copytree(plain, tmp_path / "s")
    said = json.loads((session / "session.json").read_text())
    (session / "session.json").write_text(json.dumps(said | header))
    found = Exported(export(session, tmp_path / "s.mcap"))
    offset_ns = OFFSET_NS if first_ns is None else first_ns - all_ticks[0].inputs.t_ns
    for topic in ("/tick", "/estimate"):
        assert [t_ns for t_ns, _ in found.messages[topic]] == [tick.inputs.t_ns + offset_ns for tick in all_ticks]
    for topic in ("/log", "/pose", "/camera/image"):
        assert all(message["timestamp"] == {"sec": t_ns // 10**9, "nsec": t_ns % 10**9}
                   for t_ns, message in found.messages[topic])
    marks = [trial.outcome.t_ns + offset_ns for trial in load_trials(plain)]
    assert [t_ns for t_ns, _ in found.messages["/trial"]] == marks and how in found.metadata["time"]


def test_a_session_replays_from_the_exported_file(plain, path, tmp_path):
    session = shutil.copytree(plain, tmp_path / "s")
    shutil.copy(path, session / "telemetry.mcap")
    assert [data for _, data in TickReader(session)] == [data for _, data in TickReader(plain)]
    assert main(["session", "replay", str(session), "--check"]) == 0


TYPES = {"number": {FieldDescriptor.TYPE_DOUBLE}, "boolean": {FieldDescriptor.TYPE_BOOL},
         "integer": {FieldDescriptor.TYPE_ENUM, FieldDescriptor.TYPE_FIXED32},
         "object": {FieldDescriptor.TYPE_MESSAGE}}
TIMES = {"google.protobuf.Timestamp": "time", "google.protobuf.Duration": "duration"}


def check_official(schema, official):
    """Every required field of the official message, of its type and nothing else; lists that stay empty excepted."""
    if official.full_name in TIMES:
        assert schema["title"] == TIMES[official.full_name] and set(schema["properties"]) == {"sec", "nsec"}
        return
    assert schema["title"] == official.full_name
    fields = {field.name: field for field in official.fields if field.name not in ("message_id", "lineage")}
    assert set(schema["properties"]) == set(schema["required"]) == set(fields)
    for name, field in fields.items():
        ours = schema["properties"][name]
        assert (ours["type"] == "array") == field.is_repeated
        inner = ours["items"] if field.is_repeated else ours
        if inner["type"] == "string":
            binary = inner.get("contentEncoding") == "base64"
            assert field.type == (FieldDescriptor.TYPE_BYTES if binary else FieldDescriptor.TYPE_STRING)
            continue
        assert field.type in TYPES[inner["type"]]
        if inner["type"] == "object" and inner["properties"]:
            check_official(inner, field.message_type)
        elif inner["type"] == "object":
            assert "empty" in ours["description"]


@pytest.mark.parametrize("name", SCHEMAS)
def test_drawn_topics_have_the_official_schemas(name):
    kind = name.removeprefix("foxglove.")
    module = importlib.import_module(f"foxglove_schemas_protobuf.{kind}_pb2")
    check_official(SCHEMAS[name], getattr(module, kind).DESCRIPTOR)

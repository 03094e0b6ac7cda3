"""launcher.toml is strict: what is wrong is named with its file, line and key, and each number has its limits."""

import hashlib
import json
import math
import os
import pickle
import re
import tomllib
from collections.abc import Iterator
from copy import deepcopy
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import msgspec
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from msgspec.structs import replace

from truearc.cli.common import CAMERAS, SHIPPED, load_any_rig, load_camera
from truearc.cli.vision_images import load_image
from truearc.errors import InputError, unknown_keys
from truearc.robot.aim_file import load_aim
from truearc.robot.config.limits import Limit, load_limits, narrowest, numbers
from truearc.robot.config.rig_spec import TERMS, Rig
from truearc.robot.config.schema import Config, config_hash, is_hash_of, load_config, parse_toml, read_axis
from truearc.robot.doctor import load_endpoints
from truearc.robot.gate import load_gate
from truearc.robot.recording.files import make_folder, session_contents
from truearc.robot.recording.reader import TickReader
from truearc.robot.recording.session import load_header, load_session_config, load_trials, make_header
from truearc.robot.recording.upkeep import recover
from truearc.sim.data.files import load_rig
from truearc.sim.discover.finding import load_record as load_finding
from truearc.sim.paper.network import load_json
from truearc.sim.physics.catalogue import BUILT_IN
from truearc_frc.table import LIMITS as NT4_LIMITS
from truearc_frc.table import nt4_of

LIMITS = (*load_limits(), *NT4_LIMITS)

TEXT = SHIPPED.read_text(encoding="utf-8")
RIG = Path(__file__).parents[2] / "examples" / "spreadsheet" / "rig.toml"


@pytest.mark.parametrize(("old", "new", "message"), [
    ("spread = 0.06", "spred = 0.06", r"my\.toml:\d+: collect\.spred: unknown key; did you mean spread\?$"),
    ("kp = 0.03", "", r"my\.toml.*: flywheel\.pid\.kp: missing key$"),
    ("tick_hz = 200", 'tick_hz = "fast"', r"my\.toml:3: tick_hz: a whole number is expected, got the text 'fast'$"),
    ("fps = 20.0", "fps = [", r"my\.toml: .*line \d+"),
    ("mass_kg = 0.14", "", r"my\.toml.*: rig\.ball\.mass_kg: missing key"),
    ("tick_hz = 200", "tick_hz = 0", r"my\.toml:3: tick_hz: a whole number of at least 1 is expected, got 0$"),
    ("reading_age_s = 0.1", "reading_age_s = inf",
     r"my\.toml:\d+: gate\.reading_age_s: a number below .* is expected, got inf"),
    ("reading_age_s = 0.1", "reading_age_s = nan",
     r"my\.toml:\d+: gate\.reading_age_s: a number above .* is expected, got nan"),
    ('driver = "canandmag"', 'driver = "canandmug"',
     r"my\.toml:\d+: hood_encoder\.driver: 'canandmug' is not known .*; there are canandmag"),
    ("gravity_m_s2 = 9.81", 'gravity_m_s2 = "9,81"', r"a number is expected, got the text '9,81'; write 9\.81 without"),
    ("gravity_m_s2 = 9.81", "gravity_m_s2 = 9,81", r"my\.toml: .*line \d+, .*; decimals have a point, no comma"),
    ("node = 2", "nod = 2", r"axes\.flywheels\[1\]\.nod: unknown key; did you mean node\?"),
    ("steady_s = 0.1", "steady_s = 0.1\nzzz = 0.1", r"flywheel\.zzz: unknown key$")])
def test_a_mistake_is_named(old, new, message):
    assert old in TEXT
    with pytest.raises(InputError, match=message):
        parse_toml(TEXT.replace(old, new, 1), Config, "my.toml")


@pytest.mark.parametrize(("old", "new", "message"), [
    ('[axes.feeder]\ndriver = "odrive"', '[axes.feeder]\ndriver = "sprak"',
     "axes.feeder.driver: 'sprak' is not known here; there are odrive, spark, advisory"),
    ("node = 4", "node = 64", "axes.feeder.node: a whole number of at most 62 is expected, got 64"),
    ("node = 3\ndirection = 1", "node = 3\ndirection = 2", "axes.hood.direction: 2 is not known here; there are 1, -1"),
    ("[hood.pid]\nkp = 0.05", "[hood.pid]", "hood.pid.kp: missing key"),
    ('[axes.hood]\ndriver = "odrive"', '[axes.hood]\ndriver = "spark"', "axes.hood.node: unknown key")])
def test_the_line_is_that_of_the_right_table(old, new, message):
    """Many tables have a `driver`, a `node`, a `kp`."""
    assert TEXT.count(old) == 1
    text = TEXT.replace(old, new)
    if "unknown" in message:
        new += "\nnode"
    line = text[:text.index(new)].count("\n") + new.count("\n") + 1
    with pytest.raises(InputError) as error:
        parse_toml(text, Config, "my.toml")
    said, _, lacks = str(error.value).partition("; keys are missing: ")
    assert said == f"my.toml:{line}: {message}" and ("axes.hood.device" in lacks) == ("unknown" in message)


def test_the_hash_follows_what_the_file_says_not_how_it_is_written():
    config = parse_toml(TEXT, Config, "a")
    assert config_hash(parse_toml("# a comment\n" + TEXT, Config, "b")) == config_hash(config)
    assert config_hash(parse_toml(TEXT.replace("spread = 0.06", "spread = 0.13"), Config, "c")) != config_hash(config)
    config = parse_toml(TEXT, Config, "a")
    assert config_hash(pickle.loads(pickle.dumps(config))) == config_hash(config)
    again = msgspec.json.decode(msgspec.json.encode(config), type=Config, dec_hook=read_axis)
    assert config_hash(again) == config_hash(config)
    assert config_hash(replace(config, collect=replace(config.collect, prescribed=tuple([])))) == config_hash(config)
    config = parse_toml(TEXT, Config, "a")
    encoded = hashlib.sha256(msgspec.json.encode(config, order="deterministic")).hexdigest()
    assert is_hash_of(encoded, config) and is_hash_of(config_hash(config), config)
    assert not is_hash_of(encoded, replace(config, tick_hz=config.tick_hz + 1))


def test_keys_of_rig_toml_that_nobody_reads_are_listed():
    table = {"ball": {"mass_kg": 0.1, "radius_m": 0.1, "colour": "red"}, "camera": {},
             "launcher": {"wheel": [{"name": "a", "radius_m": 1, "gear": 1, "clock_deg": 0, "rim": 2}]}}
    assert unknown_keys(table, Rig) == ["ball.colour", "camera", "launcher.wheel.rim"]


@pytest.mark.parametrize(("old", "new", "said"), [
    ("mass_kg = 0.14", "mass_kg = nan", "rig.ball.mass_kg: nan is not finite; measure it and write the number"),
    ("mass_kg = 0.14", "mass_kg = -0.14", "rig.ball.mass_kg: -0.14 must be above 0"),
    ("mass_kg = 0.14", "mass_kg = 0.14\nmass_g = 140.0", "rig.ball.mass_g: unknown key; did you mean mass_kg?"),
    ("mass_kg = 0.14", "mass_kg = 1e-9", "rig.ball.mass_kg: 1e-09 is out of range (0.0001 to 1000 in size); look at "
     "its unit"),
    ("radius_m = 0.0889", "radius_m = 0.45", "rig.ball.radius_m: 0.14 kg in a ball of 0.45 m radius is lighter than "
     "air; look at the units"),
    ("radius_m = 0.0508", "radius_m = 1e-7", "rig.launcher.wheel.radius_m: 1e-07 is out of range (0.005 to inf in "
     "size); look at its unit"),
    ("clock_deg = 180", "clock_deg = nan", "rig.launcher.wheel.clock_deg: nan is not finite; measure it and write the "
     "number"),
    ("free_speed_rad_s = 594.0", "", "rig.launcher.free_speed_rad_s: missing key; the motors' speed without load, "
     "where motor_ratio is 1"),
    ("low_deg = 15.0", "low_deg = 0.26", "hood.low_deg: 0.26 degrees are hardly a limit; if radians, write 14.9; if "
     "turns, 93.6"),
    ("high_deg = 75.0", "high_deg = 1.31", "hood.high_deg: 1.31 degrees are hardly a limit; if radians, write 75.1; if "
     "turns, 472"),
    ("free_speed_rad_s = 594.0", "free_speed_rad_s = 5672.0", "rig.launcher.free_speed_rad_s: 5672 is out of "
     "range (50 to 3000); no motor is so slow or so fast; this may be rev/min"),
    ("radius_m = 0.0889", "radius_m = 88.9", "rig.ball.radius_m: 88.9 is more than any launcher's 0.5; this looks like "
     "millimetres"),
    ("radius_m = 0.0889", "radius_m = 8.89", "rig.ball.radius_m: 8.89 is more than any launcher's 0.5; this looks like "
     "centimetres or inches"),
    ("mass_kg = 0.14", "mass_kg = 140", "rig.ball.mass_kg: 140 kg in a ball of 0.0889 m radius is denser than "
     "any metal; are these grams?"),
    ("centre_height_m = 2.44", "centre_height_m = -2.0", "rig.target.centre_height_m: -2 must be above 0, the floor"),
    ("gravity_m_s2 = 9.81", "gravity_m_s2 = 0", "rig.world.gravity_m_s2: 0.0 must be above 0; it is a size "
     "and points down: write 9.81"),
    ('policy = "collect"', 'policy = "colect"', "gate.policy: 'colect' is not known here; there are collect, model"),
    ("included_deg = 30.0", "included_deg = 130.0", "hood.included_deg: from low_deg to high_deg the angle motor, "
     "pivot, nut goes from 145 to 205 degrees; it stays between 5 and 175, since a screw in line with the "
     "pivot has no lever"),
    ("node = 4", "node = 2", "axes.feeder.node: 2 is that of axes.flywheels[1], too; each motor has its own")])
def test_a_rig_or_limit_that_cannot_be_is_refused(tmp_path, old, new, said):
    assert TEXT.count(old) >= 1
    path = tmp_path / "mine.toml"
    path.write_text(TEXT.replace(old, new, 1))
    with pytest.raises(InputError) as error:
        load_config(path)
    place, _, what = str(error.value).partition(": ")
    assert what == said and re.fullmatch(rf"{re.escape(str(path))}(:\d+)?", place)
    key = said.partition(":")[0].rpartition(".")[2]
    if place != str(path):            # no line of [[rig.launcher.wheel]], of which there are two
        assert path.read_text().splitlines()[int(place.rpartition(":")[2]) - 1].startswith((key, "[rig.launcher]"))
    else:
        assert "wheel" in said or "missing key" in said


def test_pitches_like_radians_and_near_terms_are_warned_of(tmp_path, capsys):
    for name, shipped, load in (("launcher", SHIPPED, load_config), ("camera", CAMERAS / "lifecam_hd3000_480p.toml",
                                                                     lambda path: load_camera(str(path)))):
        path, text = tmp_path / f"{name}.toml", shipped.read_text(encoding="utf-8")
        for pitch in ("0.35", "0.0", "-3"):
            path.write_text(re.sub(r"(?m)^pitch_deg = \S+", f"pitch_deg = {pitch}", text))
            load(path)
        said = capsys.readouterr().err
        assert said == f"warning: {path}: camera.pitch_deg: 0.35 is nearly level; if radians, write 20.1\n"
    (tmp_path / "my.toml").write_text(TEXT.replace('"drag", "magnus"', '"drga", "sorcery"'))
    load_config(tmp_path / "my.toml")
    said = capsys.readouterr().err
    assert "my.toml: rig.believe.terms: 'drga' is none of truearc's terms; did you mean drag?" in said
    assert "sorcery" not in said and sorted(TERMS) == sorted(BUILT_IN.names)
    for name, shipped, load in (("my.toml", SHIPPED, load_config), ("rig.toml", RIG, load_rig)):
        (tmp_path / name).write_text(shipped.read_text(encoding="utf-8"), encoding="utf-8-sig")
        load(tmp_path / name)


def test_files_without_an_end_and_values_without_a_bottom_are_refused(tmp_path):
    path = tmp_path / "deep.toml"
    path.write_text("a = " + "[" * 15_000)
    with pytest.raises(InputError, match=r"deep\.toml: its values are nested too deeply"):
        load_config(path)
    for text, said in (("a = " + "9" * 10_000, "Exceeds the limit"), ("a." * 100_000 + "b = 1", "has a line of")):
        path.write_text(text)
        with pytest.raises(InputError, match=rf"deep\.toml: {said}"):
            load_config(path)
    pipe = tmp_path / "pipe.toml"
    os.mkfifo(pipe)
    for load in (load_config, load_gate, load_json, load_any_rig, load_rig, load_image):
        with pytest.raises(InputError, match=r"/dev/zero: is a pipe or a device, not a file"):
            load(Path("/dev/zero"))
        with pytest.raises(InputError, match=r"pipe\.toml: is a pipe or a device, not a file; copy what it gives"):
            load(pipe)
    path = tmp_path / "deep.json"
    for text, load in ((DEEP, load_endpoints), (DEEP, load_json), (DEEP, load_aim), (DEEP, load_finding),
                       (DEEP, lambda path: load_header(path.parent)), (f'{{"endpoints": {DEEP}', load_endpoints),
                       (f'{{"schema": {DEEP}', lambda path: load_header(path.parent))):
        path.write_text(text)
        (tmp_path / "session.json").write_text(text)
        with pytest.raises(InputError, match=r"(deep|session)\.json"):
            load(path)


DEEP = "[" * 100_000


@pytest.mark.parametrize("name", ["session.json", "config.json", "trials.jsonl", "telemetry.mcap", "can0.log"])
def test_a_session_of_a_device_or_a_pipe_is_refused(tmp_path, name):
    config = parse_toml(TEXT, Config, "a")
    make_folder(tmp_path / "s", session_contents(make_header(config, None, None), config))
    (tmp_path / "s" / name).unlink(missing_ok=True)
    os.mkfifo(tmp_path / "pipe")
    (tmp_path / "s" / name).symlink_to("/dev/zero" if name != "telemetry.mcap" else tmp_path / "pipe")
    with pytest.raises(InputError, match=rf"{re.escape(name)}: is a pipe or a device, not a file"):
        recover(tmp_path / "s")
    if name != "can0.log":
        with pytest.raises(InputError, match=rf"{re.escape(name)}: is a pipe or a device, not a file"):
            (load_trials(tmp_path / "s"), load_session_config(tmp_path / "s"), list(TickReader(tmp_path / "s")))


@pytest.mark.parametrize("wheel_m", [0.005, 1.0])
@pytest.mark.parametrize("ball", [(0.0459, 0.02135), (0.0027, 0.02), (7.26, 0.06), (0.62, 0.12)],
                         ids=["golf", "table tennis", "shot put", "basketball"])
def test_balls_and_wheels_that_there_are_pass(ball, wheel_m, tmp_path):
    text = TEXT.replace("mass_kg = 0.14", f"mass_kg = {ball[0]}").replace("radius_m = 0.0889", f"radius_m = {ball[1]}")
    (tmp_path / "my.toml").write_text(text.replace("radius_m = 0.0508", f"radius_m = {wheel_m}"))
    assert load_config(tmp_path / "my.toml").rig.ball.radius_m == ball[1]


# what the shipped file leaves out
ABSENT: dict[str, Any] = {
    "aim": {"policy": "plan", "correction_step": 0.005}, "recording": {"keep_gb": 8.0, "keep_days": 120.0},
    "nt4": {"server": "2541", "velocity": {"key": "/Speeds", "most_m_s": 2.0, "pointing_deg": 2.0, "delay_s": 0.1}}}
SPARK: dict[str, Any] = {"driver": "spark", "direction": 1, "has_endstop": True, "stall_torque_nm": 2.6,
                         "free_speed_rad_s": 594.0, "rated_v": 12.0, "torque_nm_a": 0.02}
IDENTITIES = {"device", "node", "endstop_endpoint", "direction"}
MOVING = {"tick_hz", "axes", "hood_encoder", "flywheel", "hood", "feeder", "gate", "collect", "aim", "identify",
          "rig", "recording", "nt4"}
# facts of the rig by which it aims, each with its range in docs/reference/dataset.md: none moves or times anything
FACTS = re.compile(r"rig\.(ball|target|air|world|noise)\..*|rig\.launcher\.(release_height_m|wheel\.clock_deg)")
PATHS = re.compile(r"[a-z_][\w]*(?:\.\w+)*")


def make_tables(are_sparks: bool) -> dict[str, Any]:
    """The shipped configuration with all that it leaves out, and with other devices on demand."""
    tables = tomllib.loads(SHIPPED.read_text(encoding="utf-8")) | deepcopy(ABSENT)
    tables["camera"] |= {"exposure_s": 0.003, "readout_s": 0.03}
    tables["axes"]["feeder"]["torque_nm_a"] = 0.02
    if are_sparks:
        axes = [SPARK | {"device": number} for number in range(1, 6)]
        tables["axes"] = {"flywheels": axes[:2], "hood": axes[2], "feeder": axes[3]}
        tables["hood_encoder"] = {"driver": "motor", "gear": 1.0, "zero_deg": 40.0, "controller": axes[4]}
    return tables


BASES = [make_tables(are_sparks) for are_sparks in (False, True)]


def leaves(table: Any, key: str = "") -> Iterator[str]:
    """Dotted keys of numbers; those of a list's tables without an index."""
    if isinstance(table, dict):
        for name, value in table.items():
            yield from leaves(value, f"{key}.{name}".lstrip("."))
    elif isinstance(table, list):
        for value in table:
            yield from leaves(value, key)
    elif isinstance(table, int | float) and not isinstance(table, bool):
        yield key


def with_value(tables: dict[str, Any], key: str, value: float) -> dict[str, Any]:
    changed = deepcopy(tables)
    *above, name = key.split(".")
    inner: Any = changed
    for part in above:
        inner = inner[part][-1] if isinstance(inner[part], list) else inner[part]
    inner[name] = [value, *inner[name][1:]] if isinstance(inner[name], list) else value
    return changed


def toml_lines(table: dict[str, Any], header: str = "") -> list[str]:
    plain = [f"{name} = {json.dumps(value)}" for name, value in table.items() if not _has_tables(value)]
    lines = [header, *plain]
    above = header.strip("[]") + "." if header else ""
    for name, value in table.items():
        if isinstance(value, dict):
            lines += toml_lines(value, f"[{above}{name}]")
        elif _has_tables(value):
            lines += [line for row in value for line in toml_lines(row, f"[[{above}{name}]]")]
    return lines


def _has_tables(value: Any) -> bool:
    return isinstance(value, dict) or (isinstance(value, list) and isinstance(value[0], dict))


def refusal(tables: dict[str, Any], path: Path) -> tuple[str, str, str]:
    """(line of the file that is named, key, what is said) of a refused configuration; all "" of an accepted one."""
    lines = toml_lines(tables)
    path.write_text("\n".join(lines), encoding="utf-8")
    try:
        load_config(path)
    except InputError as error:
        found = re.fullmatch(rf"{re.escape(str(path))}(?::(\d+))?: ([\w.\[\]]+): (.*)", str(error))
        assert found, error
        return lines[int(found[1]) - 1] if found[1] else "", found[2], found[3]
    return "", "", ""


@pytest.fixture(scope="module")
def place(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("limits") / "launcher.toml"


@pytest.fixture(scope="module")
def configs(place: Path) -> list[Any]:
    loaded = []
    for tables in BASES:
        assert refusal(tables, place) == ("", "", "")
        config = load_config(place)
        loaded.append(SimpleNamespace(**{name: getattr(config, name) for name in config.__struct_fields__},
                                      nt4=nt4_of(config)))
    return loaded


def limits_of(limit: Limit, configs: list[Any]) -> tuple[dict[str, Any], bool, tuple[float, str], tuple[float, str]]:
    """A configuration that has the key, whether it counts, and its least and greatest value with their texts."""
    tables, config = next((base, one) for base, one in zip(BASES, configs, strict=True) if any(numbers(one, limit.key)))
    whole = isinstance(next(numbers(config, limit.key))[1], int)
    return tables, whole, narrowest(limit.low, config, max), narrowest(limit.high, config, min)


def outside(low: float, high: float, whole: bool) -> st.SearchStrategy[float]:
    """Beyond either bound, by a hair or by a million times."""
    far = st.one_of(st.floats(1e-6, 1.0), st.floats(1.0, 1e6))
    if whole:
        return st.one_of(st.integers(1, 1000).map(lambda by: math.ceil(low) - by),
                         st.integers(1, 100_000).map(lambda by: math.floor(high) + by))
    return st.one_of(far.map(lambda by: low - by * (abs(low) or 1.0)),
                     far.map(lambda by: high + by * (abs(high) or 1.0)))


@pytest.mark.parametrize("limit", LIMITS, ids=lambda limit: limit.key)
@settings(max_examples=6, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(data=st.data())
def test_outside_its_limits_a_number_is_refused(limit, data, place, configs):
    tables, whole, (low, low_text), (high, high_text) = limits_of(limit, configs)
    value = data.draw(outside(low, high, whole).filter(lambda value: value != 0.0 or not limit.or_zero))
    line, key, said = refusal(with_value(tables, limit.key, value), place)
    assert re.sub(r"\[\d\]", "", key) == limit.key
    assert line.startswith(f"{limit.key.rpartition('.')[2]} = ") or re.search(r"flywheels|\.wheel\.", key)  # of two
    by_kind = re.fullmatch(r"a (?:whole )?number .* is expected, got (.*)|(\S+) must be above 0", said)
    if by_kind:                       # what the struct already forbids
        assert float(by_kind[1] or by_kind[2]) == pytest.approx(value)
    elif "hardly a limit" not in said and not said.endswith("look at its unit"):     # a more special, a wider range
        assert said == (f"{value:g} is out of range ({'0, or ' * limit.or_zero}{low_text} to {high_text}); "
                        f"{limit.why}")


@pytest.mark.parametrize("limit", LIMITS, ids=lambda limit: limit.key)
@settings(max_examples=4, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(share=st.floats(0.0, 1.0))
def test_inside_its_limits_a_number_is_accepted(limit: Limit, share: float, place: Path, configs: list[Any]) -> None:
    """Unless another number, whose bound names it, is outside its own then."""
    tables, whole, (low, _), (high, _) = limits_of(limit, configs)
    value = low + share * (high - low)
    _, key, said = refusal(with_value(tables, limit.key, round(value) if whole else value), place)
    key = re.sub(r"\[\d\]", "", key)
    named = {one.key for one in LIMITS if limit.key in keys_in(one)}
    assert not key or key in named or "hardly a limit" in said or "motor, pivot, nut" in said, (key, said)


def keys_in(limit: Limit) -> set[str]:
    bounds = [bound for side in (limit.low, limit.high) for bound in (side if isinstance(side, tuple) else (side,))]
    return {key for bound in bounds if isinstance(bound, str) for key in PATHS.findall(bound)}


@pytest.mark.parametrize(("key", "value", "said"), [
    ("flywheel.pid.kp", 1000.0, "1000 is out of range (0 to 1.2 = flywheel.pid.output_high); above, full torque"),
    ("hood.homing_torque_nm", -10.0, "-10 is out of range (-0.15 = 0.5 * hood.pid.output_low to -0.02 = -1 * "
     "hood.friction_nm); below, the hood meets its stop too hard"),
    ("flywheel.pid.output_high", 100.0, "100 is out of range (0.01 to 10); below, nothing turns; above, the motor"),
    ("gate.reading_age_s", 10.0, "10 is out of range (0.01 = 2 / tick_hz to 0.15)"),
    ("flywheel.steady_s", 0.0, "0 is out of range (0.01 = 2 / tick_hz to 2)"),
    ("gate.threshold", 0.0, "0 is out of range (0.01 to 0.99); below, the model never prevents a shot"),
    ("axes.feeder.torque_nm_a", 2e-5, "2e-05 is out of range (0, or 0.002 to 10); no motor of a robot gives so little"),
    ("rig.launcher.wheel.gear", 1e-3, "0.001 is out of range (0, or 0.05 to 20); no gear is so large or so small"),
    ("feeder.torque_nm", 50.0, "50 is out of range (0.005 to 10)"),
    ("feeder.clear_s", 0.2, "0.2 is out of range (0.25 = feeder.feed_s to 10); below, two balls are fed")])
def test_what_was_accepted_once(key: str, value: float, said: str, place: Path) -> None:
    _, named, what = refusal(with_value(BASES[0], key, value), place)
    assert re.sub(r"\[\d\]", "", named) == key and what.startswith(said)


@pytest.mark.parametrize("key", [limit.key for limit in LIMITS if limit.or_zero])
def test_zero_is_permitted_where_it_means_none(key: str, place: Path) -> None:
    assert refusal(with_value(BASES[0], key, 0.0), place) == ("", "", "")


def test_a_hood_of_which_nothing_says_that_it_holds_itself_is_refused(place: Path) -> None:
    tables = make_tables(False)
    for hood in ({**tables["hood"], "holds_itself": False},
                 {key: value for key, value in tables["hood"].items() if key != "holds_itself"}):
        _, key, said = refusal({**tables, "hood": hood}, place)
        assert key == "hood.holds_itself" and said.startswith("missing key, or not true; a hood that sinks")


def test_torque_inertia_and_one_master_bound_what_is_asked(place: Path) -> None:
    for key, value in (("flywheel.pid.output_high", 2.7), ("hood.pid.output_low", -2.7), ("feeder.torque_nm", 2.7)):
        tables = with_value(BASES[1], "hood.screw_lead_m", 0.02)
        _, named, said = refusal(with_value(tables, key, value), place)
        assert named == key and "axes." in said and "stall_torque_nm" in said
    assert refusal(with_value(BASES[0], "flywheel.pid.kp", 0.5), place)[1] == ""
    known = with_value(BASES[0], "flywheel.ka_nm_s2", 1.3e-3)
    _, key, said = refusal(with_value(known, "flywheel.pid.kp", 0.5), place)
    assert key == "flywheel.pid.kp" and "0.26 = flywheel.ka_nm_s2 * tick_hz" in said
    tables = make_tables(False)
    theirs = {"driver": "advisory", "listens_to": "odrive", "device": 1, "direction": 1, "has_endstop": False}
    tables["axes"]["flywheels"] = [theirs, tables["axes"]["flywheels"][1]]
    _, key, said = refusal(tables, place)
    assert key == "axes.flywheels" and "advisory" in said and "one master" in said


def test_every_number_that_moves_or_times_something_has_a_row() -> None:
    keys = {key for tables in BASES for key in leaves(tables) if key.partition(".")[0] in MOVING}
    own = {limit.key for limit in LIMITS}
    assert {key for key in keys - own if key.rpartition(".")[2] not in IDENTITIES and not FACTS.fullmatch(key)} <= {
        f"hood_encoder.controller.{name}" for name in SPARK}       # a motor of which only the position is read
    assert len(own) == len(LIMITS)

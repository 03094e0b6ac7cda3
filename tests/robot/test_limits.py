"""Every number of launcher.toml that moves or times something has limits, and is refused outside them."""

import json
import math
import re
import tomllib
from collections.abc import Iterator
from copy import deepcopy
from pathlib import Path
from typing import Any

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from truearc.cli.common import SHIPPED
from truearc.errors import InputError
from truearc.robot.config.limits import Limit, load_limits, narrowest, numbers
from truearc.robot.config.schema import load_config

LIMITS = load_limits()

# what the shipped file leaves out
ABSENT: dict[str, Any] = {"aim": {"policy": "plan", "correction_step": 0.005}}
SPARK: dict[str, Any] = {"driver": "spark", "direction": 1, "has_endstop": True, "stall_torque_nm": 2.6,
                         "free_speed_rad_s": 594.0, "rated_v": 12.0}
IDENTITIES = {"device", "node", "endstop_endpoint", "direction"}
MOVING = {"tick_hz", "axes", "hood_encoder", "flywheel", "hood", "feeder", "gate", "collect", "aim", "identify"}
PATHS = re.compile(r"[a-z_][\w]*(?:\.\w+)*")


def make_tables(are_sparks: bool) -> dict[str, Any]:
    """The shipped configuration with all that it leaves out, and with other devices on demand."""
    tables = tomllib.loads(SHIPPED.read_text(encoding="utf-8")) | deepcopy(ABSENT)
    tables["camera"] |= {"exposure_s": 0.003, "readout_s": 0.03}
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
        loaded.append(load_config(place))
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
def test_outside_its_limits_a_number_is_refused(limit: Limit, data: st.DataObject, place: Path,
                                                configs: list[Any]) -> None:
    tables, whole, (low, low_text), (high, high_text) = limits_of(limit, configs)
    value = data.draw(outside(low, high, whole))
    line, key, said = refusal(with_value(tables, limit.key, value), place)
    assert re.sub(r"\[\d\]", "", key) == limit.key
    assert line.startswith(f"{limit.key.rpartition('.')[2]} = ") or "flywheels" in key    # of two tables none
    by_kind = re.fullmatch(r"a (?:whole )?number .* is expected, got (.*)|(\S+) must be above 0", said)
    if by_kind:                       # what the struct already forbids
        assert float(by_kind[1] or by_kind[2]) == pytest.approx(value)
    elif "hardly a limit" not in said:                # a more special word for an angle that looks like radians
        assert said == f"{value:g} is out of range ({low_text} to {high_text}); {limit.why}"


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
    ("flywheel.pid.kp", 1000.0, "1000 is out of range (0 to 1.2 = flywheel.pid.output_high); above, all torque"),
    ("hood.homing_torque_nm", -10.0, "-10 is out of range (-0.15 = 0.5 * hood.pid.output_low to -0.02 = -1 * "
     "hood.friction_nm); below, the hood meets its stop too hard"),
    ("flywheel.pid.output_high", 100.0, "100 is out of range (0.01 to 10); below, nothing turns; above, the motor"),
    ("gate.reading_age_s", 10.0, "10 is out of range (0.01 = 2 / tick_hz to 1)"),
    ("flywheel.steady_s", 0.0, "0 is out of range (0.01 = 2 / tick_hz to 2)"),
    ("gate.threshold", 0.0, "0 is out of range (0.01 to 0.99); below, the model cannot say no"),
    ("feeder.torque_nm", 50.0, "50 is out of range (0.005 to 10)"),
    ("feeder.clear_s", 0.2, "0.2 is out of range (0.25 = feeder.feed_s to 10); below, two balls are fed"),
])
def test_what_was_accepted_once(key: str, value: float, said: str, place: Path) -> None:
    _, named, what = refusal(with_value(BASES[0], key, value), place)
    assert named == key and what.startswith(said)


def test_a_motor_that_states_its_torque_bounds_what_is_asked_of_it(place: Path) -> None:
    for key, value in (("flywheel.pid.output_high", 2.7), ("hood.pid.output_low", -2.7), ("feeder.torque_nm", 2.7)):
        tables = with_value(BASES[1], "hood.screw_lead_m", 0.02)
        _, named, said = refusal(with_value(tables, key, value), place)
        assert named == key and "axes." in said and "stall_torque_nm" in said


def test_a_known_inertia_bounds_the_gain_and_an_unknown_one_does_not(place: Path) -> None:
    assert refusal(with_value(BASES[0], "flywheel.pid.kp", 0.5), place)[1] == ""
    known = with_value(BASES[0], "flywheel.ka_nm_s2", 1.3e-3)
    _, key, said = refusal(with_value(known, "flywheel.pid.kp", 0.5), place)
    assert key == "flywheel.pid.kp" and "0.26 = flywheel.ka_nm_s2 * tick_hz" in said


def test_every_number_that_moves_or_times_something_has_a_row() -> None:
    keys = {key for tables in BASES for key in leaves(tables) if key.partition(".")[0] in MOVING}
    own = {limit.key for limit in LIMITS}
    assert {key for key in keys - own if key.rpartition(".")[2] not in IDENTITIES} <= {
        f"hood_encoder.controller.{name}" for name in SPARK}       # a motor of which only the position is read
    assert len(own) == len(LIMITS)


def test_bounds_name_only_rows_above_and_keys_that_there_are() -> None:
    rows = [limit.key for limit in LIMITS]
    known = {key for tables in BASES for key in leaves(tables)}
    for limit in LIMITS:
        for key in keys_in(limit):
            assert key in known and (key not in rows or rows.index(key) < rows.index(limit.key)), (limit.key, key)


def test_wheels_of_one_belt_have_one_master(place: Path) -> None:
    tables = make_tables(False)
    theirs = {"driver": "advisory", "listens_to": "odrive", "device": 1, "direction": 1, "has_endstop": False}
    tables["axes"]["flywheels"] = [theirs, tables["axes"]["flywheels"][1]]
    _, key, said = refusal(tables, place)
    assert key == "axes.flywheels" and "advisory" in said and "one master" in said

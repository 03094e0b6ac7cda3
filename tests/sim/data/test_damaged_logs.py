"""Logs: balls that slow wheels down are found, nothing else is; damage that is read is said."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.sim.data.files import FACTS, write
from truearc.errors import InputError
from truearc.robot.config.shot_map import SCHEMA, Detection, OutcomeKeys, ShotMap, Signal
from truearc.sim.data.files import load_dataset
from truearc.sim.data.import_shots import import_shots
from truearc.sim.data.log import Series, find_dips, find_shots, read_csv_log
from truearc_frc.wpilog import WpilogWriter, make_payload, read_wpilog

LEAST = 0.01


def wheel(shots_s: list[float], rate_hz: float, depth: float, speed: float = 400.0, noise: float = 0.0,
          recovery_s: float = 0.12, seed: int = 0, end_s: float = 60.0) -> tuple[Series, Series]:
    """(speed, set point): up from rest by 2 s; a ball takes a share within 0.04 s, which comes back exponentially."""
    t_s = np.arange(0.0, end_s, 1.0 / rate_hz)
    value = speed * np.clip(t_s / 2.0, 0.0, 1.0)
    for shot_s in shots_s:
        since = t_s - shot_s
        fall = np.clip(since / 0.04, 0.0, 1.0) * np.exp(-np.clip(since - 0.04, 0.0, None) / recovery_s)
        value = value - depth * speed * fall
    value = value + np.random.default_rng(seed).normal(0.0, noise, len(t_s))
    return Series("v", t_s, value), Series("set", np.array([0.0, 0.5]), np.array([0.0, speed]))


@settings(max_examples=40)
@given(waits=st.lists(st.floats(0.35, 4.0), min_size=1, max_size=12),
       rate_hz=st.sampled_from([20.0, 50.0, 100.0, 200.0]), depth=st.floats(0.03, 0.2),
       seed=st.integers(0, 100), told=st.booleans())
def test_every_ball_is_found_once_and_just_before_it_touches(waits, rate_hz, depth, seed, told):
    shots_s = list(4.0 + np.cumsum(waits))
    speed, wanted = wheel(shots_s, rate_hz, depth, noise=0.3, seed=seed)
    found = find_dips(speed, wanted if told else None, LEAST)
    assert len(found) == len(shots_s)
    assert (np.abs(found - shots_s) <= 2.5 / rate_hz + 0.01).all()


def test_a_stream_of_balls_is_counted_before_the_wheel_has_recovered() -> None:
    shots_s = list(5.0 + 0.12 * np.arange(8))
    speed, wanted = wheel(shots_s, 200.0, 0.05, recovery_s=0.05)
    assert len(find_dips(speed, wanted, LEAST)) == 8


@pytest.mark.parametrize("told", [True, False])
def test_letting_a_wheel_run_down_and_setting_it_lower_is_no_ball(told: bool) -> None:
    t_s = np.arange(0.0, 20.0, 0.02)
    value = np.interp(t_s, [0, 2, 6, 8, 12, 20], [0, 400, 400, 280, 280, 0])
    wanted = Series("set", np.array([0.0, 0.1, 6.0, 12.0]), np.array([0.0, 400.0, 280.0, 0.0]))
    assert len(find_dips(Series("v", t_s, value), wanted if told else None, LEAST)) == 0


def test_a_wheel_that_runs_below_its_set_point_and_one_that_turns_backwards_show_balls() -> None:
    speed, wanted = wheel([5.0, 8.0], 100.0, 0.06)
    low = Series("v", speed.t_s, 0.9 * np.asarray(speed.values))
    assert len(find_dips(low, wanted, LEAST)) == 2
    back = Series("v", speed.t_s, -np.asarray(speed.values))
    assert len(find_dips(back, Series("set", wanted.t_s, -np.asarray(wanted.values)), LEAST)) == 2


def feeder(runs: list[tuple[float, float]]) -> Series:
    edges = sorted([(start, 1.0) for start, _ in runs] + [(end, 0.0) for _, end in runs])
    return Series("feed", np.array([0.0, *(at for at, _ in edges)]), np.array([0.0, *(value for _, value in edges)]))


def test_shots_are_checked_against_the_feeder() -> None:
    speed, wanted = wheel([5.0, 8.0, 12.0], 100.0, 0.06)
    found = find_shots(speed, wanted, feeder([(4.9, 5.2), (7.9, 8.1), (10.0, 10.3)]), 0.5, LEAST)
    assert found.t_s == pytest.approx([4.9, 7.9])                  # what was before anything moved
    assert any("t = 10.00 s: fed, but" in line for line in found.odd)
    assert any("t = 11.99 s: the wheels slow down" in line or "t = 12.00 s: the wheels" in line for line in found.odd)


def test_one_run_of_the_feeder_may_carry_several_balls() -> None:
    speed, wanted = wheel([5.0, 5.5, 6.0], 100.0, 0.06)
    found = find_shots(speed, wanted, feeder([(4.9, 6.1)]), 0.5, LEAST)
    assert found.t_s == pytest.approx([4.9, 5.5, 6.0], abs=0.03) and not found.odd


SHOTS_S = (2.0, 4.0, 6.0)
END_S = 9.0
MAP = ShotMap(SCHEMA, columns={"wheel_lower_rad_s": Signal("/wheel"), "distance_m": Signal("/distance"),
                               "hood_deg": Signal("/hood")}, shots=Detection(),
              outcome=OutcomeKeys(key="/result", values={"two": "two"}))


def speed_at(t_s: float) -> float:
    """From rest by 1 s, a tenth lost to each ball and regained, at rest again in the last second."""
    dip = sum(min((t_s - shot) / 0.04, 1.0) * np.exp(-max(t_s - shot - 0.04, 0.0) / 0.12)
              for shot in SHOTS_S if t_s > shot)
    return 400.0 * min(t_s, 1.0, max(END_S - 0.5 - t_s, 0.0)) * (1.0 - 0.1 * dip) + 0.01 * np.sin(1e3 * t_s)


def write_log(path: Path, speed: Callable[[float], float] = speed_at) -> Path:
    pytest.importorskip("wpiutil")
    with path.open("wb") as file:
        log = WpilogWriter(file, "")
        wheel, distance, hood, result = (log.start(name, kind, "", 0) for name, kind in (
            ("/wheel", "float"), ("/distance", "float"), ("/hood", "float"), ("/result", "text")))
        log.append(distance, 0, make_payload("float", 3.0) or b"")
        log.append(hood, 0, make_payload("float", 50.0) or b"")
        for step in range(int(END_S * 50)):
            log.append(wheel, step * 20_000, make_payload("float", speed(step * 0.02)) or b"")
            if any(abs(step * 0.02 - shot - 0.5) < 1e-6 for shot in SHOTS_S):
                log.append(result, step * 20_000, b"two")
    return path


@pytest.fixture
def log(tmp_path: Path) -> Path:
    return write_log(tmp_path / "log.wpilog")


def found(path: Path) -> tuple[int, tuple[str, ...]]:
    dataset = import_shots([path], rig=FACTS, shot_map=MAP)
    return len(dataset.shots), dataset.left_out


@pytest.mark.parametrize("share", np.linspace(0.3, 0.9, 13))
def test_a_log_that_was_cut_short_says_so(log: Path, share: float) -> None:
    """Within a record it is seen in the file; between two the wheels are still turning."""
    data = log.read_bytes()
    said = set()
    for cut in range(int(len(data) * share), int(len(data) * share) + 14):      # a record of the wheel is 13 bytes
        log.write_bytes(data[:cut])
        shots, left_out = found(log)
        ways = [way for way in ("cut short, as where power is lost; shots may be missing", "while the wheels turn")
                if any(way in line for line in left_out)]
        assert shots < 3 or share > 0.7
        assert ways
        said.add(ways[0])
    assert len(said) == 2


@pytest.mark.parametrize("shot_map", [MAP, None], ids=["map", "guess"])
def test_a_log_cut_short_before_a_signal_is_refused_with_the_cut(log: Path, shot_map: ShotMap | None) -> None:
    data = log.read_bytes()
    log.write_bytes(data[:data.index(b"/hood") + 2])
    with pytest.raises(InputError, match=r"(?s)log\.wpilog.*\nends in the record at byte .*: cut short"):
        import_shots([log], rig=FACTS, shot_map=shot_map)


@pytest.mark.parametrize("damage", [
    lambda data, at: data[:at] + bytes(len(data) - at),                              # not written before power went
    lambda data, at: data[:at] + data[at + 2000:],                                  # a part is lost
    lambda data, at: data[:at] + data[at - 1500:at] + data[at:],                       # a part stands there twice
    lambda data, at: data[:at] + b"\xff" * 60 + data[at + 60:],
    lambda data, at: data[:at] + b"\x00\x00\x05\x00\x00" + b"\xff" * 4 + data[at:],  # a start record that is none
])
def test_damage_in_the_middle_is_said(log: Path, damage: Callable[[bytes, int], bytes]) -> None:
    data = log.read_bytes()
    log.write_bytes(damage(data, len(data) * 2 // 5))
    _, left_out = found(log)
    assert any("shots may be missing" in line or "shots there may be missing" in line for line in left_out), left_out


def test_a_name_that_is_no_text_is_damage(tmp_path: Path) -> None:
    path = write_log(tmp_path / "log.wpilog")
    path.write_bytes(path.read_bytes().replace(b"/hood", b"/ho\xffd", 1))
    log = read_wpilog(path)
    assert "/wheel" in log and "/hood" not in log
    assert any(line.startswith("damaged: byte ") for line in log.damage)


def test_one_wild_sample_hides_no_shot(tmp_path: Path) -> None:
    """Shots are falls of a wheel at work, which is a share of its greatest speed."""
    path = write_log(tmp_path / "log.wpilog", lambda t_s: 5e3 if abs(t_s - 5.0) < 1e-6 else speed_at(t_s))
    assert found(path) == (3, ("log.wpilog: /wheel: samples far above both neighbours: 1",))


def test_a_part_that_was_not_logged_is_said(tmp_path: Path) -> None:
    rows = [(step * 0.02, speed_at(step * 0.02)) for step in range(int(END_S * 50))]
    path = tmp_path / "log.csv"
    path.write_text("Timestamp,/wheel,/distance,/hood,/result\n" + "".join(
        f"{t_s},{speed},3.0,50.0,\n" for t_s, speed in rows if not 3.9 < t_s < 4.3), encoding="utf-8")
    dataset = import_shots([path], rig=FACTS, shot_map=ShotMap(SCHEMA, columns=MAP.columns))
    assert len(dataset.shots) == 2
    assert any("nothing was logged for 0.4" in line and "shots there may be missing" in line
               for line in dataset.left_out)


def test_a_wild_sample_of_the_set_point_hides_neither_it_nor_a_shot(tmp_path: Path) -> None:
    """Without a map, the set point is the signal that is as large as the speed."""
    path = tmp_path / "log.csv"
    wanted = {step: 400.0 if step * 0.02 < END_S - 1.6 else 0.0 for step in range(int(END_S * 50))} | {60: 2.2e7}
    path.write_text("Timestamp,FlywheelVelocityRadPerSec,FlywheelSetpointRadPerSec,DistanceMeters,HoodDegrees\n"
                    + "".join(f"{step * 0.02:.2f},{speed_at(step * 0.02)},{point},3.0,50.0\n"
                              for step, point in wanted.items()), encoding="utf-8")
    dataset = import_shots([path], rig=FACTS)
    assert len(dataset.shots) == 3
    assert "log.csv: FlywheelSetpointRadPerSec: samples far above both neighbours: 1" in dataset.left_out


def test_rows_in_the_place_of_others_are_said(tmp_path: Path) -> None:
    path = tmp_path / "log.csv"
    times = [0.1 * k for k in range(50)]
    path.write_text("Timestamp,Key,Value\n" + "".join(f"{t_s},/wheel,{t_s}\n" for t_s in times[:30] + times[:30]),
                    encoding="utf-8")
    assert read_csv_log(path, "Timestamp", 1.0).damage == ("damaged: time goes back in 1 rows; shots may be missing",)


def test_a_table_of_one_value_that_fills_the_memory_is_refused(tmp_path: Path) -> None:
    write(tmp_path, "")
    (tmp_path / "shots.csv").unlink()
    rows = 30_000_000
    values = pa.array(["a"]).dictionary_encode()
    column = pa.DictionaryArray.from_arrays(pa.array(np.zeros(rows, np.int8)), values.dictionary)
    pq.write_table(pa.table({"shot_id": column}), tmp_path / "shots.parquet")
    assert (tmp_path / "shots.parquet").stat().st_size < 82_000
    with pytest.raises(InputError, match=r"shots\.parquet: unpacks to 30000000 cells"):
        load_dataset(tmp_path)


def test_text_of_parquet_that_is_none_is_named(tmp_path: Path) -> None:
    write(tmp_path, "")
    (tmp_path / "shots.csv").unlink()
    pq.write_table(pa.table({"shot_id": ["aaaaaaaa", "bbbbbbbb"]}), tmp_path / "shots.parquet", compression="none",
                   use_dictionary=False, write_statistics=False)
    data = (tmp_path / "shots.parquet").read_bytes()
    (tmp_path / "shots.parquet").write_bytes(data.replace(b"aaaaaaaa", b"aaaa\x80aaa"))
    with pytest.raises(InputError, match=r"shots\.parquet: not a readable Parquet file"):
        load_dataset(tmp_path)


def test_rows_above_a_header_are_not_taken_for_its_title(tmp_path: Path) -> None:
    header, *rows = ["Distance (m),Hood angle (deg),Flywheel RPM,Result"] + [
        f"{2.0 + 0.1 * k},{60 - k},{2000 + 50 * k},two" for k in range(8)]
    path = tmp_path / "shots.csv"
    path.write_text("\n".join(["Monday", header, *rows]) + "\n", encoding="utf-8")
    assert len(import_shots([path], rig=FACTS).shots) == 8
    path.write_text("\n".join(["Monday", *rows[:3], header, *rows[3:]]) + "\n", encoding="utf-8")
    with pytest.raises(InputError, match=r"shots\.csv:2: a row of numbers stands above the header, which is line 5"):
        import_shots([path], rig=FACTS)


def test_a_key_of_thousands_of_parts_is_refused_at_once(tmp_path: Path) -> None:
    """Python's own reader takes half a minute for it."""
    write(tmp_path, "", rig="[ball]\n" + "a." * 9000 + "b = 1\n")
    with pytest.raises(InputError, match=r"rig\.toml:2: a key of more than 16 parts"):
        load_dataset(tmp_path)

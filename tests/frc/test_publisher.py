"""Ticks of a launcher of ours as topics: on a real NetworkTables server, and without one."""

import time
from collections.abc import Sequence
from functools import partial
from pathlib import Path

import pytest
from msgspec.structs import replace

from tests.frc.nt_server import Table
from tests.robot.good_tick import good_inputs, good_memory
from tests.waiting import SetClock, wait_until
from truearc.cli.common import SHIPPED
from truearc.cli.main import main
from truearc.errors import InputError
from truearc.hw.protocols import Clock
from truearc.hw.real.clock import MonotonicClock
from truearc.robot.config.schema import Config, load_config
from truearc.robot.eyes import open_their_screens
from truearc.robot.runtime import open_screens
from truearc.robot.tick import step
from truearc.robot.types import Tick, Verdict
from truearc_frc.advice import NtPublisher
from truearc_frc.table import Nt4, nt4_of, with_nt4

GATE = Path(__file__).parents[1] / "golden" / "reference" / "export-physics" / "gate.onnx"
CONFIG = load_config(SHIPPED)
FIRED = step(good_inputs(), good_memory(), CONFIG, None)
HELD = replace(FIRED, verdict=Verdict(False, ()))


def published(ticks: list[Tick], clock: Clock | None = None) -> list[dict[str, float | str | Sequence[str]]]:
    table = Table()
    screen = NtPublisher(with_nt4(CONFIG, Nt4("254")), table, None, clock)
    for tick in ticks:
        screen.show(tick)
    wait_until(lambda: bool(table.said))
    screen.close()
    assert table.closed
    return table.said


def test_a_fire_is_published_even_where_later_ticks_hold() -> None:
    assert FIRED.verdict.fire
    said = published([HELD, FIRED, HELD, HELD])
    assert [one["verdict"] for one in said] == ["FIRE"] and len(said[0]) == 10


def test_the_age_is_that_at_sending() -> None:
    own, late = published([HELD])[0]["age_s"], published([HELD], SetClock(FIRED.inputs.t_ns + 250_000_000))[0]["age_s"]
    assert isinstance(own, float) and late == pytest.approx(own + 0.25)


def test_topics_reach_a_server_and_go_with_the_robot(nt_server, capsys):
    server, address = nt_server
    verdict = server.getStringTopic("/truearc/verdict").subscribe("none")
    novelty = server.getDoubleTopic("/truearc/novelty").subscribe(-1.0)
    config = with_nt4(CONFIG, Nt4(address))
    assert open_screens((partial(open_their_screens, CONFIG, None, False),), MonotonicClock()) is None
    screen = open_screens((partial(open_their_screens, config, GATE, False),), MonotonicClock())
    assert screen is not None
    try:
        seen = Tick(**{name: getattr(FIRED, name) for name in FIRED.__struct_fields__})
        seen = replace(seen, verdict=replace(FIRED.verdict, p_two=0.9, p_three=0.5))

        def shown() -> bool:
            screen.show(seen)
            return verdict.get() == "FIRE"

        wait_until(shown)
        wait_until(lambda: novelty.get() != -1.0)
        wait_until(lambda: "connected" in capsys.readouterr().err)       # its own end may know it later
    finally:
        screen.close()
    wait_until(lambda: not verdict.exists())      # a robot that has gone publishes nothing


def test_a_server_that_is_not_there_is_said_once(monkeypatch, capsys):
    monkeypatch.setattr("truearc_frc.advice.PATIENCE_S", 0.05)
    table = Table(connected=False)
    screen = NtPublisher(with_nt4(CONFIG, Nt4("254")), table, None, None)
    time.sleep(0.3)
    screen.close()
    assert capsys.readouterr().err.count("NetworkTables server 254: does not answer") == 1


def configured(path: Path, table: str) -> Config:
    path.write_text(f"{SHIPPED.read_text(encoding='utf-8')}\n[nt4]\n{table}\n", encoding="utf-8")
    return load_config(path)


CAMERA = 'server = "254"\n[nt4.vision]\nkind = "limelight"\ncamera = "limelight"\nsigma_m = 0.05'


@pytest.mark.parametrize(("table", "wrong"), [
    ('server = "robot:x"', "nt4.server"), ('server = ""', "nt4"), (CAMERA, "nt4.vision: needs .apriltag"),
    (CAMERA.replace('"limelight"\ns', '"/"\ns') + "\n[apriltag]\nids = [4]\nside_m = 0.1651\ncentre_height_m = 1.35",
     "nt4.vision.camera: is empty"),
    (CAMERA.replace("limelight", "zed", 1), "nt4.vision.kind"), (CAMERA.replace("0.05", "0"), "nt4.vision.sigma_m")])
def test_the_table_is_checked_when_the_configuration_is_read(table: str, wrong: str, tmp_path: Path) -> None:
    assert nt4_of(configured(tmp_path / "launcher.toml", 'server = "10.25.4.2"')) == Nt4("10.25.4.2")
    with pytest.raises(InputError, match=wrong):
        configured(tmp_path / "launcher.toml", table)


def test_deploy_carries_this_distribution_where_the_configuration_needs_it(tmp_path, capsys):
    launcher = tmp_path / "launcher.toml"
    for added in ("", '\n[nt4]\nserver = "254"\n'):
        launcher.write_text(SHIPPED.read_text(encoding="utf-8") + added, encoding="utf-8")
        assert main(["deploy", "pi@launcher.local", "--config", str(launcher), "--dry-run"]) == 0
        built = [line for line in capsys.readouterr().out.splitlines() if "pip wheel" in line and "/plugins" in line]
        assert [line.rpartition("/")[2] for line in built] == (["frc"] if added else [])

"""The driver with the button box, and what cannot be emulated: refused before there is a folder or a wire."""

import itertools

import pytest

from truearc.cli.common import SHIPPED
from truearc.cli.main import main
from truearc.sim.world.emulated_robot import Driver
from truearc.sim.world.options import Options
from truearc.sim.world.world import TICK_NS, Bench, World

TEXT = SHIPPED.read_text(encoding="utf-8")
SECOND = '[[axes.flywheels]]\ndriver = "odrive"\nnode = 2'
THIRD = f"{SECOND.replace('2', '7')}\ndirection = 1\nendstop_endpoint = 0\n\n"


@pytest.mark.parametrize(("old", "new", "said"), [
    (SECOND, f"{THIRD}{SECOND}", "axes.flywheels: 3 motors; the emulated robot has 2, so state as many"),
    ("node = 2", "node = 1", "axes.flywheels[1].node: 1 is that of axes.flywheels[0], too"),
])
@pytest.mark.parametrize("words", [["emulate", "--trials", "1", "--out", "s"], ["sysid", "--emulate", "--out", "s"],
                                   ["emulate", "--trials", "1", "--bus", "slcan:auto"]])
def test_axes_that_cannot_be_emulated_leave_nothing(words, old, new, said, tmp_path, monkeypatch, capsys):
    assert old in TEXT
    (tmp_path / "mine.toml").write_text(TEXT.replace(old, new, 1))
    monkeypatch.chdir(tmp_path)
    assert main([*words, "--config", "mine.toml"]) == 2
    assert said in capsys.readouterr().err and [path.name for path in tmp_path.iterdir()] == ["mine.toml"]


class _Robot:
    """A launcher that shoots whenever fire is pressed, unless it has been told to refuse."""

    def __init__(self, refuse: bool = False, seed: int = 1, trials: int = 6, **how: object) -> None:
        self.world = World(seed, Options())
        self.bench = Bench(self.world)
        self.presses: list[tuple[int, str]] = []
        self.refuse = refuse
        self.stops: list[float] = []
        self.asked = False
        self.driver = Driver(self.world, self._press, trials, seed, **how)

    def _press(self, button: str) -> None:
        self.presses.append((self.bench.t_ns, button))
        if button == "fire":
            assert not self.world.chassis.moving
            self.asked = True
            self.stops.append(self.world.chassis.distance_m)

    def run(self, longest_s: float = 300.0) -> None:
        feeding = 0
        while not self.driver.done and self.bench.t_ns < longest_s * 1e9:
            self.driver.step(self.bench.t_ns)
            if self.asked and not self.refuse and abs(self.world.belt.speed_rad_s - 400.0) < 2.0:
                self.asked, feeding = False, 50
            self.bench.tick(400.0, 45.0, 0.2 if feeding > 0 else 0.0)
            feeding -= 1


@pytest.mark.parametrize("seed", [1, 2])
def test_every_shot_gets_the_outcome_that_was_seen(seed: int) -> None:
    robot = _Robot(seed=seed, trials=8)
    robot.run()
    assert robot.driver.done and robot.driver.trial == 8
    buttons = [button for _, button in robot.presses if button != "reject"]
    outcomes = [result.outcome for result in robot.world.results]
    assert buttons == ["arm", *(press for outcome in outcomes for press in ("fire", outcome))]
    for (pressed_ns, button), result in zip([p for p in robot.presses if p[1] not in ("arm", "fire", "reject")],
                                            robot.world.results, strict=True):
        assert button == result.outcome
        assert pressed_ns >= result.arrival_t_ns + 400_000_000 - TICK_NS


def test_a_refusal_is_waited_out_and_then_given_up() -> None:
    robot = _Robot(refuse=True, trials=3, patience_s=2.0)
    robot.run()
    assert robot.driver.done
    assert [button for _, button in robot.presses] == ["arm", "fire", "fire", "fire"]
    fires = [t_ns for t_ns, button in robot.presses if button == "fire"]
    assert all(2.0e9 < b - a < 12.0e9 for a, b in itertools.pairwise(fires))


def test_the_stops_cover_the_range_with_a_few_trials_at_each() -> None:
    robot = _Robot(refuse=True, trials=40, patience_s=0.0, distances=(2.6, 8.0))
    robot.run(1000.0)
    assert len(robot.stops) == 40
    assert min(robot.stops) >= 2.6 and max(robot.stops) <= 8.0
    places = sorted(set(robot.stops))
    assert 40 / 3 <= len(places) <= 40
    gaps = [b - a for a, b in zip([2.6, *places], [*places, 8.0], strict=True)]
    assert max(gaps) < 5.4 * 2.5 / len(places)        # no part of the range is left out


def test_a_spoilt_trial_is_rejected_after_its_outcome() -> None:
    robot = _Robot(trials=2, rejected_share=1.0)
    robot.run()
    buttons = [button for _, button in robot.presses]
    assert [b for b in buttons if b in ("fire", "reject")] == ["fire", "reject"] * 2


def test_the_same_seed_drives_alike() -> None:
    first, second = _Robot(trials=4), _Robot(trials=4)
    first.run()
    second.run()
    assert first.presses == second.presses
    assert first.stops == second.stops


def test_prescribed_places_are_driven_to_one_after_the_other() -> None:
    robot = _Robot(refuse=True, trials=6, patience_s=0.0, repeats=2, places=(3.0, 7.5, 5.0))
    robot.run()
    assert robot.stops == [3.0, 3.0, 7.5, 7.5, 5.0, 5.0]


def test_a_ball_that_goes_in_and_never_comes_out_is_rejected(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(World, "ball_on_its_way", property(lambda world: True))
    robot = _Robot(refuse=True, trials=2, patience_s=0.5, jam_s=0.5)
    robot.run()
    assert robot.driver.done
    assert [button for _, button in robot.presses] == ["arm", "fire", "reject", "fire", "reject"]

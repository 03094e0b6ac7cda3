"""The demo: the sealed draw, its acts in a quick form, its page, and the statistics of its repetition over seeds."""

import hashlib
import html
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import truearc as ta
from benchmarks.demo_seeds import holm
from tests.portability.elsewhere import run_elsewhere
from tests.sim.discover.made import stand_in
from truearc.api.results import Effect
from truearc.cli import demo_acts
from truearc.cli.common import SHIPPED
from truearc.cli.datasets import robot_of_game
from truearc.cli.demo_acts import EFFECTS, HOOD_DEG, RATIO, Sizes, draw_effect, fire, marked_settings
from truearc.robot.config.schema import load_config
from truearc.sim.discover.finding import Interval
from truearc.sim.infer.belief import point_belief
from truearc.sim.world.options import Options
from truearc_proof.world.season import HOODS_DEG, RATIOS, reach_table

LINES = 60                            # of the console
QUICK = Sizes(practice=20, robot=2, marked=12, balls=4)
PLAY = f"""
import argparse, pathlib
import numpy as np
from truearc.cli import demo, demo_acts
from truearc.sim.gate import train
for places in ("FRONT", "UP"):         # each row of a table is a search
    ends = getattr(demo_acts, places).distances_m[[0, -1]]
    setattr(demo_acts, places, getattr(demo_acts, places)._replace(distances_m=np.linspace(*ends, 6)))
train.CHECKED, train.LEARNED = 3000, 2000      # the gate's polynomial; tests/sim/gate has it as it is
demo.secrets.choice = lambda seeds: 12                 # the printed seed repeats what it drew
sizes = demo_acts.Sizes{tuple(QUICK)}
asked = argparse.Namespace(out=pathlib.Path("report"), game=GAME, seed=None, quiet=True)
assert demo.demo(asked, sizes) == 0
"""
RIG = load_config(SHIPPED).rig
BELIEF = point_belief({"drag": {"cd": 0.5}, "magnus": {"cl": 0.04}, "wheel_slip": {"loss_per_m_s": 0.019},
                       "hood_offset": {"angle_deg": 3.1}}, {"speed": 0.01, "elevation_deg": 0.3})


def test_a_seed_repeats_the_draw_and_the_seal_is_of_the_text() -> None:
    assert draw_effect(3) == draw_effect(3)
    assert len({draw_effect(seed).number for seed in range(100)}) == len(EFFECTS)
    sealed = draw_effect(4)
    assert sealed.text.startswith(sealed.effect.name) and sealed.text != draw_effect(3).text
    assert sealed.sha256 == hashlib.sha256(sealed.text.encode()).hexdigest()


@pytest.mark.parametrize("effect", [one for one in EFFECTS if one.terms], ids=lambda effect: effect.name)
def test_truth_and_finding_are_told_in_the_same_words_with_the_same_sign(effect: demo_acts.WorldChange) -> None:
    """A change of a believed number by its change, whatever its new value is."""
    (term, size), *_ = effect.terms.items()
    found, now = Interval(size, 0.01, 0.98 * size, 1.02 * size, ""), Interval(9.0, 0.1, 8.8, 9.2, "")
    alone = Effect(term, 0.9, size, 0.1, (0.0, 0.0), "", "", "", {"x": found})
    for best in (alone, replace(alone, value=9.0, parameters={"x": now}, believed=9.0 - size, change=found)):
        act = stand_in(demo_acts.Act, finding=stand_in(ta.Finding, best=best, alternatives=()))
        truth = re.fullmatch(r"(.*) (-?[\d.]+)(.*)", effect.truth)
        assert truth is not None
        said = re.fullmatch(rf"{truth[1]} (-?[\d.]+){truth[3]} \(90 %: .* to .*{truth[3]}\)", demo_acts._found(act))
        assert said is not None and float(said[1]) == pytest.approx(float(truth[2]), rel=0.03)


def test_practice_knows_where_balls_of_the_world_fall() -> None:
    rows = np.flatnonzero(np.isin(HOODS_DEG, HOOD_DEG))
    assert np.allclose(RATIO, RATIOS) and len(rows) == len(HOOD_DEG)
    np.testing.assert_allclose(demo_acts.FALLS_AT_M, reach_table()[rows], atol=0.011)


def test_marked_shots_score_by_the_belief_and_are_spread_in_hood() -> None:
    settings = marked_settings(RIG, BELIEF, Options(), 4, 40)
    assert len(settings) == 40 and np.ptp([one.hood_deg for one in settings]) > 20.0
    nearer = marked_settings(RIG, BELIEF, Options(camera_focal_scale=1.04), 4, 40)
    assert np.mean([one.motor_ratio for one in nearer]) < np.mean([one.motor_ratio for one in settings])


def test_a_volley_misses_when_the_encoders_lie() -> None:
    aim = ta.aim(BELIEF, RIG, distances_m=np.arange(2.5, 8.01, 0.5), hood_deg=(44.0, 50.0))
    plain, off = (fire(RIG, options, 7, aim, 24) for options in (Options(), Options(encoder_scale=1.05)))
    assert plain.balls == off.balls == 24
    assert plain.threes >= 10 and plain.per_ball > off.per_ball
    assert fire(RIG, Options(), 7, aim, 24) == plain


@pytest.mark.slow
def test_the_demo_says_what_was_wrong_how_large_and_what_it_was_worth(tmp_path: Path) -> None:
    """Without what only Linux has: it must run on Windows, too."""
    folder, sealed = tmp_path / "report", draw_effect(12)
    said = run_elsewhere(f"GAME = None{PLAY}", tmp_path)
    assert len(said.splitlines()) <= LINES
    before, _, after = said.partition(sealed.sha256)
    assert sealed.effect.name not in before and sealed.effect.name in after
    last = said.splitlines()[-5:]
    assert [line.partition(":")[0] for line in last] == ["The robot", "Hidden", "Found", "How large", "Worth"]
    flat = " ".join(said.split())
    assert sealed.effect.truth in last[3] and re.search(rf"to \d+ threes of {QUICK.balls}", last[4])
    assert re.search(r"[12] of them by the robot's own runtime on emulated devices, with images and CAN frames", flat)
    page = (folder / "index.html").read_text(encoding="utf-8").replace("\N{NO-BREAK SPACE}", " ")
    headline = re.search(r'<p class="verdict">(.*?)</p>', page)
    assert page.count("<svg ") == 3 and all(html.escape(line.partition(": ")[2]) in page for line in last)
    assert headline is not None and "points per ball" in headline[1]
    assert not re.search(r"p-value|log score|interval|significan", headline[1])
    assert (folder / "envelope.txt").read_text(encoding="utf-8") == sealed.text
    assert len(ta.load_dataset(folder / "data" / "event").shots) <= QUICK.marked
    assert ta.load_belief(folder / "event.toml").coefficients and (folder / "control.html").is_file()


@pytest.mark.slow
def test_the_demo_of_a_hub_counts_its_hits(tmp_path: Path) -> None:
    said = " ".join(run_elsewhere(f"GAME = 'frc-2026'{PLAY}", tmp_path).split())
    assert re.search(rf"aimed with the paper's physics \(gravity, drag, lift\) \d+ of {QUICK.balls} balls hit", said)
    assert re.search(rf"{QUICK.marked} marked shots, .*?: (\d+ hit, )?\d+ missed", said)
    page = (tmp_path / "report" / "index.html").read_text(encoding="utf-8")
    for text in (said, page, *((tmp_path / "report" / f"{act}.html").read_text(encoding="utf-8")
                               for act in ("practice", "event", "control"))):
        words = re.sub(r"<style>.*?</style>|<[^>]*>", " ", text, flags=re.DOTALL)
        assert not re.search(r"\b(threes|twos)\b|\b(an?|no|\d+) (two|three)\b", words)
    rig = ta.load_rig(tmp_path / "report" / "data" / "event" / "rig.toml")
    assert rig.target is not None and rig.target.faces_up and rig.ball.radius_m == 0.075


@pytest.mark.slow
def test_a_volley_at_a_hub_is_worth_its_hits(tmp_path: Path) -> None:
    path = tmp_path / "hub.toml"
    path.write_text(robot_of_game(SHIPPED.read_text(encoding="utf-8"), "frc-2026"), encoding="utf-8")
    rig = load_config(path).rig
    settings = demo_acts.practice_settings(rig, 5, 12)
    assert len(settings) == 12 and all(1.8 <= one.distance_m <= 6.2 for one in settings)
    aim = ta.aim(BELIEF, rig, distances_m=np.linspace(1.9, 6.1, 6), hood_deg=(55.0, 64.0))
    plain, off = (fire(rig, options, 7, aim, 24) for options in (Options(), Options(encoder_scale=1.08)))
    assert plain.twos > off.twos and plain.per_ball == plain.twos / 24 and plain.threes == 0
    assert plain.foretold == off.foretold <= 24


def test_holm_adjusts_as_in_a_worked_example() -> None:
    assert holm([0.01, 0.04, 0.03, 0.005]) == pytest.approx([0.03, 0.06, 0.06, 0.02])

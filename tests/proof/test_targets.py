"""Figures beside the design's targets: which worlds each rests on, counted by hand."""

import math
from collections.abc import Sequence

import pytest
from msgspec.structs import replace

from tests.proof.test_score_world import finding
from truearc_proof.report.html_page import verdict
from truearc_proof.report.tables import make_tables
from truearc_proof.report.targets import against_targets
from truearc_proof.scoring.information_bound import Measured
from truearc_proof.scoring.score_world import Mark, mark
from truearc_proof.worlds.sampling_plan import DECOY, Drawn

ALLOWED = Measured((0.28, 0.2, 0.25, 0.26), (DECOY,), 0.4, 0.2)


def world(kind: str, effects: Sequence[str], names: Sequence[str], level: str = "L1", said: str = "", gain: float = 0.1,
          engine: str = "numpy", change: str = "") -> Mark:
    """A world of that kind, and these names said of it, likeliest first; none: nothing was found."""
    drawn = Drawn("w1", engine, kind, level, 300, 1, dict.fromkeys(effects, 1.0), (), change)
    told = finding(*((name, 1.0 / (2 + k)) for k, name in enumerate(names)), found=bool(names or said),
                   verdict=said or ("none", "named", "set")[min(len(names), 2)])
    told["fit"] = {"gain_per_shot": gain}
    for one in told["what"]:
        one["parameters"] = {}
    return mark(drawn, told, ALLOWED if kind in ("one", "decoy") else Measured())


def rows(marks: Sequence[Mark]) -> dict[str, list[str]]:
    return {row[1]: row[2:] for row in against_targets(marks)}


def decoys(level: str) -> list[Mark]:
    return [world("decoy", ["ball_wear"], said, level) for said in (
        [DECOY], [DECOY, "ball_wear"], ["ball_wear", DECOY], ["drag_wear"], [])]


def test_a_decoy_s_name_is_false_where_it_is_the_first_of_a_set_and_is_nobody_s_alias() -> None:
    found = rows(decoys("L1"))
    assert found["decoy: its name first"] == ["2/5 = 0.40 (0.12-0.77)", "-", "<= 0.1", "NOT REACHED"]
    assert found["decoy: its name in the set"] == ["3/5 = 0.60 (0.23-0.88)", "-", "-", "no target"]
    assert found["named wrong, of all single names given"][0].startswith("2/2")      # the decoy's, and drag_wear
    (table,) = [one for one in make_tables(decoys("L1")) if one.title.startswith("Worlds in which something is hidden")]
    assert dict(zip(table.header, table.rows[0], strict=True))["up to alias"].startswith("1/4 ")
    assert "first in 1 of 4 worlds" in verdict(decoys("L1"))


def test_a_decoy_that_the_data_have_nothing_of_shows_nothing() -> None:
    found = rows(decoys("L0"))
    assert found["decoy: its name first"] == ["not measured", "-", "<= 0.1", "no decoy that such data have anything of"]
    assert found["decoy: its name in the set"][0] == "not measured"


def test_every_single_name_counts_whatever_was_hidden_and_every_gain() -> None:
    marks = [world("one", ["wind_x"], ["wind_x"]), world("one", ["wind_x"], ["rim_catch"], gain=-0.1),
             world("one", ["wind_x"], []), world("off", ["late_gust"], ["wind_z"], gain=-0.1),
             world("two", ["rim_catch", "wind_x"], ["wind_x"]), world("two", ["rim_catch", "wind_x"], ["hood_offset"]),
             world("two", ["rim_catch", "target_height"], ["release_height"]), world("clean", [], ["wind_x"]),
             world("off", ["late_gust"], ["wind_z", "wind_x"], gain=-0.1),
             world("one", ["wind_x_m_s"], ["wheel_slip"], engine="mujoco", change="tail_wind")]
    found = rows(marks)
    assert found["named wrong, of one effect found"][0].startswith("1/2 ")
    assert found["named wrong, of all single names given"][0].startswith("5/8 ")
    assert found["gain below 0, of one effect found"][0].startswith("1/2 ")
    assert found["gain below 0, of all claims with a gain"][0].startswith("3/8 ")


@pytest.mark.parametrize("said, answered", [
    (["target_height", "release_height", "wind_x"], 1), (["target_height", "wind_x"], 0), (["target_height"], 0)])
def test_an_alias_is_answered_by_all_of_its_class(said: list[str], answered: int) -> None:
    found = rows([world("alias", ["target_height"], said)])
    assert found["aliases: a set with the whole class"][0].startswith(f"{answered}/1 ")


def test_what_has_no_value_says_why() -> None:
    found = rows([world("one", ["wind_x"], [])])
    assert found["off: unknown"] == ["not measured", "-", ">= 0.55", "none with a lambda of 50 or more was found"]
    assert found["amplitude's RMS error / least"][2] == "<= 1.35"      # as the design writes it
    assert found["top-1"][0] == "not measured" and found["top-1"][3] == "no world of this round says"
    assert found["follow-up: random shots that 100 designed ones equal"][2:] == [
        ">= 300", "no shots were asked for and given"]
    others = [row for row in against_targets([world("one", ["wind_x"], [])]) if row[0] != "L1, 300"]
    assert others == [["L1, 1000", "all", "not measured", "-", "-", "no world here has 1000 shots"]]


def test_what_was_missed_most_of_what_could_be_found_comes_first() -> None:
    marks = [world("one", ["wind_x"], ["wind_x"]), *[world("one", ["wheel_slip"], [])] * 3]
    (table,) = [one for one in make_tables(marks) if one.title.endswith("by name")]
    assert table.rows == [["wheel_slip", "0/3", "0.8"], ["wind_x", "1/1", "0.3"]]


def test_of_the_sealed_gain_no_single_world_speaks_for_all() -> None:
    half = replace(world("one", ["wind_x"], ["wind_x"]), off_m=(0.5, math.sqrt(0.17), 0.3))    # 0.08 of 0.16 m2
    whole, short = replace(half, off_m=(0.5, 0.3, 0.3)), replace(half, off_m=(5.0, 0.1, 4.0))
    nothing, own = replace(half, off_m=(0.5, 0.5, 0.4999)), replace(half, off_m=(0.5, 0.4))
    found = rows([half, half, whole, short, nothing, own])
    assert found["gain kept, in the sealed test"][0] == "0.75 (median of 4)"


@pytest.mark.parametrize(("found", "of", "said"), [
    (0, 10, "NOT REACHED, may be chance"), (2, 40, "reached, may be chance"), (40, 1000, "reached, may be chance"),
    (450, 10000, "reached"), (10, 100, "NOT REACHED, may be chance"), (20, 100, "NOT REACHED"),
    (0, 1000, "NOT REACHED")])
def test_targets_say_what_may_be_chance(found: int, of: int, said: str) -> None:
    """Of false alarms .03 to .06 are wanted."""
    clean = world("clean", [], []), world("clean", [], ["wind_x"])
    assert rows([clean[0]] * (of - found) + [clean[1]] * found)["false alarms, clean"][3] == said

"""Tables, targets and the page of a round."""

import math
from collections.abc import Sequence

import pytest
from msgspec import structs
from msgspec.structs import replace

from tests.proof.test_marks import finding
from truearc_proof.rounds.marks import Mark, Measured, mark
from truearc_proof.rounds.page import claimed_bins, reliability_png, verdict
from truearc_proof.rounds.tables import kept_in_test, make_tables, posterior_rows
from truearc_proof.rounds.worlds import DECOY, Drawn

# --- report

ALLOWED = Measured((0.28, 0.2, 0.25, 0.26), (DECOY,), 0.4)
SLIP, WIND = ["wheel_slip"], ["wind_x"]
PLAIN = Mark("a", "numpy", "one", "L1", 300, ("wind_x",), 9.0, True, 0.001, "named", ("wind_x",), said=0.9, alias=True,
             right=("wind_x",), unexplained=0.05)


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


def decoys(level: str) -> list[Mark]:
    return [world("decoy", ["ball_wear"], said, level) for said in (
        [DECOY], [DECOY, "ball_wear"], ["ball_wear", DECOY], ["drag_wear"], [])]


def test_a_decoy_s_name_is_false_where_it_is_the_first_of_a_set_and_is_nobody_s_alias() -> None:
    assert by_name(decoys("L1"))["single names wrong, whatever was hidden"][0].startswith("2/2")
    (table,) = [one for one in make_tables(decoys("L1")) if one.title.startswith("Worlds in which something is hidden")]
    assert dict(zip(table.header, table.rows[0], strict=True))["up to alias"].startswith("1/4 ")
    assert "first in 1 of 4 worlds" in verdict(decoys("L1"))


def test_what_was_missed_most_of_what_could_be_found_comes_first() -> None:
    marks = [world("one", ["wind_x"], ["wind_x"]), *[world("one", ["wheel_slip"], [])] * 3]
    (table,) = [one for one in make_tables(marks) if one.title.endswith("by name")]
    assert table.rows == [["wheel_slip", "0/3", "0.8"], ["wind_x", "1/1", "0.3"]]


def test_of_the_sealed_gain_no_single_world_speaks_for_all() -> None:
    half = replace(world("one", ["wind_x"], ["wind_x"]), off_m=(0.5, math.sqrt(0.17), 0.3))    # 0.08 of 0.16 m2
    whole, short = replace(half, off_m=(0.5, 0.3, 0.3)), replace(half, off_m=(5.0, 0.1, 4.0))
    nothing, own = replace(half, off_m=(0.5, 0.5, 0.4999)), replace(half, off_m=(0.5, 0.4))
    assert kept_in_test([half, half, whole, short, nothing, own]) == "0.75 (median of 4)"


def by_name(marks: list[Mark]) -> dict[str, list[str]]:
    return {row[0]: row[1:] for row in posterior_rows(marks)}


def test_each_row_counts_its_own_worlds() -> None:
    rows = by_name([
        world("clean", [], []), world("clean", [], SLIP), world("dirty", [], []),
        *(world(kind, [], [], engine="mujoco", change="nothing") for kind in ("clean", "dirty")),
        world("one", WIND, WIND), world("one", WIND, ["hood_offset"]), world("one", WIND, []),
        world("one", WIND, ["hood_offset", "wind_x", "rim_catch"]), world("one", WIND, [], said="unknown"),
        world("two", [*WIND, *SLIP], WIND), world("off", ["late_gust"], ["wind_z", "hood_offset"]),
        world("off", ["late_gust"], ["wind_z"])])
    assert rows["false alarms, clean"][0].startswith("1/2 = 0.50")
    assert rows["false alarms, dirty"][0].startswith("0/1")
    assert rows["false alarms, MuJoCo unchanged"][0].startswith("0/2")
    # named: slip where nothing was, hood offset for wind, and wind_z for what no term has; not the two right ones
    assert rows["single names wrong, whatever was hidden"][0].startswith("3/5 = 0.60")
    assert rows["set holds the truth"][0].startswith("3/5")
    assert rows["in no catalogue: unknown or a set"][0].startswith("1/2")
    assert rows["mean size of a set"][0] == "1.50 of 4"
    assert rows["power, share of what the data allow"][0].endswith("4/5 of 0.28")


def test_a_target_that_chance_may_have_missed_is_told_from_one_that_it_has_not() -> None:
    few, many = (([world("one", WIND, WIND)] * 3 + [world("one", WIND, ["hood_offset"])]) * count for count in (1, 40))
    assert by_name(few)["set holds the truth"][2] == "NOT REACHED, may be chance"
    assert by_name(many)["set holds the truth"][2] == "NOT REACHED"
    assert by_name([world("one", WIND, WIND)] * 40)["set holds the truth"][1:] == [">= 0.9", "reached"]


def test_worse_on_the_sealed_season_means_by_over_one_percent() -> None:
    found = world("one", WIND, WIND)
    rows = by_name([replace(found, off_m=(1.0, after)) for after in (1.0, 1.005, 1.02, 0.8)])
    assert rows["adopted worse on the sealed season by over 1 %"][0].startswith("1/3")     # one changed nothing


def test_they_are_among_the_tables_of_rounds_of_one_level() -> None:
    one, other = world("one", WIND, WIND), world("one", WIND, WIND, level="L0")
    titles = [table.title for table in make_tables([one])]
    assert "Against the targets of the posterior" in titles
    assert "Against the targets of the posterior" not in [table.title for table in make_tables([one, other])]


def test_bins_count_what_was_right_of_what_was_claimed() -> None:
    pairs = [(0.1, False), (0.19, True), (0.97, True), (1.0, True), (1.0, False)]
    assert claimed_bins(pairs) == [(pytest.approx(0.145), 1, 2), (pytest.approx(0.99), 2, 3)]
    assert claimed_bins([]) == []


def test_there_is_a_picture_where_probabilities_were_claimed() -> None:
    assert reliability_png([structs.replace(PLAIN, said=None)]) is None
    marks = [PLAIN, structs.replace(PLAIN, level="L0", alias=False), structs.replace(
        PLAIN, verdict="unknown", right=(), alias=None, unexplained=0.8)]
    assert (reliability_png(marks) or b"").startswith(b"\x89PNG")

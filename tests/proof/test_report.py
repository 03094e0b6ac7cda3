"""Tables, targets and the page of a round."""

import math
from collections.abc import Sequence
from itertools import groupby
from math import comb
from pathlib import Path

import numpy as np
import pytest
from msgspec import structs
from msgspec.structs import replace

from benchmarks.proof import BEGIN, END, load, tell_posterior
from tests.proof.test_score_world import finding
from truearc_proof.report.html_page import claimed_bins, reliability_png, verdict
from truearc_proof.report.tables import beside, make_tables
from truearc_proof.report.targets import against_targets, posterior_rows
from truearc_proof.scoring.oracle import Measured
from truearc_proof.scoring.score_world import Mark, mark
from truearc_proof.worlds.sampling_plan import DECOY, Drawn

ALLOWED = Measured((0.28, 0.2, 0.25, 0.26), (DECOY,), 0.4, 0.2)
SLIP, WIND = ["wheel_slip"], ["wind_x"]
PLAIN = Mark("a", "numpy", "one", "L1", 300, ("wind_x",), 9.0, True, 0.001, "named", ("wind_x",), said=0.9, alias=True,
             right=("wind_x",), unexplained=0.05)
ROOT = Path(__file__).parents[2]
PAGE = ROOT / "docs/measured/sealed.md"


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


def nulls(alarms: int, of: int) -> list[Mark]:
    return [mark(Drawn(f"w{k}", "numpy", "clean", "L0", 300, k, {}),
                 {"mismatch": {"found": k < alarms, "p_value": 0.5}, "verdict": "unknown", "where": None, "what": [],
                  "set": None, "fit": {"gain_per_shot": 0.0}, "also": []}, Measured()) for k in range(of)]


@pytest.mark.parametrize("alarms, inside", [(0, "no"), (1, "yes"), (2, "no"), (8, "no")])
def test_a_share_is_inside_only_between_the_ends_of_the_published_interval(alarms: int, inside: str) -> None:
    row = next(row for row in beside(nulls(2, 40), nulls(alarms, 10)).rows if row[0] == "false alarms, clean")
    assert row[1] == "2/40 = 0.05 (0.01-0.17)" and row[3] == inside


def test_an_interval_that_begins_at_nothing_has_nothing_in_it() -> None:
    rows = {row[0]: row[3] for row in beside(nulls(0, 19), nulls(0, 6)).rows}
    assert rows["false alarms, clean"] == "yes"


def test_chance_is_that_of_the_hypergeometric_distribution() -> None:
    row = next(row for row in beside(nulls(0, 5), nulls(5, 5)).rows if row[0] == "false alarms, clean")
    assert row[4] == f"{2 / comb(10, 5):.2f}"                # all five here or all five there, of all ways to deal them


def test_bins_count_what_was_right_of_what_was_claimed() -> None:
    pairs = [(0.1, False), (0.19, True), (0.97, True), (1.0, True), (1.0, False)]
    assert claimed_bins(pairs) == [(pytest.approx(0.145), 1, 2), (pytest.approx(0.99), 2, 3)]
    assert claimed_bins([]) == []


def test_claims_that_are_right_as_often_as_they_say_lie_on_the_diagonal() -> None:
    rng = np.random.default_rng(3)
    said = rng.uniform(0.0, 1.0, 20_000)
    pairs = list(zip(said.tolist(), (rng.uniform(size=len(said)) < said).tolist(), strict=True))
    for mean, hits, of in claimed_bins(pairs):
        assert abs(hits / of - mean) < 4.0 * np.sqrt(mean * (1.0 - mean) / of)


def test_there_is_a_picture_where_probabilities_were_claimed() -> None:
    assert reliability_png([structs.replace(PLAIN, said=None)]) is None
    marks = [PLAIN, structs.replace(PLAIN, level="L0", alias=False), structs.replace(
        PLAIN, verdict="unknown", right=(), alias=None, unexplained=0.8)]
    assert (reliability_png(marks) or b"").startswith(b"\x89PNG")


def test_the_page_is_what_the_archives_say() -> None:
    rounds = sorted(map(load, sorted((PAGE.parent / "sealed").glob("*.tar.xz"))), key=lambda one: one.setting)
    told = [tell_posterior(list(group)) for _, group in groupby(rounds, key=lambda one: one.setting)]
    page = PAGE.read_text(encoding="utf-8")
    assert rounds and page.split(BEGIN)[1].split(END)[0] == "\n".join(told)

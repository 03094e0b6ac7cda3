"""Targets of the posterior: which worlds each row rests on, counted by hand."""

from msgspec.structs import replace

from tests.proof.test_targets import world
from truearc_proof.report.posterior_targets import posterior_rows
from truearc_proof.report.tables import make_tables
from truearc_proof.scoring.score_world import Mark

SLIP, WIND = ["wheel_slip"], ["wind_x"]


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

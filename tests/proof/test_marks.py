"""Marks of claims made up so that the right mark is plain; tables and targets that are made of them."""

import math
from collections.abc import Sequence
from typing import Any

import pytest
from msgspec.structs import replace

from benchmarks import seasons
from benchmarks.proof import claimed_bins
from benchmarks.worlds import KINDS, Job, amount_of, mark_job, plan_jobs
from truearc.errors import InputError
from truearc_proof.rounds.marks import Mark, Measured, change_of, is_alias, mark, named_decoy, said_set, up_to_alias
from truearc_proof.rounds.tables import make_tables, posterior_rows, verdict
from truearc_proof.rounds.worlds import ALIKE, DECOY, DIRTS, Drawn, names_at

ONE = Drawn("w1", "numpy", "one", "L1", 300, 1, {"wind_x": 2.0}, (), "", {"wind_x": 20.0})


def finding(*names: tuple[str, float], found: bool = True, verdict: str = "named", stage: str = "flight",
            value: float = 2.2, also: tuple[str, ...] = ()) -> dict[str, Any]:
    parameters = {"speed_m_s": {"value": value, "low90": value - 0.5, "high90": value + 0.5}}
    what = [{"term": name, "probability": share, "parameters": parameters} for name, share in names]
    return {"mismatch": {"found": found, "p_value": 0.01}, "verdict": verdict, "where": {"stage": stage},
            "what": what, "set": [name for name, _ in names] or None, "fit": {"gain_per_shot": 0.1},
            "also": [{"what": [{"term": name}], "set": [name]} for name in also]}


def test_the_right_name_with_its_size() -> None:
    told = mark(ONE, finding(("wind_x", 0.95)), Measured((0.9, 0.8, 0.85, 0.9), (), 0.4))
    assert (told.found, told.stage, told.first, told.alias, told.covered, told.holds) == (True,) * 6
    assert told.error == pytest.approx(0.5)
    assert told.hidden == ("wind_x",)


def test_a_wrong_name_and_a_set_that_has_the_right_one() -> None:
    wrong = mark(ONE, finding(("wheel_slip", 0.95), stage="launch"), Measured())
    assert (wrong.stage, wrong.first, wrong.alias, wrong.covered, wrong.holds) == (False, False, False, False, None)
    told = mark(ONE, finding(("spin_drag", 0.5), ("wind_x", 0.4), verdict="set"), Measured())
    assert (told.first, told.alias, told.covered, told.set_size) == (False, False, True, 2)
    alike = mark(ONE, finding(("spin_drag", 0.95)), Measured(None, ("spin_drag",)))
    assert (alike.first, alike.alias) == (False, True)


def test_nothing_found_has_no_marks_of_names() -> None:
    told = mark(ONE, finding(found=False, verdict="none"), Measured((0.5, 0.4, 0.4, 0.4)))
    assert (told.found, told.first, told.stage, told.names) == (False, None, None, ())
    assert told.allowed == (0.5, 0.4, 0.4, 0.4)


def test_of_a_believed_number_the_change_counts() -> None:
    moved = finding(("wind_x", 0.95))
    moved["what"][0]["believed"] = 0.4               # 1.7 to 2.7 now
    assert change_of(moved["what"][0], "speed_m_s") == pytest.approx((1.8, 1.3, 2.3))
    foreign = Drawn("w1", "foreign", "one", "L1", 300, 1, {"wind_x": 1.5})
    assert mark(foreign, moved, Measured()).holds
    assert mark(replace(foreign, effects={"wind_x": 2.5}), moved, Measured()).holds is False
    moved["what"][0]["change"] = {"value": 2.4, "low90": 2.2, "high90": 2.6}
    assert change_of(moved["what"][0], "speed_m_s") == (2.4, 2.2, 2.6) and change_of({"term": "drag"}, "cd") is None


def test_two_effects_are_both_right_only_together() -> None:
    two = Drawn("w2", "numpy", "two", "L1", 300, 1, {"wind_x": 2.0, "wheel_slip": 0.02})
    assert mark(two, finding(("wind_x", 0.95), also=("wheel_slip",)), Measured()).both
    assert mark(two, finding(("wind_x", 0.95), also=("rim_catch",)), Measured()).both is False


def robot(kind: str, change: str, level: str = "L1", dirt: tuple[str, ...] = (), **options: float) -> Drawn:
    return Drawn("w8", "mujoco", kind, level, 300, 1, options, dirt, change)


def test_two_changes_of_a_robot_are_both_right_when_each_has_one_of_its_names() -> None:
    two = robot("two", "tail_wind+soft_ball", wind_x_m_s=1.5, ball_stiffness_scale=0.6)
    told = mark(two, finding(("wind_x", 0.95), also=("wheel_slip",)), Measured())
    assert (told.hidden, told.first, told.stage, told.both) == (("tail_wind", "soft_ball"), True, True, True)
    assert set(told.right) == {"wind_x", "exit_efficiency", "wheel_slip", "wheel_droop", "ball_compression"}
    # two names of the one change are not both
    told = mark(two, finding(("exit_efficiency", 0.95), also=("wheel_slip",), stage="launch"), Measured())
    assert (told.first, told.stage, told.both) == (True, True, False)
    assert mark(two, finding(("rim_catch", 0.95), stage="arrival"), Measured()).stage is False


@pytest.mark.parametrize(("level", "change", "name", "stage", "right"), [
    ("L0", "camera_scale", "target_height", "arrival", True),
    ("L0", "release_height", "distance_bias", "sensing", True),
    ("L1", "release_height", "target_height", "launch", True),
    ("L1", "release_height", "distance_bias", "sensing", False),
    ("L2", "camera_scale", "distance_scale", "sensing", True),
    ("L2", "camera_scale", "release_height", "launch", False)])
def test_any_name_of_a_class_is_right_of_a_robots_alias(level, change, name, stage, right):
    told = mark(robot("alias", change, level), finding((name, 0.95), stage=stage), Measured())
    assert (told.first, told.stage, told.covered, told.right) == (right, right, right, ALIKE[level])


def test_a_robots_decoy_is_nobodys_alias_and_what_wears_is_right() -> None:
    decoy = robot("decoy", "worn_ball", dirt=("battery_with_wear",), wear_stiffness_per_shot=0.005)
    told = mark(decoy, finding(("battery_sag", 0.95), stage="launch"), Measured(None, ("battery_sag",)),
                {"argmax": {"says_something": True, "names": ["battery_sag"]}})
    assert (told.first, told.alias, up_to_alias(told), named_decoy(told)) == (False, True, False, True)
    assert told.rivals == {"argmax": (True, False, False)}
    right = mark(decoy, finding(("ball_wear", 0.95), stage="launch"), Measured())
    assert (right.first, up_to_alias(right), named_decoy(right)) == (True, True, False)
    bare = mark(robot("decoy", "worn_ball", "L0", ("battery_with_wear",)), finding(("drag", 0.9)), Measured())
    assert named_decoy(bare) is None                  # outcomes alone have no battery


def test_what_no_catalogue_has_of_a_robot_can_be_named_only_wrongly() -> None:
    flexed = robot("off", "hood_flex", hood_flex_deg=0.4)
    told = finding(verdict="unknown", stage="launch")
    told["where"] |= {"covariate": "motor_ratio", "direction": "vertical"}
    marked = mark(flexed, told, Measured())
    assert (marked.hidden, marked.right, marked.first, marked.stage, marked.goes_with) == (
        ("hood_flex",), (), None, True, True)
    told["where"]["direction"] = "along"
    assert mark(flexed, told, Measured()).goes_with is False
    aloft = mark(robot("off", "wind_aloft", wind_x_m_s=0.5, wind_above_m=2.5), told, Measured())
    assert (aloft.stage, aloft.goes_with) == (False, None)       # nobody can be sure of what it would go with


def test_a_dirty_robot_is_a_null_and_has_a_row_of_its_own() -> None:
    dirty = mark(robot("dirty", "nothing", dirt=("scatter",)), finding(("wind_x", 0.9)), Measured())
    assert (dirty.hidden, dirty.found, dirty.first, dirty.right) == ((), True, None, ())
    off = mark(Drawn("w3", "numpy", "off", "L1", 300, 1, {"hood_flex": 2.0}),
               finding(verdict="unknown", stage="launch"), Measured())
    assert (off.stage, off.first, off.covered, off.names) == (True, None, None, ())
    clean = mark(robot("clean", "nothing"), finding(found=False, verdict="none"), Measured())
    numpys = mark(Drawn("w6", "numpy", "dirty", "L1", 300, 1, {}, ("balls",)), finding(found=False, verdict="none"),
                  Measured())
    alarms = make_tables([dirty, clean, clean, numpys])[0]
    assert {row[0]: row[1][:3] for row in alarms.rows} == {
        "dirty": "0/1", "MuJoCo, unchanged": "0/2", "MuJoCo, unchanged, dirty": "1/1", "together": "1/4"}


def test_tables_count_every_world_once() -> None:
    clean = Drawn("w6", "numpy", "clean", "L1", 300, 1)
    marks: list[Mark] = [mark(clean, finding(found=False, verdict="none"), Measured())] * 19
    marks += [mark(clean, finding(("wind_x", 0.9)), Measured()), mark(ONE, finding(("wind_x", 0.95)), Measured())]
    text = "\n".join(one.markdown() for one in make_tables(marks))
    assert "| together | 1/20 = 0.05 (0.01-0.24) | 1/20" in text


def test_what_others_say_of_the_same_world_is_marked_by_the_same_rule() -> None:
    claims = {"gp": {"says_something": True, "names": []}, "argmax": {"says_something": True, "names": ["spin_drag"]},
              "boosted": {"says_something": False, "names": ["wind_x"]}}
    told = mark(ONE, finding(("wind_x", 0.95)), Measured(None, ("spin_drag",)), claims)
    assert told.rivals == {"gp": (True, False, False), "argmax": (True, False, True), "boosted": (False, False, False)}
    clean = mark(Drawn("w6", "numpy", "clean", "L2", 300, 1), finding(found=False, verdict="none"), Measured(), claims)
    assert clean.rivals["argmax"] == (True, None, None)
    (table,) = [one for one in make_tables([told, clean]) if "Rivals" in one.title]
    rows = {row[0]: row[1:] for row in table.rows}
    assert rows["truearc"][0].startswith("0/1") and rows["truearc"][2].startswith("1/1")
    assert rows["argmax"][0].startswith("1/1") and rows["argmax"][2].startswith("0/1")
    assert rows["argmax"][3].startswith("1/1")


def test_the_verdict_is_a_sentence() -> None:
    marks = [mark(ONE, finding(("wind_x", 0.95)), Measured()),
             mark(Drawn("w6", "numpy", "clean", "L1", 300, 1), finding(found=False, verdict="none"), Measured())]
    assert verdict(marks).startswith("Where nothing was missing, something was claimed in 0 of 1 worlds (0% to 79%).")


JOB = Job("effects", "hood_offset", "L1", 300, 1.0, 7, 0)
SCALES = {"L0": 1.0, "L1": 1.0, "L2": 0.25}


def told(what=(("hood_offset", 0.7), ("wheel_slip", 0.2)), said=None, stage="sensing", low=0.5, high=1.0):
    return {"mismatch": {"found": True, "p_value": 0.01},
            "where": {"stage": stage, "stage_probability": {"sensing": 0.3, "launch": 0.6}, "covariate": "hood_deg",
                      "direction": "vertical"},
            "what": [{"term": term, "probability": p, "parameters": {"angle_deg": {"low90": low, "high90": high}}}
                     for term, p in what],
            "verdict": "named", "set": said}


def test_a_null_has_no_right_answer_and_an_alias_is_one_by_level():
    null = mark_job(Job("nulls", "clean", "L0", 300, 0.0, 7, 0), told())
    assert null.found and null.stage is None and null.first is None
    table = Job("effects", "target_height", "L1", 300, 1.0, 7, 0)
    alias = mark_job(table, told(what=(("release_height", 0.95),), said=["release_height"]))
    assert (alias.first, alias.alias, alias.covered) == (False, True, False)
    assert [is_alias(level, "target_height", ["release_height"]) for level in ("L0", "L1", "L2")] == [True, True, False]


def test_without_a_stage_the_likeliest_counts_and_intervals_are_held_against_the_amplitude():
    assert [mark_job(JOB, told(stage=stage)).stage for stage in ("sensing", "launch", None)] == [True, False, False]
    ends = ((0.8, 0.9), (0.81, 0.9), (0.1, 0.79), (None, None))
    assert [mark_job(JOB, told(low=low, high=high)).holds for low, high in ends] == [True, False, False, None]


def test_a_set_that_is_not_said_is_the_likeliest_ninety_percent():
    assert said_set(told(what=(("a", 0.5), ("b", 0.3), ("c", 0.05), ("d", 0.02)))) == ["a", "b"]
    assert said_set(told(said=["z"])) == ["z"] and said_set({}) == []
    assert said_set(told(what=(("a", 0.99), ("b", 0.01)))) == ["a"]


def test_jobs_are_different_worlds_and_the_same_again():
    jobs = plan_jobs(KINDS, ["L0", "L1", "L2"], [100, 300], 3, 7, SCALES)
    assert len({job.key for job in jobs}) == len(jobs) > 400
    seeds = {}
    for job in jobs:
        seeds.setdefault(job.seed, set()).add((job.kind, job.name, job.index))
    assert all(len(worlds) == 1 for worlds in seeds.values())
    assert jobs == plan_jobs(KINDS, ["L0", "L1", "L2"], [100, 300], 3, 7, SCALES)
    assert not {job.seed for job in plan_jobs(KINDS, ["L0"], [100], 3, 8, SCALES)} & set(seeds)


def test_what_a_level_cannot_show_is_run_only_when_named():
    assert "battery_sag" not in set(names_at("effects", "L0")) and "battery_sag" in set(names_at("effects", "L1"))
    assert "track_scale" not in set(names_at("effects", "L1")) and "track_scale" in set(names_at("effects", "L2"))
    assert "clipped" not in set(names_at("nulls", "L1")) and set(names_at("nulls", "L2")) == set(DIRTS)
    named = plan_jobs(["effects"], ["L0"], [300], 2, 7, SCALES, ["battery_sag"])
    assert [job.name for job in named] == ["battery_sag"] * 2
    with pytest.raises(InputError, match="moon"):
        plan_jobs(["effects"], ["L0"], [300], 2, 7, SCALES, ["moon"])
    with pytest.raises(InputError, match="stars"):
        plan_jobs(["stars"], ["L0"], [300], 2, 7, SCALES)


def test_amplitudes_take_turns_in_sign_where_nature_is_free():
    signs = [amount_of(Job("effects", "wind_x", "L2", 300, 0.25, 7, index)) for index in range(4)]
    assert signs == [0.2, -0.2, 0.2, -0.2]
    assert {amount_of(Job("effects", "spin_decay", "L2", 300, 1.0, 7, index)) for index in range(4)} == {0.6}


# --- report

ALLOWED = Measured((0.28,), (DECOY,), 0.4)
SLIP, WIND = ["wheel_slip"], ["wind_x"]
PLAIN = Mark("a", "numpy", "one", "L1", 300, ("wind_x",), True, 0.001, "named", ("wind_x",), said=0.9, alias=True,
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


def test_foreign_worlds_lead_and_a_round_without_them_has_no_row_of_them() -> None:
    near = [world("clean", [], [], engine="foreign"), world("clean", [], SLIP, engine="foreign"),
            world("one", WIND, WIND, engine="foreign"), world("one", WIND, SLIP, engine="foreign"),
            world("one", WIND, [], engine="foreign")]
    far = [world("clean", [], []), world("one", WIND, WIND)]
    rows = by_name([*far, *near])
    assert list(rows)[:3] == ["false alarms, foreign", "foreign: a change is found", "foreign: set holds the truth"]
    assert [row[0].partition(" ")[0] for row in list(rows.values())[:3]] == ["1/2", "2/3", "1/2"]
    assert rows["false alarms, clean"][0].startswith("0/1")
    assert not [name for name in by_name(far) if "foreign" in name]
    alarms, hidden = (next(one for one in make_tables([*far, *near]) if one.title.startswith(f"Worlds in which {what}"))
                      for what in ("nothing", "something"))
    assert alarms.rows[0][:2] == ["foreign, unchanged", "1/2 = 0.50 (0.09-0.91)"]
    assert hidden.rows[0][0] == "foreign, one thing changed" and hidden.rows[0][1].startswith("2/3")


def test_seasons_are_counted_by_change_with_exact_intervals() -> None:
    def season(seed: int, *names: str, off: float = 0.0) -> dict[str, Any]:
        (truth,) = seasons.size_of(seed, "wind_x").values()
        told = finding(*((name, 0.9 / (2 + k)) for k, name in enumerate(names)), found=bool(names), value=truth + off,
                       verdict=("none", "named", "set")[min(len(names), 2)])
        events = {"nothing": finding(found=False, verdict="none"), "wind_x": told}
        return {"level": "L1", "seed": seed, "shots": [300, 80], "adopted": ["wheel_slip"], "off_m": [0.2, 0.1],
                "events": {name: {**one, "seconds": 2.0} for name, one in events.items()}}

    table = seasons.make_table([season(20090, "wind_x"), season(20091, "wind_z", "wind_x", off=0.8),
                                season(20092, "wheel_slip"), season(20093)])
    header, _, same, wind = (dict(enumerate(row.split(" | "))) for row in table.split("\n")[:4])
    column = {name.strip("| "): place for place, name in header.items()}
    assert same[column["found"]] == "0 of 4 (0.00 to 0.60)"            # 1 - 0.025^(1 / 4)
    assert wind[column["found"]] == "3 of 4 (0.19 to 0.99)"
    assert wind[column["one name, wrong"]].startswith("1 of 2")
    assert wind[column["set holds the truth, of those found"]].startswith("2 of 3")
    assert wind[column["90 % interval holds the change"]].startswith("1 of 2")
    assert wind[column["RMS error"]] == f"{0.8 / math.sqrt(2.0):.2g}"
    assert wind[column["stated deviation"]] == f"{0.5 / 1.645:.2g}" and "wheel_slip (4)." in table


def test_a_target_that_chance_may_have_missed_is_told_from_one_that_it_has_not() -> None:
    few, many = (([world("one", WIND, WIND)] * 3 + [world("one", WIND, ["hood_offset"])]) * count for count in (1, 40))
    assert by_name(few)["set holds the truth"][2] == "NOT REACHED, may be chance"
    assert by_name(many)["set holds the truth"][2] == "NOT REACHED"
    assert by_name([world("one", WIND, WIND)] * 40)["set holds the truth"][1:] == [">= 0.9", "reached"]


def test_worse_on_the_sealed_season_means_by_over_one_percent() -> None:
    found = world("one", WIND, WIND)
    rows = by_name([replace(found, off_m=(1.0, after)) for after in (1.0, 1.005, 1.02, 0.8)])
    assert rows["adopted worse on the sealed season by over 1 %"][0].startswith("1/3")     # one changed nothing


def test_bins_count_what_was_right_of_what_was_claimed() -> None:
    pairs = [(0.1, False), (0.19, True), (0.97, True), (1.0, True), (1.0, False)]
    assert claimed_bins(pairs) == [(pytest.approx(0.145), 1, 2), (pytest.approx(0.99), 2, 3)]
    assert claimed_bins([]) == []

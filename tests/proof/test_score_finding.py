"""Marks of findings made up so that the right mark is plain."""

import pytest

from benchmarks.worlds import KINDS, Job, amount_of, mark_job, plan_jobs, true_parameter, world_of
from truearc.errors import InputError
from truearc_proof.rounds.marks import is_alias, said_set
from truearc_proof.rounds.worlds import DIRTS, names_at
from truearc_proof.truth.world import make_world

JOB = Job("effects", "hood_offset", "L1", 300, 1.0, 7, 0)
SCALES = {"L0": 1.0, "L1": 1.0, "L2": 0.25}


def finding(found=True, what=(("hood_offset", 0.7), ("wheel_slip", 0.2)), said=None, verdict="named", stage="sensing",
            low=0.5, high=1.0):
    return {"mismatch": {"found": found, "p_value": 0.01 if found else 0.4},
            "where": {"stage": stage, "stage_probability": {"sensing": 0.3, "launch": 0.6}, "covariate": "hood_deg",
                      "direction": "vertical"},
            "what": [{"term": term, "probability": p, "parameters": {"angle_deg": {"low90": low, "high90": high}}}
                     for term, p in what],
            "verdict": verdict, "set": said}


def test_a_right_answer_is_right_in_everything():
    marks = mark_job(JOB, finding())
    assert (marks.found, marks.stage, marks.first, marks.alias, marks.covered) == (True,) * 5
    assert marks.holds and marks.set_size == 2


def test_what_was_not_found_is_asked_nothing_more():
    marks = mark_job(JOB, finding(found=False, what=(), verdict="none"))
    assert not marks.found and marks.p_value == 0.4
    assert {marks.stage, marks.first, marks.alias, marks.covered, marks.set_size, marks.holds} == {None}


def test_a_wrong_name_an_alias_and_a_set():
    wrong = mark_job(JOB, finding(what=(("rim_catch", 0.95),), said=["rim_catch"]))
    assert not (wrong.first or wrong.alias or wrong.covered) and wrong.holds is None
    in_set = mark_job(JOB, finding(what=(("wheel_slip", 0.5), ("hood_offset", 0.4)), said=["wheel_slip", "hood_offset"],
                                   verdict="set"))
    assert (in_set.first, in_set.alias, in_set.covered, in_set.set_size) == (False, False, True, 2)
    table = Job("effects", "target_height", "L1", 300, 1.0, 7, 0)
    alias = mark_job(table, finding(what=(("release_height", 0.95),), said=["release_height"]))
    assert (alias.first, alias.alias, alias.covered) == (False, True, False)
    assert [is_alias(level, "target_height", ["release_height"]) for level in ("L0", "L1", "L2")] == [True, True, False]


def test_in_a_null_every_name_is_wrong_and_nothing_can_be_right():
    marks = mark_job(Job("nulls", "clean", "L0", 300, 0.0, 7, 0), finding())
    assert marks.found and marks.stage is None and marks.first is None


@pytest.mark.parametrize(("stage", "right"), [("sensing", True), ("launch", False), (None, False)])
def test_without_a_stage_the_likeliest_counts(stage, right):
    assert mark_job(JOB, finding(stage=stage)).stage is right


@pytest.mark.parametrize(("low", "high", "holds"), [(0.8, 0.9, True), (0.81, 0.9, False), (0.1, 0.79, False),
                                                    (None, None, None)])
def test_intervals_are_held_against_the_amplitude(low, high, holds):
    assert mark_job(JOB, finding(low=low, high=high)).holds is holds


def test_wear_of_balls_that_nobody_tells_apart_is_another_number():
    job = Job("effects", "ball_wear", "L0", 300, 1.0, 7, 0)
    worn = finding(what=(("ball_wear", 0.9),))
    worn["what"][0]["parameters"] = {"loss": {"low90": 0.02, "high90": 0.04}}
    assert mark_job(job, worn).first and mark_job(job, worn).holds is None
    assert mark_job(Job("effects", "ball_wear", "L1", 300, 1.0, 7, 0), worn).holds is True


def test_a_set_that_is_not_said_is_the_likeliest_ninety_percent():
    assert said_set(finding(what=(("a", 0.5), ("b", 0.3), ("c", 0.05), ("d", 0.02)))) == ["a", "b"]
    assert said_set(finding(said=["z"])) == ["z"] and said_set({}) == []
    assert said_set(finding(what=(("a", 0.99), ("b", 0.01)))) == ["a"]


def test_true_parameters_in_the_catalogues_words():
    assert true_parameter(JOB) == ("angle_deg", 0.8)
    odd = Job("effects", "hood_offset", "L1", 300, 0.5, 7, 1)
    assert true_parameter(odd) == ("angle_deg", -0.4)
    assert true_parameter(Job("effects", "hood_backlash", "L1", 300, 1.0, 7, 0)) == ("angle_deg", -0.6)
    assert true_parameter(Job("off", "late_gust", "L1", 300, 1.0, 7, 0)) is None


def test_jobs_are_different_worlds_and_the_same_again():
    jobs = plan_jobs(KINDS, ["L0", "L1", "L2"], [100, 300], 3, 7, SCALES)
    assert len({job.key for job in jobs}) == len(jobs) > 400
    seeds = {}
    for job in jobs:
        seeds.setdefault(job.seed, set()).add((job.kind, job.name, job.index))
    assert all(len(worlds) == 1 for worlds in seeds.values())
    assert jobs == plan_jobs(KINDS, ["L0", "L1", "L2"], [100, 300], 3, 7, SCALES)
    other = plan_jobs(KINDS, ["L0"], [100], 3, 8, SCALES)
    assert not {job.seed for job in other} & set(seeds)


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
    assert world_of(Job("nulls", "all", "L2", 300, 0.0, 7, 0)).dirt == DIRTS["all"]
    assert dict(world_of(JOB).effects) == {"hood_offset": 0.8}
    assert make_world(seed=JOB.seed).cd == world_of(JOB).cd

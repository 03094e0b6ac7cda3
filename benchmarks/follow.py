"""Benchmark of the always-valid test, evaluated after every shot: its false-alarm rate, and its delay after a change.

    python -m benchmarks.follow --practices 20 --sessions 50 --seasons 6 --seed 700 --out FILE
    python -m benchmarks.follow --table FILE

A practice of 300 shots gives a belief (the fit of the believed terms, without named effects). Sessions of 80 marked
shots are then tested after each shot. There are three kinds:

belief: the launcher's parameters are drawn from the posterior, for which the rate is exact, and the heights from its
forecast.
robot: the launcher of the practice itself, simulated by the engine of the concealed worlds (truearc_proof.truth).
season: the MuJoCo launcher; its belief is what discovery adopted after practice, starting from gravity, drag and lift.

Changed sessions show how many shots an alarm takes. For comparison, a naive test runs alongside. It raises an alarm if
the same statistic is among the largest 5 % of unchanged sessions after the same number of shots, so it is a 5 % test at
each look. FILE has one line per practice and kind.
"""

import sys
from collections.abc import Sequence
from dataclasses import replace
from functools import partial

import numpy as np
from scipy.stats import binomtest

import truearc as ta
from benchmarks.worlds import Line, fill_and_tell, read_args
from truearc.cli.common import SHIPPED
from truearc.robot.config.rig_spec import Rig
from truearc.robot.config.schema import load_config
from truearc.sim.compute import keep_compiled
from truearc.sim.discover.detect.always_valid import test_change
from truearc.sim.discover.investigate import discover, follow_shots, make_belief, score_since, told_by_session
from truearc.sim.infer.belief import draw
from truearc.sim.infer.forecast import forecast
from truearc.sim.infer.likelihood.heights import see_heights
from truearc.sim.world.options import Options
from truearc_proof.table import Table
from truearc_proof.truth.generate import shoot
from truearc_proof.truth.world import World, make_world
from truearc_proof.world.season import ORDINARY, plan_season, play_season

PRACTICE, SHOTS = 300, 80
ALARM = 0.05
PLANS = 5                             # plans of shots of which the sessions drawn from one belief are
SAME = "nothing"
CHANGED: dict[str, dict[str, float]] = {"wind 1.5 m/s": {"wind_x": -1.5}, "hood 1.5 deg": {"hood_offset": 1.5}}
SEASONS: dict[str, dict[str, float]] = {
    SAME: {}, "wind 1.5 m/s": {"wind_x_m_s": -1.5}, "hood 1.5 deg": {"hood_offset_deg": 1.5},
    "worn balls": {"ball_radius_scale": 0.98, "ball_friction_scale": 0.85}}
UNCHANGED_SEASONS, CHANGED_SESSIONS = 5, 5     # of each practice
NAMES = {"belief": "drawn from the belief", "robot": "the launcher of the practice", "season": "MuJoCo's launcher"}

Job = tuple[str, int, int]


def run(rig: Rig, job: Job) -> Line:
    """One practice of a kind (kind, seed, sessions): logs to base 10 of the e-values of every session."""
    keep_compiled()
    kind, seed, sessions = job
    if kind == "season":
        return {"kind": kind, "seed": seed, "sessions": _seasons(rig, seed)}
    home = make_world({}, "L1", PRACTICE, seed, side=True)
    belief = make_belief(replace(discover(shoot(home), seed=seed), steps=()))[0]
    if kind == "belief":
        return {"kind": kind, "seed": seed, "sessions": {SAME: _drawn(home, belief, sessions)}}
    found = {SAME: [_robot(home, belief, number, {}) for number in range(sessions)]}
    for name, effects in CHANGED.items():
        found[name] = [_robot(home, belief, number, effects) for number in range(min(CHANGED_SESSIONS, sessions))]
    return {"kind": kind, "seed": seed, "sessions": found}


def _logs(e_value: np.ndarray) -> list[float]:
    return [round(float(one), 3) for one in np.log10(e_value)]


def _robot(home: World, belief: ta.Belief, number: int, effects: dict[str, float]) -> list[float]:
    """A session of the practice's launcher."""
    later = replace(home, seed=home.seed * 1000 + 1 + number, shots=SHOTS, effects=effects)
    return _logs(follow_shots(shoot(later), belief).e_value)


def _drawn(home: World, belief: ta.Belief, sessions: int) -> list[list[float]]:
    """Sessions whose launchers are drawn from the belief, over a few plans of shots."""
    rng = np.random.default_rng([home.seed, 5])
    plans = [shoot(replace(home, seed=home.seed * 1000 + 900 + number, shots=SHOTS)).in_order()
             for number in range(PLANS)]
    tables = [score_since(plan, belief) for plan in plans]
    found, but = [], told_by_session(belief)
    for number, drawn in enumerate(draw(belief, sessions, rng)):
        plan, table = plans[number % PLANS], tables[number % PLANS]
        seen = forecast(plan.rig, drawn, plan.shots)
        target = plan.rig.target
        assert target is not None
        off_m = seen.height_m + seen.sigma_m * rng.normal(size=SHOTS) - target.centre_height_m
        size = np.abs(off_m)
        outcome = np.where(size <= target.three_half_height_m, "three",
                           np.where(size <= target.two_half_height_m, "two", "miss"))
        side = np.where(outcome == "three", "", np.where(off_m < 0.0, "low", "high"))
        texts = {**plan.shots.texts, "outcome": tuple(outcome.tolist()), "side": tuple(side.tolist())}
        marks = see_heights(replace(plan.shots, texts=texts), target)[1]
        assert table is not None and table.plane is not None and len(table.plane.rows) == SHOTS
        marked = replace(table, plane=replace(table.plane, seen=marks))
        found.append(_logs(test_change(marked, but=but).e_value))
    return found


def _seasons(rig: Rig, seed: int) -> dict[str, list[list[float]]]:
    """Sessions of MuJoCo's launcher after its practice."""
    practice = play_season(rig, Options(), seed, plan_season(seed, PRACTICE), "L1", ORDINARY).dataset
    belief = ta.discover(practice, believe=("gravity", "drag", "magnus"), seed=seed).adopt()
    found: dict[str, list[list[float]]] = {}
    for name, options in SEASONS.items():
        count = UNCHANGED_SEASONS if name == SAME else 1
        own = [seed * 100 + 1 + number for number in range(count)]
        played = [play_season(rig, Options(**options), one, plan_season(one, SHOTS), "L1", ORDINARY) for one in own]
        found[name] = [_logs(follow_shots(one.dataset, belief).e_value) for one in played]
    return found


def make_table(lines: Sequence[Line]) -> str:
    """Markdown: the rate over unchanged sessions, and shots until the alarm over changed ones."""
    rates, powers = [], []
    for kind, name in NAMES.items():
        mine = [line["sessions"] for line in lines if line["kind"] == kind]
        if not mine:
            continue
        same = [session for one in mine for session in one[SAME]]
        rates.append([name, f"{len(mine)}, {len(same)}", *(said for alarms in (
            sum(_first(one) is not None for one in same), _naive(same)) for said in (
                f"{alarms}", "{:.1%} ({:.1%} to {:.1%})".format(alarms / len(same), *binomtest(
                    alarms, len(same)).proportion_ci())))])
        for change in dict.fromkeys(key for one in mine for key in one if key != SAME):
            first = [_first(session) for one in mine for session in one[change]]
            shots = sorted(SHOTS + 1 if one is None else one for one in first)
            ends = (shots[(len(shots) - 1) // 2], shots[int(0.9 * (len(shots) - 1))])
            powers.append([name, change, str(len(shots)), f"{sum(one is not None for one in first)}",
                           *(f"{one}" if one <= SHOTS else f"over {SHOTS}" for one in ends)])
    rate = Table(f"Unchanged sessions of {SHOTS} shots, tested after each", (
        "sessions", "practices, sessions", "alarms", "share (95 %)", "alarms of a 5 % test at each look",
        "share (95 %)"), rates).markdown()
    power = Table("Changed sessions", ("sessions", "changed", "sessions", "alarms", "shots to the alarm, median",
                                       "90th percentile"), powers).markdown()
    return "\n\n".join([rate, power])


def _first(logs: Sequence[float]) -> int | None:
    """Number of the shot with the first alarm."""
    above = np.flatnonzero(np.array(logs) >= -np.log10(ALARM))
    return int(above[0]) + 1 if len(above) else None


def _naive(same: Sequence[Sequence[float]]) -> int:
    """Sessions that are among the largest 5 % after any number of shots."""
    shots = min(map(len, same))
    logs = np.array([one[:shots] for one in same])
    rank = (logs[None] >= logs[:, None]).mean(1) if len(same) <= 2000 else np.ones_like(logs)
    return int((rank <= ALARM).any(1).sum())


def main() -> int:
    args = read_args(__doc__, practices=(20, "with sessions of the concealed worlds' engine"),
                     sessions=(50, "unchanged ones of each practice and kind"),
                     seasons=(6, "practices of MuJoCo's launcher"), seed=(700, "of the first practice, and so on"))
    jobs: dict[str, Job] = {f"{kind}/{args.seed + number}/{args.sessions}": (kind, args.seed + number, args.sessions)
                            for number in range(args.practices) for kind in ("belief", "robot")}
    jobs |= {f"season/{args.seed + number}": ("season", args.seed + number, 1) for number in range(args.seasons)}
    return fill_and_tell(args, lambda: jobs, partial(run, load_config(SHIPPED).rig), make_table)


if __name__ == "__main__":
    sys.exit(main())

"""Worlds of benchmarks/adoption.py judged by points: balls that are really aimed by each belief, in the same world."""

import zlib
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import msgspec
import numpy as np
from msgspec import UnsetType

import truearc as ta
from truearc.robot.config.rig_spec import Rig
from truearc.sim.compile_cache import keep_compiled
from truearc.sim.discover.adopt import judge_adoption, make_belief
from truearc.sim.discover.investigate import discover, with_worth
from truearc.sim.infer.belief import Belief
from truearc.sim.metrics import POINTS_THREE, POINTS_TWO
from truearc.sim.world.options import Options
from truearc_proof.table import Table
from truearc_proof.world.practice import plan_season
from truearc_proof.world.season import ORDINARY, ShotSetting, play_season
from truearc_proof.worlds.perturbations import Change

BELIEVED = ("gravity", "drag", "magnus")
BALLS = 60                            # aimed by each belief
DISTANCES_M = np.arange(2.5, 8.01, 0.5)
POINTS = {"three": POINTS_THREE, "two": POINTS_TWO, "miss": 0.0}
SIDES = ("believed", "found", "adopted")

Line = dict[str, Any]


def run_points(rig: Rig, world: tuple[Change, int, int], apart: int) -> Line:
    """One world (its change, shots, seed): worth of adoption by hold-out shots, and points of balls that are aimed by
    the belief without the finding, with all that was found, and by the one that is adopted."""
    keep_compiled()
    change, shots, seed = world
    own = seed + zlib.crc32(change.name.encode()) % (apart - 1)
    options = Options(**change.options)
    seen = play_season(rig, options, own, plan_season(own, shots), "L1", ORDINARY).dataset
    found = with_worth(discover(seen, BELIEVED, seed=own))
    worth = found.finding.adoption
    beliefs = {"believed": make_belief(replace(found, steps=())),
               "found": make_belief(found, judge_adoption(found, threshold=None)),
               "adopted": make_belief(found, found.choice)}
    line: Line = {"name": change.name, "shots": shots, "seed": seed, "verdict": found.finding.verdict,
                  "adopted": beliefs["adopted"][1]["adopted"], "refused": beliefs["adopted"][1].get("refused"),
                  "judged": None if isinstance(worth, UnsetType) else msgspec.to_builtins(worth)}
    places = sorted(one.distance_m for one in plan_season(own + 2, BALLS))
    scored: dict[str, list[float]] = {}
    for side, (belief, provenance) in beliefs.items():
        same = side == "adopted" and provenance["adopted"] == beliefs["found"][1]["adopted"]
        scored[side] = scored["found"] if same else _aimed(rig, options, belief, places, own + 3)
    if not beliefs["adopted"][1]["adopted"]:
        scored["adopted"] = scored["believed"]
    line["points"] = {side: float(np.mean(points)) for side, points in scored.items()}
    line["threes"] = {side: int((np.array(points) == POINTS_THREE).sum()) for side, points in scored.items()}
    return line


def _aimed(rig: Rig, options: Options, belief: Belief, places: Sequence[float], seed: int) -> list[float]:
    """Points of balls from these distances, aimed by a belief; where it has no set point, none."""
    table = ta.aim(belief, rig, distances_m=DISTANCES_M, hood_deg=(32.0, 64.0))
    settings = []
    for place in places:
        try:
            row = table.at(place)
        except ta.InputError:
            continue
        settings.append(ShotSetting(place, row.hood_deg, row.motor_ratio))
    points = [0.0] * len(places)
    if settings:
        outcomes = play_season(rig, options, seed, settings, "L0", ORDINARY).dataset.shots.text("outcome")
        points[:len(outcomes)] = [POINTS[one] for one in outcomes]
    return points


def make_points_table(lines: Sequence[Mapping[str, Any]]) -> str:
    """Markdown: a row per world, and the sums."""
    rows = []
    for one in sorted(lines, key=lambda one: (one["name"], one["seed"])):
        judged, points, threes = one["judged"], one["points"], one["threes"]
        said = "-" if judged is None else (f"{judged['aimed_before']:.2f} -> {judged['aimed_after']:.2f}; together "
                                           f"{judged['gain']:+.2f} ({judged['low90']:+.2f} to {judged['high90']:+.2f})")
        rows.append([one["name"], str(one["seed"]), ", ".join(one["adopted"]) or "nothing", said,
                     *(f"{points[side]:.2f} ({threes[side]})" for side in SIDES)])
    gains = np.array([one["points"]["adopted"] - one["points"]["believed"] for one in lines])
    head = (f"{len(lines)} worlds: {int((gains > 0).sum())} score more by what is adopted, {int((gains < 0).sum())} "
            f"less, mean {gains.mean():+.2f} points per ball")
    header = ("changed", "seed", "adopted", "by hold-out shots, points per ball aimed", *(
        f"aimed by what is {side}: points per ball (threes of {BALLS})" for side in SIDES))
    return Table(head, header, rows).markdown()

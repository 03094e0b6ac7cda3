"""Discovery on the MuJoCo world, whose slip, droop and compression the paper's simulation lacks.

    python -m benchmarks.launcher_world --what as-is,changed --level L1,L2 --worlds 10 --seed 1001 --out FILE
    python -m benchmarks.launcher_world --table FILE

as-is: an unmodified world, baseline as in the paper (gravity, drag, magnus): is the mismatch found, in which stage, by
which terms, and how well does the adopted simulation forecast another session's heights at the plane, beside the
world's shot-to-shot scatter (the same shots with and without it) and beside the fitted baseline.
changed: one thing changed (truearc_proof.worlds.perturbations), compared with the belief adopted from the as-is
session of the same number and, with tracks or --since, since that session. World number N has the seed 1000 N;
development used seeds below 1000.
"""

import sys
import zlib
from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import replace
from functools import partial
from typing import NamedTuple

import msgspec
import numpy as np

from benchmarks.worlds import Line, fill_and_tell, parser_of
from truearc.cli.common import SHIPPED
from truearc.robot.config.rig_spec import Rig
from truearc.robot.config.schema import load_config
from truearc.sim.compile_cache import keep_compiled
from truearc.sim.discover.adopt import make_belief
from truearc.sim.discover.finding import make_json
from truearc.sim.discover.investigate import Investigation, discover
from truearc.sim.infer.belief import Belief, as_table, from_table
from truearc.sim.infer.curve import before_the_shot
from truearc.sim.physics.simulate import predict
from truearc.sim.world.options import Options
from truearc.sim.world.season import Season
from truearc_proof.report.tables import said
from truearc_proof.table import Table
from truearc_proof.world.practice import plan_season
from truearc_proof.world.season import ORDINARY, Sensors, play_season
from truearc_proof.worlds.perturbations import CHANGES, Change, seen_at

BELIEVED = ("gravity", "drag", "magnus")
EXACT = Sensors(0.0, 0.0, 0.0)        # so that heights are missed for the simulation's sake alone
APART = 1000                          # seeds of one number of world from the next's
TARGET = 1.5                          # times the world's own scatter, for the adopted simulation's heights
AS_IS = "as-is"
AS_IS_HEADER = ("level", "seed", "p-value", "verdict", "stage", "names", "heights off before", "adopted", "own scatter",
                "ratio")
CHANGED_HEADER = ("changed", "found", "stage", "first name right", "right name in the set", "verdicts", "first names")


class Job(NamedTuple):
    """A world; change: None, as it is; since: compared with the session before the change."""

    change: Change | None
    level: str
    shots: int
    seed: int
    unseen: int
    since: bool = False

    @property
    def key(self) -> str:
        name = AS_IS if self.change is None else self.change.name
        return f"{name}/{self.level}/{self.shots}/{self.seed}" + "/since" * self.since


def heights_m(season: Season) -> np.ndarray:
    """Where each ball crossed the target's plane [n], in m above the floor; NaN where it fell before it."""
    return np.array([np.nan if one.z_m is None else one.z_m for one in season.results])


def off_m(facts: Rig, belief: Belief, season: Season) -> float:
    """Return the RMS error in m of the heights forecast by the belief from each shot's readings."""
    shots = season.dataset.shots
    around = before_the_shot(belief.curves, facts, shots)
    told = np.asarray(predict(facts, belief.coefficients, shots, circumstances=around).height_m)
    return float(np.sqrt(np.nanmean((heights_m(season) - told)**2)))


def run(facts: Rig, job: Job) -> Line:
    """The world as it is: what was found, and RMS errors in m of heights in a session that nothing was fitted to; or
    with one thing changed, against what the world as it is left."""
    keep_compiled()
    level, shots, seed = job.level, job.shots, job.seed
    home = play_season(facts, Options(), seed, plan_season(seed, shots), level, ORDINARY).dataset
    found = discover(home, BELIEVED, seed=seed)
    after, before = make_belief(found)[0], make_belief(replace(found, steps=()))[0]
    line: Line = {"name": AS_IS, "level": level, "shots": shots, "seed": seed}
    if job.change is not None:
        own = seed + 2 + zlib.crc32(job.change.name.encode()) % (APART - 2)
        dataset = play_season(facts, Options(**job.change.options), own, plan_season(own, shots), level,
                              ORDINARY).dataset
        changed = discover(dataset, seed=own, belief=from_table(as_table(after), job.key),
                           since=home if job.since or level == "L2" else None)
        return {**line, "name": job.change.name, **_said(changed)}
    settings = plan_season(seed + 1, job.unseen)
    other = play_season(facts, Options(), seed + 1, settings, "L0", EXACT)
    still = play_season(facts, Options(scatter_scale=0.0), seed + 1, settings, "L0", EXACT)
    return {**line, **_said(found), "before_m": off_m(facts, before, other), "after_m": off_m(facts, after, other),
            "scatter_m": float(np.nanstd(heights_m(other) - heights_m(still)))}


def _said(found: Investigation) -> Line:
    finding = msgspec.json.decode(make_json(found.finding))
    return {key: finding[key] for key in ("verdict", "sentence", "where", "what", "set", "also", "fit")} | {
        "found": finding["mismatch"]["found"], "p_value": finding["mismatch"]["p_value"]}


def make_tables(lines: Sequence[Line]) -> str:
    """Markdown: the world as it is, one row a world; and changed, one row a change and level."""
    as_is = sorted((one for one in lines if one["name"] == AS_IS), key=lambda one: (one["level"], one["seed"]))
    parts = [_as_is_table(as_is)] if as_is else []
    changed = [one for one in lines if one["name"] != AS_IS]
    for level in sorted({one["level"] for one in changed}):
        rows = [_changed_row(change, mine) for change in CHANGES
                if (mine := [one for one in changed if (one["level"], one["name"]) == (level, change.name)])]
        parts.append(Table(f"Changed, {level}", CHANGED_HEADER, rows).markdown())
    return "\n\n".join(parts)


def _as_is_table(lines: Sequence[Line]) -> str:
    rows = [[one["level"], str(one["seed"]), f"{one['p_value']:.2g}", one["verdict"], str(one["where"]["stage"]),
             ", ".join(map(_name, (one, *one["also"]))),
             *(f"{one[name]:.3f} m" for name in ("before_m", "after_m", "scatter_m")),
             f"{one['after_m'] / one['scatter_m']:.2f}"] for one in lines]
    good = sum(one["after_m"] <= TARGET * one["scatter_m"] for one in lines)
    launch = sum(one["where"]["stage"] == "launch" for one in lines)
    return "\n".join([Table("As it is", AS_IS_HEADER, rows).markdown(), "",
                      f"Adopted within {TARGET} x the own scatter: {good} of {len(lines)}; placed at the launch: "
                      f"{launch} of {len(lines)}."])


def _name(effect: Line) -> str:
    """The first term of an effect with its amplitude, or "unexplained effect"."""
    if not effect["set"] or not effect["what"]:
        return "unexplained effect"
    size = next(iter(effect["what"][0]["parameters"].values()))
    return f"{effect['what'][0]['term']} {size['value']:.3g} {size['unit']}"


def _changed_row(change: Change, lines: Sequence[Line]) -> list[str]:
    found = [one for one in lines if one["found"]]
    first = [one["what"][0]["term"] if one["what"] else "-" for one in found]
    told = [one["set"] or () for one in found]
    marks = [sum(one["where"]["stage"] in change.stages for one in found), sum(name in change.names for name in first),
             sum(bool(set(names) & set(change.names)) for names in told)]
    cells = [f"{mark}/{len(found)}" if change.names else "-" for mark in marks]
    return [change.name, said(len(found), len(lines)), *cells, counted(one["verdict"] for one in lines), counted(first)]


def counted(words: Iterable[str]) -> str:
    """How often each word comes, the commonest first; "-" where there is none."""
    return ", ".join(f"{count} {word}" for word, count in Counter(words).most_common()) or "-"


def main() -> int:
    parser = parser_of(__doc__)
    parser.add_argument("--what", default=AS_IS, choices=(AS_IS, f"{AS_IS},changed"))
    parser.add_argument("--level", default="L1,L2")
    parser.add_argument("--shots", type=int, default=300)
    parser.add_argument("--unseen", type=int, default=200, help="shots of the other session (%(default)s)")
    parser.add_argument("--worlds", type=int, default=10, help="of each kind")
    parser.add_argument("--seed", type=int, default=11, help="of the first number of world; the next has the next")
    parser.add_argument("--only", help="changes, comma-separated; else all")
    parser.add_argument("--since", action="store_true", help="without tracks, too, changes are since the as-is session")
    args = parser.parse_args()

    def plan() -> dict[str, Job]:
        homes = [Job(None, level, args.shots, APART * (args.seed + number), args.unseen)
                 for number in range(args.worlds) for level in args.level.split(",")]
        changed = [home._replace(change=change, since=args.since) for home in homes for change in seen_at(home.level)
                   if args.only is None or change.name in args.only.split(",")]
        return {job.key: job for job in (homes if args.what == AS_IS else [*homes, *changed])}

    return fill_and_tell(args, plan, partial(run, load_config(SHIPPED).rig), make_tables)


if __name__ == "__main__":
    sys.exit(main())

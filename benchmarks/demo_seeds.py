"""Benchmark of the demo over many seeds: how often the name is correct, and how many threes the correction gains.

    python -m benchmarks.demo_seeds --seeds 30 --out FILE
    python -m benchmarks.demo_seeds --game frc-2026 --seeds 10 --out FILE
    python -m benchmarks.demo_seeds --table FILE

Each seed runs the acts of `truearc demo` (truearc.cli.demo_acts): practice, an event for each effect of EVENTS, and the
control, in which nothing has changed. Seasons supply all 300 shots of practice; the robot with images and CAN frames is
omitted. Before and after adoption, the same balls are shot from the same places, and threes of 120 balls are counted.
A second table judges the sizes of changes that were found and that the catalogue has, each over all seeds.
At a game's target where every hit counts the same, hits take the place of threes; the table then also has the share of
lost hits that adoption wins back, for changes that cost a third of the control's hits or more, and the hits that the
set points of all acts foretold.
`significant` is the result of a two-sided test of two proportions over all acts of all seeds, adjusted by Holm's
method. FILE has one line per seed with the outcome of every act; seeds that it already contains are not run again.
Development used seeds below 5030.
"""

import math
import sys
from collections.abc import Sequence
from functools import partial
from typing import NamedTuple

import numpy as np
from scipy.stats import chi2_contingency

from benchmarks.worlds import Line, fill_and_tell, read_args
from truearc.api.results import Effect
from truearc.cli.common import SHIPPED
from truearc.cli.datasets import robot_of_game
from truearc.cli.demo_acts import EFFECTS, NOTHING, Act, Sizes, Volley, WorldChange, play_event, practise
from truearc.robot.config.rig_spec import Rig
from truearc.robot.config.schema import Config, load_config, parse_toml
from truearc.sim.compute import keep_compiled
from truearc.sim.printed import make_text

EVENTS = (NOTHING, *EFFECTS[:4], *EFFECTS[5:7])       # the control, wind, hood, balls, air, camera, rising air
PRACTICE = WorldChange("practice", NOTHING.options, {"wheel_slip": math.nan})     # which the paper's physics lacks
LEVEL, TOGETHER = 0.05, "changed events together"


class Row(NamedTuple):
    """An act of a seed."""

    seed: int
    act: str
    threes: tuple[int, int]           # before and after; hits, where every hit counts the same
    balls: int
    foretold: tuple[float, float]     # hits of any kind, by the set points
    hit: tuple[int, int]
    names: tuple[str, ...]
    terms: tuple[str, ...]            # right ones
    verdict: str


def run(rig: Rig, sizes: Sizes, events: Sequence[WorldChange], seed: int) -> Line:
    """Practice and these events of a seed."""
    keep_compiled()
    practice = practise(rig, seed, sizes, None, lambda done, note: None)
    acts = [_said(PRACTICE, practice)]
    for number, effect in enumerate(events, 1):
        acts.append(_said(effect, play_event(rig, practice, effect.options, seed, number, sizes,
                                             lambda done, note: None)))
    return {"seed": seed, "acts": acts}


def _said(effect: WorldChange, act: Act) -> Line:
    record = act.finding.record
    return {"act": effect.name, "terms": list(effect.terms), "verdict": record.verdict,
            "p_value": record.mismatch.p_value,
            "names": [one.term for one in (act.finding.best, *act.finding.alternatives) if one],
            "sizes": {one.term: size_of(one) for one in (act.finding.best, *act.finding.alternatives) if one},
            "sentence": record.sentence, "shots": len(act.shots.shots),
            "adopted": act.adopted.provenance.get("adopted"), "refused": act.adopted.provenance.get("refused"),
            "coefficients": act.adopted.coefficients, "scatter": act.adopted.scatter,
            "volleys": [one._asdict() for one in act.volleys]}


def size_of(named: Effect) -> tuple[float, float, float]:
    """Return (value, low90, high90) of a change of what was believed, else of the amplitude."""
    size = named.change or next(iter(named.parameters.values()))
    return size.value, size.low90, size.high90


def two_proportions(hits: tuple[int, int], tries: int) -> float:
    """Two-sided p that two shares of equally many tries are equal (Pearson's test); 1 where both are 0 or 1."""
    table = [[one, tries - one] for one in hits]
    return float(chi2_contingency(table, correction=False).pvalue) if 0 < sum(hits) < 2 * tries else 1.0


def holm(p: Sequence[float]) -> list[float]:
    """Adjusted p-values (Holm 1979), in the given order."""
    adjusted, worst = [0.0] * len(p), 0.0
    for rank, place in enumerate(sorted(range(len(p)), key=lambda k: p[k])):
        worst = adjusted[place] = max(worst, min(1.0, (len(p) - rank) * p[place]))
    return adjusted


def make_table(lines: Sequence[Line]) -> str:
    """The table of acts, the events together, and the seeds and acts that differ significantly."""
    volleys = [[Volley(**one) for one in act["volleys"]] for line in lines for act in line["acts"]]
    alike = any(outer == inner for pair in volleys for outer, inner in [pair[0].worth])
    word = "hits" if alike else "threes"
    rows = [_row(line["seed"], act, alike)
            for line in sorted(lines, key=lambda line: line["seed"]) for act in line["acts"]]
    p = holm([two_proportions(row.threes, row.balls) for row in rows])
    adjusted = dict(zip([(row.seed, row.act) for row in rows], p, strict=True))
    groups = {act: [row for row in rows if row.act == act] for act in dict.fromkeys(row.act for row in rows)}
    changed = [row for row in rows if row.act in {effect.name for effect in EVENTS if effect is not NOTHING}]
    groups = {**{act: kept for act, kept in groups.items() if act != NOTHING.name}, TOGETHER: changed,
              NOTHING.name: groups.get(NOTHING.name, [])}
    head = ("", f"{word} before", "after", "of balls", "ratio", "right name in set", "first", "mean set",
            "not named", "more", "fewer")
    table = make_text(head, [_cells(act, kept, adjusted) for act, kept in groups.items() if kept], right=range(1, 11))
    silent = [row.verdict == "none" for row in rows if row.act == NOTHING.name]
    seeds = sorted({row.seed for row in rows})
    said = [f"{len(seeds)} seeds, {seeds[0]} to {seeds[-1]}; more, fewer: seeds with significantly more or fewer "
            f"{word} after adoption (5 %, Holm, {len(rows)} tests)", *table,
            f"control without an alarm: {sum(silent)} of {len(silent)}", *(_won_back(rows) if alike else ())]
    each = [f"{act}: " + ", ".join(f"{row.threes[0]}->{row.threes[1]}" for row in kept)
            for act, kept in groups.items() if act != TOGETHER]
    sizes = make_text(("changed", "", "seeds", "in the set", "90 % interval holds", "RMS error", "mean"),
                      _size_rows(lines), right=range(1, 7))
    return "\n".join([*said, *sizes, f"{word} before -> after, per seed:", *each])


def _size_rows(lines: Sequence[Line]) -> list[tuple[str, ...]]:
    """Of each changed event with a term, how its size was stated where the set has the term."""
    rows = []
    for effect in EVENTS:
        acts = [act for line in lines for act in line["acts"] if act["act"] == effect.name]
        stated = [act["sizes"] for act in acts if "sizes" in act]      # older lines lack them
        for term, truth in list(effect.terms.items())[:1] if stated else ():
            value, low, high = np.reshape([one[term] for one in stated if term in one], (-1, 3)).T
            rms, mean = (f"{np.sqrt(np.mean((value - truth)**2)):.2g}", f"{value.mean():.3g}") if value.size else "--"
            rows.append((effect.name, f"{truth:g}", str(len(stated)), str(value.size),
                         str(np.sum((low <= truth) & (truth <= high))), rms, mean))
    return rows


def _row(seed: int, act: Line, alike: bool) -> Row:
    before, after = (Volley(**one) for one in act["volleys"])
    full = (before.twos, after.twos) if alike else (before.threes, after.threes)
    return Row(seed, act["act"], full, before.balls, (before.foretold, after.foretold),
               (before.threes + before.twos, after.threes + after.twos), tuple(act["names"]), tuple(act["terms"]),
               act["verdict"])


def _won_back(rows: Sequence[Row]) -> list[str]:
    """The share of lost hits that was won back, and hits foretold and seen by set points of a believed world."""
    usual = {row.seed: row.threes[0] for row in rows if row.act == NOTHING.name}
    costly = [(usual[row.seed] - row.threes[0], row.threes[1] - row.threes[0]) for row in rows
              if row.act not in (NOTHING.name, PRACTICE.name) and row.seed in usual
              and 3 * (usual[row.seed] - row.threes[0]) >= usual[row.seed]]
    lost, won = (sum(part) for part in zip(*costly, strict=True)) if costly else (0, 0)
    known = [row for row in rows if row.act in (NOTHING.name, PRACTICE.name)]
    foretold, seen, balls = (sum(part) for part in zip(*((row.foretold[1], row.hit[1], row.balls) for row in known),
                                                      strict=True)) if known else (0.0, 0, 1)
    return [f"changes that cost a third of the hits or more: {len(costly)}; {won} of {lost} lost hits won back"
            + (f" ({won / lost:.0%})" if lost else ""),
            f"hits after practice and in the control: {foretold / balls:.1%} foretold, {seen / balls:.1%} seen"]


def _cells(act: str, rows: Sequence[Row], adjusted: dict[tuple[int, str], float]) -> tuple[str, ...]:
    before, after = (sum(row.threes[k] for row in rows) for k in (0, 1))
    with_term = [row for row in rows if row.terms]
    right, first = (f"{sum(hits)} of {len(with_term)}" if with_term else "" for hits in (
        [bool(set(row.names) & set(row.terms)) for row in with_term], [row.names[:1] != () and row.names[0] in row.terms
                                                                      for row in with_term]))
    sets = [row.names for row in with_term if row.names]
    clear = [row for row in rows if adjusted[row.seed, row.act] < LEVEL]
    return (act, str(before), str(after), str(sum(row.balls for row in rows)), f"{after / max(before, 1):.2f}", right,
            first, f"{sum(map(len, sets)) / max(len(sets), 1):.1f}" if with_term else "",
            str(sum(not row.names for row in rows)), str(sum(row.threes[1] > row.threes[0] for row in clear)),
            str(sum(row.threes[1] < row.threes[0] for row in clear)))


def main() -> int:
    args = read_args(__doc__, seeds=30, first=(1000, "seed; the next is one more"),
                     quick=(False, "a few of the shots, and one event: to try this script"),
                   game=("", "as of `truearc demo`: shoot at the target of that game"))
    rig = load_config(SHIPPED).rig if not args.game else parse_toml(
        robot_of_game(SHIPPED.read_text(encoding="utf-8"), args.game), Config, args.game).rig
    sizes, events = (Sizes(16, 0, 12, 4), EVENTS[1:2]) if args.quick else (Sizes(), EVENTS)
    jobs = {f"{seed}/{sizes.practice}{args.game}": seed for seed in range(args.first, args.first + args.seeds)}
    return fill_and_tell(args, lambda: jobs, partial(run, rig, sizes, events), make_table)


if __name__ == "__main__":
    sys.exit(main())

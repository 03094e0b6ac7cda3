"""Benchmark of discovery on foreign seasons, where the believed physics is slightly wrong and one thing changes.

    python -m benchmarks.seasons --seed 21000 --seasons 60 --level L1 --out FILE
    python -m benchmarks.seasons --table FILE

A change should be found, named and sized, and nothing else. A robot with several small errors of the believed physics
(SMALL_ERRORS of truearc_proof.truth.world), constant over the season, practises 300 shots. What discovery adopts from
them is the belief at events of 80 shots, with `since`. Before an event, one thing has changed, in either direction, or
nothing. The data are telemetry and outcomes with the sides of misses (L1), or also tracks (L2). FILE has one line per
season, with its events. Development used seeds from 20000 to 20099.
"""

import sys
import time
from collections import Counter
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import replace
from functools import partial
from typing import Any

import msgspec
import numpy as np
from scipy.stats import binomtest

import truearc as ta
from benchmarks.worlds import Line, fill_and_tell, read_args
from truearc.sim.compute import keep_compiled
from truearc.sim.discover.investigate import make_belief
from truearc_proof.rounds.marks import Measured, change_of, in_catalogue, mark, off_m, shoot_unseen
from truearc_proof.rounds.worlds import FOREIGN, FOREIGN_CHANGES, Drawn
from truearc_proof.table import make_markdown
from truearc_proof.truth.generate import foreign_robot, shoot

NOTHING, CHANGES = "nothing", dict(FOREIGN_CHANGES)
KEPT = ("verdict", "sentence", "mismatch", "where", "what", "set", "also", "unexplained")     # of a finding
HEAD = ("level", "changed", "seasons", "found", "one name, wrong", "set holds the truth, of those found",
        "90 % interval holds the change", "RMS error", "stated deviation", "processor s")

Job = tuple[str, int, tuple[str, ...]]     # level, seed and changes of a season


def run(shots: tuple[int, int], job: Job) -> Line:
    """What is found in a season's practice, and at each of its events."""
    keep_compiled()
    level, seed, changes = job
    practice = shoot(foreign_robot(seed, level, *shots, {})[0])
    found, line = _asked(practice, seed=seed)
    before = belief = make_belief(replace(found.investigation, steps=()))[0]
    with suppress(ta.InputError):     # where nothing can be adopted, what was believed stays, as fitted
        belief = found.adopt()
    unseen = shoot_unseen(Drawn("", FOREIGN, "clean", level, shots[0], seed))
    assert unseen is not None
    events = {name: _asked(shoot(foreign_robot(seed, level, *shots, size_of(seed, name))[1]), belief=belief,
                           since=practice, seed=seed)[1] for name in changes}
    return {"level": level, "seed": seed, "shots": shots, "practice": line, "events": events,
            "adopted": belief.provenance.get("adopted"), "off_m": [off_m(one, unseen) for one in (before, belief)]}


def size_of(seed: int, name: str) -> dict[str, float]:
    """Return a season's change: its sign follows from the season's seed."""
    sign = np.random.default_rng([seed, 11, sum(name.encode())]).choice((-1.0, 1.0))
    return {} if name == NOTHING else {name: float(sign * CHANGES[name])}


def _asked(shots: ta.Dataset, **known: Any) -> tuple[ta.Finding, Line]:
    began, found = time.process_time(), ta.discover(shots, **known)
    finding = msgspec.json.decode(found.to_json())
    finding["mismatch"]["tests"] = {}
    return found, {"seconds": time.process_time() - began, **{key: finding.get(key) for key in KEPT}}


def make_table(lines: Sequence[Line]) -> str:
    """Markdown: a row for each level and change, with exact 95 % intervals (Clopper and Pearson 1934)."""
    there = {(line["level"], name): None for line in lines for name in line["events"]}
    rows = [_row(level, name, [line for line in lines if line["level"] == level and name in line["events"]])
            for level, name in there]
    adopted = Counter(" + ".join(line["adopted"] or ()) or "nothing" for line in lines)
    before, after = (np.median([line["off_m"][k] for line in lines]) for k in range(2))
    return "\n\n".join([
        make_markdown(HEAD, rows),
        "Adopted of practice: " + "; ".join(f"{name} ({count})" for name, count in adopted.most_common()) + ".",
        f"RMS error of heights in another session: {before:.3f} m, with what was adopted {after:.3f} m (medians)."])


def _row(level: str, name: str, lines: Sequence[Line]) -> list[str]:
    marks, sizes = [], []             # sizes: (value, low90, high90, truth) of changes in their sets
    for line in lines:
        change, finding = size_of(line["seed"], name), line["events"][name]
        drawn = Drawn("", FOREIGN, "one" if change else "clean", level, line["shots"][1], line["seed"], change)
        marks.append(mark(drawn, finding, Measured()))
        for effect, amount in change.items() if marks[-1].covered else ():
            parameter, truth = in_catalogue(effect, amount) or ("", 0.0)
            given = change_of(next((each for each in finding["what"] if each["term"] == effect), {}), parameter)
            sizes += [(*given, truth)] if given else []
    found = [one for one in marks if one.found]
    value, low, high, truths = np.reshape(sizes, (-1, 4)).T
    off = (f"{np.sqrt(np.mean((value - truths)**2)):.2g}", f"{np.mean(high - low) / 3.29:.2g}") if sizes else ("-", "-")
    return [level, name, str(len(marks)), _share([one.found for one in marks]),
            _share([not one.first for one in found if one.verdict == "named"]),
            _share([bool(one.covered) for one in found if one.right]), _share((low <= truths) & (truths <= high)),
            *off, f"{np.mean([line['events'][name]['seconds'] for line in lines]):.1f}"]


def _share(answers: Sequence[bool] | np.ndarray) -> str:
    yes, of = int(np.sum(answers)), len(answers)
    return "{} of {} ({:.2f} to {:.2f})".format(yes, of, *binomtest(yes, of).proportion_ci()) if of else "-"


def main() -> int:
    args = read_args(__doc__, seed=(20000, "of the first season; the next has the next"), seasons=4, level="L1",
                     changes=(",".join((NOTHING, *CHANGES)), "before the events, comma-separated"),
                     practice=(300, "shots"), event=(80, "shots"))
    changes, shots = tuple(args.changes.split(",")), (args.practice, args.event)
    if set(changes) - {NOTHING, *CHANGES}:
        raise SystemExit(f"--changes {args.changes}: there are {NOTHING}, {', '.join(CHANGES)}")
    seeds = range(args.seed, args.seed + args.seasons)
    return fill_and_tell(args, lambda: {f"{level}/{seed}/{args.practice}/{args.event}/{args.changes}":
                                        (level, seed, changes) for seed in seeds for level in args.level.split(",")},
                         partial(run, shots), make_table)


if __name__ == "__main__":
    sys.exit(main())

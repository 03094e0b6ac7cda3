"""Benchmark of the sizes that `truearc identifiability` states: the share of such effects that discovery reports.

    python -m benchmarks.power --level L1 --worlds 8 --seed 730 --out FILE
    python -m benchmarks.power --table FILE

For a world without a hidden effect, `truearc identifiability` states how large each effect must be to be reported four
times in five (`smallest`). One effect of exactly that size is then hidden in the same world, and discovery's test is
made at 5 %; between 70 and 90 % of the effects should be reported. Effects that must exceed twice their usual size are
omitted, because the statement assumes that scores are linear in the size.
"""

import sys
from collections.abc import Sequence
from functools import partial

import numpy as np

from benchmarks.worlds import Line, fill_and_tell, read_args
from truearc.sim.compute import keep_compiled
from truearc.sim.discover.finding import FALSE_ALARM
from truearc.sim.discover.identifiability import sight_of
from truearc.sim.discover.investigate import detect, make_search
from truearc.sim.infer.fit import fit_believed
from truearc.sim.infer.launcher import Launcher
from truearc.sim.printed import make_text
from truearc_proof.rounds.marks import in_catalogue
from truearc_proof.rounds.worlds import names_at
from truearc_proof.truth.generate import shoot
from truearc_proof.truth.world import BELIEVED, find_effect, make_world

LARGEST = 2.0                         # times the usual size
TURNS = 4                             # worlds by which each effect is hidden once


def run(level: str, shots: int, seed: int) -> Line:
    """One world: {effect: whether discovery reports it at the size that would be seen four times in five}."""
    keep_compiled()
    still = shoot(make_world({}, level, shots, seed))
    sight = sight_of(fit_believed(Launcher.of(still, BELIEVED)).scores, level, ())
    smallest = {one.term: (one.smallest, one.usual) for one in sight.terms}
    found: dict[str, bool] = {}
    for place, name in enumerate(sorted(names_at("effects", level))):
        effect = find_effect(name)
        known = in_catalogue(name, effect.typical)
        size, usual = smallest.get(name, (None, 0.0))
        if place % TURNS != seed % TURNS or known is None or size is None or size > LARGEST * usual:
            continue
        sign = -1.0 if effect.signed and seed // TURNS % 2 else 1.0
        world = shoot(make_world({name: sign * effect.typical * size / abs(known[1])}, level, shots, seed))
        _, judged = detect(fit_believed(Launcher.of(world, BELIEVED)), make_search(world), lambda done, note: None)
        found[name] = judged.p_any <= FALSE_ALARM
    return {"level": level, "shots": shots, "found": found}


def make_table(lines: Sequence[Line]) -> str:
    """Shares by level, with how uncertain they are (one standard error), and by effect."""
    rows = []
    for level in sorted({line["level"] for line in lines}):
        by_name: dict[str, list[bool]] = {}
        for line in lines:
            for name, found in line["found"].items() if line["level"] == level else ():
                by_name.setdefault(name, []).append(found)
        every = [found for each in by_name.values() for found in each]
        share = float(np.mean(every)) if every else float("nan")
        error = np.sqrt(share * (1.0 - share) / max(len(every), 1))
        low = ", ".join(f"{name} {sum(each)}/{len(each)}" for name, each in sorted(by_name.items())
                        if np.mean(each) < 0.5)
        rows.append((level, str(len(every)), f"{share:.2f} ± {error:.2f}", low or "-"))
    return "\n".join(make_text(("level", "effects hidden", "reported", "less than half"), rows, right=(1, 2)))


def main() -> int:
    args = read_args(__doc__, level="L1", worlds=8, shots=300, seed=730)
    return fill_and_tell(args, lambda: {f"{args.level}/{args.shots}/{seed}": seed
                                        for seed in range(args.seed, args.seed + args.worlds)},
                         partial(run, args.level, args.shots), make_table)


if __name__ == "__main__":
    sys.exit(main())

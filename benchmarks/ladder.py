"""How plain each hidden effect is at its usual size, by level: the lambda of 300 shots in
proof/truearc_proof/truth/ladder.toml.

    python -m benchmarks.ladder --worlds 5 > proof/truearc_proof/truth/ladder.toml

Lambda is the chi-squared by which the data speak of the effect once the fitted numbers have taken what they can, from
the information in worlds that hide nothing. Concealed worlds have their sizes by it
(truearc_proof.rounds.worlds), so that worlds of different effects and levels are equally hard; it is a table,
so that the truth shares no code with what is tested.
"""

import argparse
import sys
from dataclasses import replace

import numpy as np

from benchmarks.worlds import Job, true_parameter, world_of
from truearc.sim.compute import keep_compiled
from truearc.sim.discover.select.terms import efficient, one_step
from truearc.sim.infer.fit import fit_believed
from truearc.sim.infer.launcher import Launcher
from truearc.sim.infer.likelihood.score_table import ScoreTable
from truearc_proof.rounds.marks import strength_of
from truearc_proof.truth.generate import shift_m, shoot
from truearc_proof.truth.world import ABSORBED, BELIEVED, EFFECTS, LEVELS, World

SHOTS = 300


def lambdas(level: str, worlds: int, seed: int, shots: int) -> dict[str, float]:
    """{effect: mean lambda at its usual size}; of what the data show and, below L2, of what is in no catalogue."""
    found: dict[str, list[float]] = {}
    for index in range(worlds):
        world = world_of(Job("nulls", "clean", level, shots, 0.0, seed, index))
        dataset = shoot(world)
        evidence = fit_believed(Launcher.of(dataset, BELIEVED)).scores
        columns = np.array([one.column for one in one_step(evidence)[0] if one.visible], dtype=int)
        left = np.diag(efficient(evidence, columns)[1])
        information = {evidence.columns[k].name: float(value) for k, value in zip(columns, left, strict=True)}
        for effect in EFFECTS:
            wanted = true_parameter(Job("effects", effect.name, level, shots, 1.0, seed, 0))
            if effect.name in ABSORBED:
                continue
            if wanted is not None and f"{effect.name}.{wanted[0]}" in information:
                found.setdefault(effect.name, []).append(information[f"{effect.name}.{wanted[0]}"] * wanted[1]**2)
            elif wanted is None and level != "L2":
                found.setdefault(effect.name, []).append(_of_heights(world, effect.name, effect.typical, evidence))
        print(f"{level}: {index + 1} of {worlds} worlds", file=sys.stderr)
    return {name: float(np.mean(values)) for name, values in found.items()}


def _of_heights(world: World, name: str, typical: float, evidence: ScoreTable) -> float:
    """Lambda of what no catalogue has, where outcomes are all there is."""
    return strength_of(evidence, shift_m(replace(world, effects={name: typical}))) or 0.0


def main() -> int:
    args = _arguments()
    keep_compiled()
    print(f"# lambda of {args.shots} shots at each effect's usual size: "
          f"benchmarks/ladder.py --worlds {args.worlds} --seed {args.seed}")
    for level in LEVELS:
        print(f"\n[{level}]")
        for name, value in lambdas(level, args.worlds, args.seed, args.shots).items():
            print(f"{name} = {value:.3g}")
    return 0


def _arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--worlds", type=int, default=5, help="of every level")
    parser.add_argument("--shots", type=int, default=SHOTS, help="of each world (%(default)s)")
    parser.add_argument("--seed", type=int, default=21, help="of worlds that nothing else is counted on")
    return parser.parse_args()


if __name__ == "__main__":
    sys.exit(main())

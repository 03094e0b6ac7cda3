"""Run time of discovery as a function of the number of shots and the size of the catalogue.

    python -m benchmarks.discovery_speed [--shots 100,300,1000] [--level L1] [--seed 5]

Each figure is the time of the second run at that size, after all code has been compiled. Detection is measured from
data in memory to a p-value; the report, from data in memory to the HTML page, for a world with an effect that is found
and named (wheel droop).
"""

from benchmarks.grid_fit import fastest
from benchmarks.options import read_options
from truearc.sim.compute import keep_compiled
from truearc.sim.data.dataset import Dataset
from truearc.sim.discover.investigate import detect, discover, make_search
from truearc.sim.discover.report.pages import make_report
from truearc.sim.infer.fit import fit_believed
from truearc.sim.infer.launcher import Launcher
from truearc.sim.physics.catalogue import BUILT_IN, TERMS, Catalogue
from truearc_proof.truth.generate import shoot
from truearc_proof.truth.world import make_world

EFFECT = {"wheel_droop": 0.05}
SIZES = (8, 20, len(TERMS))           # tested terms, besides those of the baseline


def detection(dataset: Dataset, catalogue: Catalogue = BUILT_IN) -> None:
    """Everything that detection takes."""
    fitted = fit_believed(Launcher.of(dataset, dataset.facts.believe.terms, catalogue))
    detect(fitted, make_search(dataset), lambda done, note: None)


def smaller(believed: tuple[str, ...], count: int) -> Catalogue:
    """Return the baseline's terms, those of the tracker, and the first `count` others."""
    fixed = {*believed, "track_scale", "track_tilt", "track_clock"}
    others = [term.name for term in TERMS if term.name not in fixed][:count]
    return Catalogue(tuple(term for term in TERMS if term.name in fixed or term.name in others))


def main() -> None:
    args = read_options(__doc__, shots="100,300,1000", level="L1", seed=5)
    keep_compiled()
    print("| shots | terms | detection, s (processor) | report, s (processor) |\n|---|---|---|---|", flush=True)
    for shots in map(int, args.shots.split(",")):
        dataset = shoot(make_world(EFFECT, args.level, shots, args.seed))
        for count in SIZES if shots == 300 else SIZES[-1:]:
            catalogue = smaller(dataset.facts.believe.terms, count)
            found = fastest(lambda dataset=dataset, catalogue=catalogue: detection(dataset, catalogue), 1)
            whole = "" if len(catalogue.terms) < len(TERMS) else "{:.1f} ({:.1f})".format(
                *fastest(lambda dataset=dataset: make_report(dataset.name, discover(dataset)), 1))
            print(f"| {shots} | {len(catalogue.terms)} | {found[0]:.2f} ({found[1]:.2f}) | {whole} |", flush=True)


if __name__ == "__main__":
    main()

"""Check a dataset before anything is fitted: whether it can be read, is plausible, and which effects it could show.

With fewer than ten shots, a season of them is planned for the rig.
"""

import argparse
import shlex
from pathlib import Path

import truearc as ta
from truearc.cli.common import add_accept, listed, make_progress, number
from truearc.errors import about

EXAMPLE = "truearc check shots/"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Arguments of the command."""
    parser.add_argument("dataset", metavar="DIR", help="dataset directory")
    parser.add_argument("--believe", type=listed(str), metavar="TERMS", help="terms of the simulation, "
                        "comma-separated; else rig.toml's")
    add_accept(parser)
    parser.add_argument("--seed", type=number(int, 0), help="of the season that is planned without "
                        "shots, or of where shots without results pass")


def main(args: argparse.Namespace) -> int:
    """Return 0 where the dataset is plausible."""
    from truearc.sim.compile_cache import keep_compiled
    from truearc.sim.discover.report.pages import sight_summary
    from truearc.sim.infer.plausibility.check import check_plausible
    keep_compiled()
    from truearc.sim.infer.likelihood.data import FEWEST_SHOTS, say_few
    dataset = check_plausible(ta.load_dataset(args.dataset), args.accept)
    print("\n".join([*dataset.lines(), *ranges(dataset), *plausibility(dataset)]))
    few = len(dataset.shots) < FEWEST_SHOTS
    for line in lacking(dataset):
        print(f"warning: {line}")
    if few and dataset.rig.target is None:
        print(f"warning: {say_few(len(dataset.shots))}; no season can be planned: rig.toml has no [target]")
        return 0
    with about(args.dataset):
        could = ta.identifiability(dataset.rig if few else dataset, believe=args.believe, seed=args.seed,
                                   accept=args.accept, progress=make_progress("check", args.quiet))
    if few:
        print(f"warning: {say_few(len(dataset.shots))}" if len(dataset.shots) else "\nno shots yet", end="")
    print("; of a season with this rig:" if few else "")
    print("\n".join([*sight_summary(could.sight, could.catalogue), f"effect by effect: {by_effect(args, few)}"]))
    return 0


def by_effect(args: argparse.Namespace, few: bool) -> str:
    """Return the command that lists what each effect needs."""
    asked = [args.dataset if not few else str(Path(args.dataset) / "rig.toml")]
    asked += ["--believe", ",".join(args.believe)] if args.believe else []
    return shlex.join(["truearc", "identifiability", *asked])


def lacking(dataset: "ta.Dataset") -> list[str]:
    """Return what no shot states of its own settings and results, where there are no tracks or times."""
    from truearc.sim.data.columns import WHEEL
    known = {name for name, column in dataset.shots.numbers.items() if (column == column).any()}
    known |= {"wheel_<name>_rad_s" for name in known if WHEEL.fullmatch(name)}
    known |= {"outcome"} if any(dataset.shots.text("outcome")) else set()
    found = ((("distance_m",), "distance to the target"), (("hood_deg", "exit_deg"), "elevation"),
             (("motor_ratio", "exit_speed_m_s", "wheel_<name>_rad_s"), "speed"),
             (("outcome", "miss_height_m"), "result"))
    asked = found if len(dataset.shots) and not {"tracks", "times"} & set(dataset.samples) else ()
    return [f"{dataset.shots.source}: {' or '.join(names)}: no shot states its {what}" for names, what in asked
            if not known & set(names)]


def ranges(dataset: "ta.Dataset") -> list[str]:
    """Return a line per column of numbers: lowest to highest, and in how many shots it is missing."""
    import numpy as np
    lines = []
    for name, column in dataset.shots.numbers.items():
        known = column[np.isfinite(column)]
        if len(known):
            absent = len(column) - len(known)
            lines.append(f"  {name:20s} {known.min():g} to {known.max():g}"
                         + (f", missing in {absent} shot{'s' * (absent != 1)}" if absent else ""))
    return lines


def plausibility(dataset: "ta.Dataset") -> list[str]:
    """Return what the plausibility checks of a dataset that passed them have to say."""
    from truearc.sim.infer.plausibility.check import SCORES, judges_reach
    objections = [f"warning: {objection}" for objection in dataset.accepted] or ["plausible: every check passed"]
    flights = {"tracks", "times"} & set(dataset.samples)
    unjudged = [("tracks.csv", "gravity, axes, units of length and time", not flights),
                (f"{SCORES} scoring shots of known distance, angle and speed",
                 "distances, angles and speeds by each other", not flights and not judges_reach(dataset))]
    return objections + [f"  not checked without {needed}: {what}" for needed, what, missing in unjudged if missing]

"""truearc design: the next shots, or the measurement, that would tell the remaining names apart."""

import argparse
from typing import TYPE_CHECKING, Any

from truearc.cli.discover.discover import believed_terms, check_place, home_of, write_out
from truearc.cli.terms_from import add_terms_from, catalogue_of
from truearc.robot.config.schema import InputError
from truearc.sim.discover.settings import CONFIGURATIONS, FALSE_ALARM, LEAST_FALSE_ALARM, PLANNED_SHOTS

if TYPE_CHECKING:
    from truearc.sim.data.dataset import Dataset, Shots
    from truearc.sim.discover.plan.experiment_design import Block, Design
    from truearc.sim.discover.select.selection_step import Step
    from truearc.sim.physics.catalogue import Catalogue

DESCRIPTION = """Say which shots, of those that the robot can take, or which measurement would best tell apart the names
that discover leaves, and how likely they are to."""
EXAMPLE = "truearc design shots/ --shots 100 --json next.json"
SCHEMA = "truearc.design/1"
# How a shot must be like the one it is named after, where a name that competes follows a circumstance.
AS_THEN = {"age": "a ball that has been shot as often", "ball": "the same ball", "droop": "wheels that dip as far",
           "closing_speed_m_s": "the robot driving as fast", "battery": "the battery as full", "density": "air as warm",
           "hood_change": "the hood coming from the same side"}
SETTINGS = ("distance_m", "hood_deg", "motor_ratio", "exit_speed_m_s", "exit_deg")


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Arguments of the command."""
    parser.add_argument("dataset", metavar="DIR", help="dataset directory")
    parser.add_argument("--believe", metavar="TERMS", help="terms of the simulation, comma-separated; else rig.toml's")
    parser.add_argument("--belief", metavar="FILE", help="coefficients.toml of this very rig from an earlier session, "
                        "as in discover")
    parser.add_argument("--since", metavar="DIR", help="dataset that --belief was adopted from, as in discover")
    add_terms_from(parser)
    parser.add_argument("--shots", type=int, default=PLANNED_SHOTS, metavar="N",
                        help="shots to plan (default %(default)s)")
    parser.add_argument("--configurations", type=int, default=CONFIGURATIONS, metavar="K",
                        help="that they are shared out to (default %(default)s)")
    parser.add_argument("--false-alarm", type=float, default=FALSE_ALARM, metavar="P", help="as in discover")
    parser.add_argument("--json", metavar="FILE", help="write the plan as JSON")
    parser.add_argument("--seed", type=int, default=0, help="of everything drawn at random (default %(default)s)")


def main(args: argparse.Namespace) -> int:
    """Return 0 whether or not there is anything to tell apart."""
    import msgspec

    from truearc.cli.progress import make_progress
    from truearc.sim.compile_cache import keep_compiled
    from truearc.sim.data.dataset import load_dataset
    from truearc.sim.discover.api import discover
    from truearc.sim.discover.plan.experiment_design import can_design, make_design
    from truearc.sim.infer.belief import load_belief
    if not 1 <= args.configurations <= args.shots:
        raise InputError(f"--shots {args.shots}, --configurations {args.configurations}: at least one shot each")
    if args.seed < 0 or not LEAST_FALSE_ALARM <= args.false_alarm < 1.0:
        raise InputError(f"--seed cannot be negative, --false-alarm is between {LEAST_FALSE_ALARM} and 1")
    check_place(args.json)
    among = catalogue_of(args)
    believed, belief = believed_terms(args, among), None if args.belief is None else load_belief(args.belief, among)
    keep_compiled()
    dataset = load_dataset(args.dataset)
    found = discover(dataset, believed, args.false_alarm, args.seed, make_progress("design", args.quiet), belief,
                     home_of(args, dataset), terms=among)
    print(found.finding.sentence)
    table: dict[str, Any] = {"schema": SCHEMA, "verdict": found.finding.verdict, "next": []}
    if found.steps and can_design(found.steps[0]):
        step = found.steps[0]
        table |= as_table(make_design(step, args.shots, args.configurations, args.seed), dataset, step, among)
        print("\n".join(lines_of(table, among)))
    else:
        print("There are no names to tell apart by shots.")
    if args.json:
        write_out(args.json, msgspec.json.format(msgspec.json.encode(table), indent=1) + b"\n")
    return 0


def as_table(design: "Design", dataset: "Dataset", step: "Step", among: "Catalogue | None" = None) -> dict[str, Any]:
    """The --json output, besides schema and verdict; `next` as in truearc.finding/1. among: the catalogue."""
    from truearc.sim.physics.catalogue import find_terms
    names = [name.partition(".")[0] for name in design.names]
    rows = step.fitted.evidence.rows
    shoot = [{"do": "shoot", **_settings(dataset.shots, int(rows[block.row]), block.pace), "shots": block.shots,
              "separates": names}
             for block in _together(design.blocks)]
    measure = [{"do": "measure", "what": one.what, "separates": list(one.terms), "probability": one.probability}
               for one in design.measurements]
    follow = [term.follows for term in find_terms(names, among)]
    return {"names": dict(zip(names, map(float, design.probability), strict=True)),
            "as_then": [AS_THEN[one] for one in dict.fromkeys(follow) if one in AS_THEN],
            "probability_before": design.before, "probability_after": design.after,
            "random_shots_worth_as_much": design.random, "next": shoot + measure}


def lines_of(table: dict[str, Any], among: "Catalogue | None" = None) -> list[str]:
    """The plan as text; among: the catalogue of the terms."""
    from truearc.sim.discover.plan.experiment_design import MOST_RANDOM
    from truearc.sim.discover.report.effect_wording import plain
    names = ", ".join(f"{plain(name, among)} ({share:.0%})" for name, share in table["names"].items())
    shoot = [one for one in table["next"] if one["do"] == "shoot"]
    total = sum(one["shots"] for one in shoot)
    lines = [f"To tell apart: {names}."]
    for one in shoot:
        where = ", ".join(f"{name} {value:.4g}" for name, value in one.items() if name in SETTINGS)
        pace = one.get("pace", 1.0)
        wheels = "" if pace == 1.0 else f", wheels {abs(pace - 1.0):.0%} {'faster' if pace > 1.0 else 'slower'}"
        lines.append(f"  {one['shots']:4d} shots at {where} (as shot {one['like']}{wheels})")
    if table["as_then"]:
        lines.append(f"As then also with {', '.join(table['as_then'])}: a name that is left follows that.")
    random = table["random_shots_worth_as_much"]
    worth = f"more than {MOST_RANDOM} times as many as there are" if random is None else f"{random}"
    lines.append(f"After these {total} shots the right one stands alone (95 % sure) with a probability of "
                 f"{table['probability_after']:.0%}, now {table['probability_before']:.0%}; of shots like the present "
                 f"ones it would take {worth} to part them as well.")
    lines += [f"Or measure {one['what']}: {one['probability']:.0%}." for one in table["next"] if one["do"] == "measure"]
    return lines


def _together(blocks: "tuple[Block, ...]") -> "list[Block]":
    """Blocks of one configuration as one."""
    from truearc.sim.discover.plan.experiment_design import Block
    shots: dict[tuple[int, float], int] = {}
    for block in blocks:
        place = block.row, block.pace
        shots[place] = shots.get(place, 0) + block.shots
    return [Block(row, count, pace) for (row, pace), count in shots.items()]


def _settings(shots: "Shots", row: int, pace: float) -> dict[str, Any]:
    driven = {"motor_ratio", "exit_speed_m_s", *_wheels(shots)}
    known = {name: float(shots.number(name)[row]) * (pace if name in driven else 1.0)
             for name in (*SETTINGS, *_wheels(shots))}
    like = {"like": shots.shot_id[row], **({} if pace == 1.0 else {"pace": pace})}
    return {**like, **{name: round(value, 4) for name, value in known.items() if value == value}}


def _wheels(shots: "Shots") -> list[str]:
    return [name for name in shots.numbers if name.startswith("wheel_") and name.endswith("_rad_s")]

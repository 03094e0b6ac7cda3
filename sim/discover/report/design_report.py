"""A plan of further shots as text and as plain values (truearc.design/1)."""

from collections import Counter
from dataclasses import replace
from typing import Any

from truearc.sim.data.dataset import Dataset, Shots
from truearc.sim.discover.plan.experiment_design import MOST_RANDOM, Block, Design
from truearc.sim.discover.report.effect_wording import WORDING, plain
from truearc.sim.discover.select.name_effects import Step
from truearc.sim.physics.catalogue import Catalogue, find_terms

SCHEMA = "truearc.design/1"
# How a shot must be like the one it is named after, where a name that competes follows a circumstance.
AS_THEN: dict[str, str] = WORDING["as_then"]
LEAST_GAIN = 0.01                     # probability by which a plan must raise that of one name that stands alone
SETTINGS = ("distance_m", "hood_deg", "motor_ratio", "exit_speed_m_s", "exit_deg")


def design_table(design: Design, dataset: Dataset, step: Step, among: Catalogue | None = None) -> dict[str, Any]:
    """Return the plan as plain values, without schema and verdict; `next` as in truearc.finding/1."""
    names = [name.partition(".")[0] for name in design.names]
    rows = step.fitted.evidence.rows
    shoot = [{"do": "shoot", **_settings(dataset.shots, int(rows[block.row]), block.pace), "shots": block.shots,
              "separates": names}
             for block in _together(design.blocks)]
    measure = [{"do": "measure", "instrument": one.instrument.id, "what": one.instrument.what,
                "separates": list(one.terms), "probability": one.probability}
               for one in design.measurements if not (one.instrument.filmed and dataset.tracks is not None)]
    follow = [term.follows for term in find_terms(names, among)]
    return {"names": dict(zip(names, map(float, design.probability), strict=True)),
            "as_then": [AS_THEN[one] for one in dict.fromkeys(follow) if one in AS_THEN],
            "probability_before": design.before, "probability_after": design.after,
            "random_shots_worth_as_much": design.random, "next": shoot + measure}


def design_lines(table: dict[str, Any], among: Catalogue | None = None) -> list[str]:
    """Return the plan as text, line by line."""
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
    before, after = table["probability_before"], table["probability_after"]
    if after < before + LEAST_GAIN:
        lines.append(f"Such shots hardly help, if one of these it is: the right one stands alone (95 % sure) with a "
                     f"probability of {before:.0%} now.")
        return lines + _measurements(table, before)
    lines.append(f"After these {total} shots the right one stands alone (95 % sure) with a probability of "
                 f"{after:.0%}, now {before:.0%}; of shots like the present "
                 f"ones it would take {worth} to part them as well.")
    return lines + _measurements(table, before)


def _measurements(table: dict[str, Any], before: float) -> list[str]:
    """Those that part the names better than the present shots do."""
    return [f"Or measure {one['what']}: {one['probability']:.0%}." for one in table["next"]
            if one["do"] == "measure" and one["probability"] > before]


def _together(blocks: tuple[Block, ...]) -> list[Block]:
    """Blocks of one configuration as one."""
    times = Counter(blocks)
    return [replace(block, shots=block.shots * count) for block, count in times.items()]


def _settings(shots: Shots, row: int, pace: float) -> dict[str, Any]:
    wheels = [name for name in shots.numbers if name.startswith("wheel_") and name.endswith("_rad_s")]
    driven = {"motor_ratio", "exit_speed_m_s", *wheels}
    known = {name: float(shots.number(name)[row]) * (pace if name in driven else 1.0) for name in (*SETTINGS, *wheels)}
    like = {"like": shots.shot_id[row], **({} if pace == 1.0 else {"pace": pace})}
    return {**like, **{name: round(value, 4) for name, value in known.items() if value == value}}

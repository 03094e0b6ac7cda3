"""The paper's labelling rule (section IV-A): one row per configuration, labelled by how repeatably it scores.

R2 and R3 are the shares of a configuration's shots in the 2-point region (which holds the 3-point one) and in the
3-point region. The paper's rule, and what it leaves open with the choice taken:

    R3 >= 80 %                              -> three
    R3 < 80 % and R2 > 90 %                 -> two
    R2 < 75 %                               -> removed; but a third of the paper's data are misses, which by this
                                               sentence could not be: a configuration that never scores is a miss
    75 % <= R2 <= 90 % and R3 < 80 %        -> not said: legitimate by the third rule, so two
"""

import numpy as np

from truearc.sim.data.dataset import Dataset, Shots

THREE_AT, REMOVED_BELOW = 0.80, 0.75
AVERAGED = ("distance_m", "hood_deg", "motor_ratio", "battery_v", "t_s")


def label_by_repeatability(dataset: Dataset, least_shots: int = 1) -> Dataset:
    """Group by session and config_id; numbers are means over the group; removed configurations go to `left_out`.

    So do those of which fewer than `least_shots` shots were marked (the others were held or rejected).
    """
    groups: dict[str, list[int]] = {}
    for row, key in enumerate(zip(dataset.shots.text("session"), dataset.shots.text("config_id"), strict=True)):
        groups.setdefault("-".join(key), []).append(row)
    outcomes = np.array(dataset.shots.text("outcome"))
    kept: dict[str, tuple[list[int], str]] = {}
    left_out = list(dataset.left_out)
    for name, rows in groups.items():
        r3 = float(np.mean(outcomes[rows] == "three"))
        r2 = r3 + float(np.mean(outcomes[rows] == "two"))
        outcome = rule(r2, r3)
        if len(rows) < least_shots:
            left_out.append(f"configuration {name}: {len(rows)} shots marked, {least_shots} needed")
        elif outcome is None:
            left_out.append(f"configuration {name}: R2 = {r2:.0%} of {len(rows)} shots, not repeatable")
        else:
            kept[name] = (rows, outcome)
    return Dataset(dataset.name, dataset.facts, _means(dataset.shots, kept), None, None, tuple(left_out))


def rule(r2: float, r3: float) -> str | None:
    """The label of a configuration with these shares; None when it is not repeatable."""
    if r2 == 0.0:
        return "miss"
    if r2 < REMOVED_BELOW:
        return None
    return "three" if r3 >= THREE_AT else "two"


def _means(shots: Shots, kept: dict[str, tuple[list[int], str]]) -> Shots:
    groups = [rows for rows, _ in kept.values()]
    numbers = {name: np.array([np.nanmean(shots.number(name)[rows]) for rows in groups]) for name in AVERAGED}
    numbers["repeats"] = np.array([float(len(rows)) for rows in groups])
    texts = {"outcome": tuple(outcome for _, outcome in kept.values()),
             "session": tuple(shots.text("session")[rows[0]] for rows in groups)}
    return Shots(tuple(kept), numbers, texts)

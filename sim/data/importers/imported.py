"""Steps after an import: taking a part of the dataset, and listing what cannot be as it is stated."""

import numpy as np

from truearc.errors import InputError
from truearc.sim.data.dataset import Dataset


def only(dataset: Dataset, wanted: str) -> Dataset:
    """Shots whose text is one of those wanted, as `ball_quality=new` or `version=a,b`.

    InputError where the column is not of text, or a text is in no shot.
    """
    name, equals, listed = wanted.partition("=")
    texts = dataset.shots.texts
    if not equals or name not in texts:
        raise InputError(f"--only: {wanted!r} is not COLUMN=TEXT with one of the columns "
                         f"{', '.join(texts) or '(none)'}")
    column, parts = dataset.shots.text(name), listed.split(",")
    for part in parts:
        if part not in column:
            known = ", ".join(repr(text) for text in dict.fromkeys(column))
            raise InputError(f"--only: no shot has {part!r} as its {name}; there are {known}")
    return dataset.take([row for row, text in enumerate(column) if text in parts])


def doubts_of(dataset: Dataset) -> tuple[str, ...]:
    """One line for each implausible thing: balls that left below the straight line to the opening's lower rim.

    A ball falls below the line that it leaves along, so one that went in left at the lower rim or above. Tested
    of shots that are said to have passed the opening's plane at a known height.
    """
    target, shots = dataset.facts.target, dataset.shots
    if target is None:
        return ()
    distance_m, hood_deg = shots.number("distance_m"), shots.number("hood_deg")
    rim_m = target.centre_height_m + shots.number("miss_height_m") - target.two_half_height_m
    needed_deg = np.degrees(np.arctan2(rim_m - dataset.facts.launcher.release_height_m, distance_m))
    lacking_deg = needed_deg - hood_deg
    flat = np.flatnonzero(lacking_deg > 0.0)
    if not len(flat):
        return ()
    worst = flat[np.argmax(lacking_deg[flat])]
    return (f"{len(flat)} of {len(shots)} shots leave flatter than a straight line to the opening's lower rim, so that "
            f"no ball without more lift than weight gets there: {shots.shot_id[worst]} at {distance_m[worst]:.2f} m "
            f"has {hood_deg[worst]:.1f} deg, where {needed_deg[worst]:.1f} are the least. Their hood_deg may be no "
            "elevation, or have another zero; what discover names may then only stand for that",)

"""A part of what was imported, so that it can be compared with another part of the same files."""

from truearc.robot.config.schema import InputError
from truearc.sim.data.dataset import Dataset, take_shots


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
    return take_shots(dataset, [row for row, text in enumerate(column) if text in parts])

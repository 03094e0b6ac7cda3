"""How work that lasts reports how far it is."""

from collections.abc import Callable

Progress = Callable[[float, str], None]          # share done, 0 to 1; a note


def part_of(progress: Progress, begin: float, share: float) -> Progress:
    """Progress of a part that begins at `begin` and is `share` of the whole."""
    return lambda done, note: progress(begin + share * done, note)

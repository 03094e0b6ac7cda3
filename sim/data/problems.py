"""Everything wrong with a user's files, gathered, so that one run names it all."""

from collections.abc import Iterator
from contextlib import contextmanager

from truearc.robot.config.schema import InputError

SHOWN = 20                            # problems a message lists before it only counts


class Problems:
    """Collects messages; `close` raises them as one InputError."""

    def __init__(self) -> None:
        self._messages: list[str] = []

    def add(self, place: str, column: str, what: str) -> None:
        """place: file and line; column: name, or '' when it is the row."""
        self._messages.append(f"{place}: {column}: {what}" if column else f"{place}: {what}")

    def add_message(self, message: str) -> None:
        """One that names its place itself."""
        self._messages.append(message)

    def close(self) -> None:
        """Raise InputError with the first problems and how many there are, if there are any."""
        if not self._messages:
            return
        more = len(self._messages) - SHOWN
        tail = [f"... and {more} more problems ({len(self._messages)} in all)"] if more > 0 else []
        raise InputError("\n".join(self._messages[:SHOWN] + tail))


@contextmanager
def gathered() -> Iterator[Problems]:
    """Problems that are raised together at the end of the block."""
    problems = Problems()
    try:
        yield problems
    except InputError as error:
        problems.add_message(str(error))
    problems.close()

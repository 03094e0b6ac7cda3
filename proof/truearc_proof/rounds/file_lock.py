"""One writer at a time in a directory: a lock that the kernel takes off whoever dies, however it dies.

Each part of a round takes it for as long as it writes. So a solver whose parent was killed goes on holding it, and
whoever takes the round up again is told to wait, rather than writing beside it.
"""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from truearc.errors import InputError
from truearc.robot.recording.files import claim

FILE = "lock"                         # stays there, empty, when no process holds it


@contextmanager
def alone(root: Path) -> Iterator[None]:
    """As the only writer in there; InputError where another process is one. The directory is made where there is
    none."""
    root.mkdir(parents=True, exist_ok=True)
    with (root / FILE).open("ab") as file:           # no child inherits it
        try:
            claim(file)
        except OSError as error:
            raise InputError(f"{root}: this round is being played by another process; go on when that has ended"
                           ) from error
        yield

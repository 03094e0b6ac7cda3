"""Progress on work that lasts: one line on stderr, rewritten on a terminal, rare lines elsewhere."""

import sys
import time

from truearc.sim.progress import Progress


def make_progress(what: str, quiet: bool = False) -> Progress:
    """A function of (share done 0-1, note) that shows how far `what` is; does nothing when quiet."""
    if quiet:
        return lambda done, note: None
    live = sys.stderr.isatty()
    last = [0.0]

    def show(done: float, note: str = "") -> None:
        now = time.monotonic()
        if done < 1.0 and now - last[0] < (0.2 if live else 5.0):
            return
        last[0] = now
        end = "\n" if done >= 1.0 or not live else ""
        print(("\r" if live else "") + f"{what}: {done:4.0%} {note}".ljust(78), end=end, file=sys.stderr, flush=True)

    return show

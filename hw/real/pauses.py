"""Pauses between attempts to bring something back."""

from collections.abc import Iterator


def make_pauses_s(first_s: float, longest_s: float) -> Iterator[float]:
    """How long to wait before each attempt: twice as long each time, up to `longest_s`."""
    pause_s = first_s
    while True:
        yield pause_s
        pause_s = min(2.0 * pause_s, longest_s)

"""What another configuration changes, as a page to read."""

from collections.abc import Sequence

from truearc.robot.reasons import texts
from truearc.robot.recording.export.tabular import Value
from truearc.robot.recording.replay.replay_diff import Change, Changes, Flip

MOST_KEYS, MOST_FLIPS = 12, 10
NAME, COUNT, TIME, VALUES = 30, 13, 10, 30        # widths of the table's columns, characters


def describe_changes(session: str, changes: Changes, keys: Sequence[str]) -> str:
    """Which keys differ, which outputs changed, when first and by how much, and which verdicts are others."""
    lines = [f"{session}: {changes.ticks} ticks replayed from the recorded inputs"]
    lines += _shortened([f"  with {key}" for key in keys], MOST_KEYS, "keys")
    if not changes.differing:
        only = f" (what it remembers did, in {changes.remembering} ticks)" if changes.remembering else ""
        lines.append(f"no output changes{only}")
    else:
        lines += ["", f"{changes.differing} ticks come out otherwise. Times are from the recording's start.", "",
                  f"  {'output':{NAME}}{'ticks':{COUNT}}{'first at':{TIME}}{'then: was -> is':{VALUES}}largest change"]
        lines += [_line(change, changes.ticks) for change in sorted(changes.outputs.values(), key=_order)]
        lines += ["", *_verdicts(changes)]
        lines += ["", "The inputs stay as recorded: what the robot would have sensed after acting otherwise, no replay "
                  "knows.", "Read the first change as it stands, later ones as what it would have wanted."]
    if changes.cut_short:
        lines.append(changes.cut_short)
    return "\n".join(lines)


def _order(change: Change) -> tuple[float, str]:
    return change.first_s, change.name


def _line(change: Change, ticks: int) -> str:
    share = f"{change.ticks} ({change.ticks / ticks:.0%})"
    head = f"  {change.name:{NAME}}{share:{COUNT}}{f'{change.first_s:.2f} s':{TIME}}"
    if isinstance(change.was, list) and isinstance(change.now, list):
        return head + _listed(change.was, change.now)
    values = f"{_word(change.was)} -> {_word(change.now)} {change.unit}".rstrip()
    largest = "" if change.largest is None else (f"{change.largest:.3g} {change.unit}".rstrip()
                                                 + f" at {change.largest_s:.2f} s")
    return f"{head}{values:{VALUES}}{largest}".rstrip()


def _listed(was: list[str], now: list[str]) -> str:
    """Of a list of words: what it says only now, and what it said only then."""
    words = [f"now also: {item}" for item in now if item not in was]
    words += [f"no longer: {item}" for item in was if item not in now]
    return "; ".join(words)


def _verdicts(changes: Changes) -> list[str]:
    if not changes.flips:
        return [f"No verdict changes: {changes.fired} shots then and now."]
    lines = [f"{len(changes.flips)} verdicts change: {changes.fired} shots then, {changes.fires} now."]
    return lines + _shortened([_flip(flip) for flip in changes.flips], MOST_FLIPS, "verdicts")


def _flip(flip: Flip) -> str:
    reasons = "; ".join(texts(flip.reasons))
    if flip.fired:
        return f"  at {flip.t_s:.2f} s it fired, and now holds: {reasons}"
    return f"  at {flip.t_s:.2f} s it held ({reasons}), and now fires"


def _shortened(lines: list[str], most: int, what: str) -> list[str]:
    more = len(lines) - most
    return lines if more <= 0 else [*lines[:most], f"  ... and {more} more {what}"]


def _word(value: Value) -> str:
    if value is None:
        return "nothing"
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, float):
        return f"{value:.4g}"
    return str(value)

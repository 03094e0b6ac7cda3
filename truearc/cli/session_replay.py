"""The work of `truearc session replay`."""

import argparse
import sys
from collections.abc import Sequence

from truearc.errors import InputError
from truearc.robot.config.schema import load_config
from truearc.robot.gate import load_gate
from truearc.robot.reasons import texts
from truearc.robot.recording.replay import (
    Change,
    Changes,
    Difference,
    Flip,
    Recomputed,
    config_changes,
    find_changes,
    replay,
    replay_frames,
)
from truearc.robot.recording.session import load_session_config, load_session_gate
from truearc.robot.recording.tabular import Value

MOST_KEYS, MOST_FLIPS = 12, 10
NAME, COUNT, TIME, VALUES = 30, 13, 10, 30        # widths of the table's columns, characters


def replay_as_recorded(args: argparse.Namespace) -> int:
    """Recompute with the recording's own configuration and model; 1 on the first difference."""
    try:
        if args.depth == "frames":
            replayed, again = replay_frames(args.session)
        else:
            replayed, again = replay(args.session), None
    except Difference as difference:
        print(f"{args.session}: {difference}", file=sys.stderr)
        return 1
    print(f"{args.session}: {replayed.ticks} ticks replayed, every output bit-equal")
    if again is not None:
        print(_again(again))
    if replayed.cut_short:
        print(replayed.cut_short, file=sys.stderr)
    return 1 if args.check and (replayed.cut_short or (again is not None and again.missing)) else 0


def _again(again: Recomputed) -> str:
    lines = [f"  {again.frames} CAN frames parsed again, every motor and encoder reading bit-equal",
             f"  {again.seen} images seen again, every sighting bit-equal; {again.taken} sightings are as recorded, "
             "for their images were not kept (the one behind each shot is)",
             "  as recorded, too: button presses, and that a wire was lost or the recording in trouble"]
    if again.missing:
        lines.append(f"  {again.missing} images that the session names, or the index of all, are not there or broken")
    return "\n".join(lines)


def replay_with(args: argparse.Namespace) -> int:
    """Replay the recorded inputs with another configuration or model, and list the outputs that change."""
    recorded = load_session_config(args.session)
    config = recorded if args.config is None else load_config(args.config)
    gate = load_session_gate(args.session) if args.gate is None else load_gate(args.gate)
    if len(config.axes.flywheels) != len(recorded.axes.flywheels):
        raise InputError(f"{args.config}: {len(config.axes.flywheels)} flywheel motors, the recording has "
                       f"{len(recorded.axes.flywheels)}")
    if config.gate.policy == "model" and gate is None:
        raise InputError(f"{args.config}: gate.policy is 'model', and the recording has none: --gate is needed")
    try:
        changes = find_changes(args.session, config, gate)
    except Difference as difference:
        print(f"{args.session}: {difference}", file=sys.stderr)
        return 1
    print(describe_changes(str(args.session), changes, config_changes(recorded, config)))
    return 1 if args.check and (changes.differing or changes.remembering or changes.cut_short) else 0


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
        in_order = sorted(changes.outputs.values(), key=lambda change: (change.first_s, change.name))
        lines += [_line(change, changes.ticks) for change in in_order]
        lines += ["", *_verdicts(changes)]
        lines += ["", "The inputs stay as recorded: what the robot would have sensed after acting otherwise, no replay "
                  "knows.", "Read the first change as it stands, later ones as what it would have wanted."]
    if changes.cut_short:
        lines.append(changes.cut_short)
    return "\n".join(lines)


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

"""The work of `truearc session replay`."""

import argparse
import sys

from truearc.cli.session.replay_text import describe_changes
from truearc.robot.config.schema import InputError, load_config
from truearc.robot.gate.model import load_gate
from truearc.robot.recording.replay.frame_replay import Recomputed
from truearc.robot.recording.replay.recompute import Difference, replay, replay_frames
from truearc.robot.recording.replay.replay_diff import config_changes, find_changes
from truearc.robot.recording.session import load_session_config, load_session_gate


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

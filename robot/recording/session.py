"""The layout of a session on disk.

A session is a folder that contains:

    session.json     how it was made: versions, and hashes of the configuration and the model
    config.json      its configuration
    model.onnx       the gate, if there was one
    aim.json         the aim file at the start, if there was one
    aims/            the aim files offered later, each as SHA256.json
    telemetry.mcap   JSON messages: the whole Tick on /tick, and each line of trials.jsonl on /trial
    can0.log         every CAN frame in both directions, as candump text
    trials.jsonl     one line per outcome, each written with fsync
    frames/          the image behind each shot, and frames.jsonl
    lateness.jsonl   one line per second: the lateness of the ticks (truearc.robot.runtime); only on real robots
    damaged/         the files that `truearc session recover` replaced
"""

import hashlib
from importlib.metadata import version
from pathlib import Path
from typing import Any, NamedTuple

import msgspec
from msgspec import UNSET, Struct, UnsetType

from truearc.errors import MAX_TEXT_BYTES, NO_JSON, InputError, in_words, load_bytes, naming
from truearc.robot import aim_file, types
from truearc.robot.config.schema import Config, config_hash, config_of, is_hash_of
from truearc.robot.gate import Gate, load_gate

FORMAT = "truearc.session/2"
HEADER, CONFIG, MODEL, TELEMETRY, CAN, TRIALS, FRAMES, LATENESS = (
    "session.json", "config.json", "model.onnx", "telemetry.mcap", "can0.log", "trials.jsonl", "frames",
    "lateness.jsonl")
AIM, AIMS = "aim.json", "aims"
INDEX, DAMAGED = "frames/frames.jsonl", "damaged"
TICK_TOPIC, TRIAL_TOPIC = "/tick", "/trial"


class Header(Struct, frozen=True):
    """What made a session."""

    format: str                       # truearc.session/2
    truearc: str                      # version that recorded it
    config_sha256: str                # of config.json's content
    model_sha256: str | None          # of model.onnx; null: there was none
    policy: str                       # collect | model
    started: str | None               # wall clock, ISO 8601; null on the twin, whose clock starts at zero
    aim_sha256: str | UnsetType = UNSET           # of aim.json; absent: there was none
    wall_offset_ns: int | UnsetType = UNSET       # wall clock (Unix) less the robot's at the start; absent on the twin


class Picture(Struct, frozen=True):
    """One line of frames/frames.jsonl."""

    t_ns: int                         # middle of the exposure
    file: str


class Trial(Struct, frozen=True):
    """One line of trials.jsonl; a later line for the same trial replaces it."""

    outcome: types.Outcome
    shot: types.Shot | None


class WallTime(NamedTuple):
    """Wall clock (Unix) minus the robot's clock in ns, and how that is known."""

    offset_ns: int
    how: str


MOST_ROW_BYTES = 1 << 20              # of a tick; the largest of 60 recordings had 7,600
encode_row = msgspec.json.Encoder().encode        # a line of a session's files, or a message of its telemetry
_decode_tick = msgspec.json.Decoder(types.Tick).decode
decode_trial = msgspec.json.Decoder(Trial).decode


def decode_tick(row: bytes) -> types.Tick:
    """Decode a row of a session's ticks; msgspec.ValidationError for one too long to be one."""
    if len(row) > MOST_ROW_BYTES:
        raise msgspec.ValidationError(f"has {len(row)} bytes; at most {MOST_ROW_BYTES} are read")
    return _decode_tick(row)


def row_schema(kind: type[types.Tick] | type[Trial]) -> bytes:
    """Return the JSON schema of a tick or a trial. Its root is an object, since viewers refuse a reference as root."""
    schema = msgspec.json.schema(kind)
    return encode_row({"type": "object", "properties": {}, "allOf": [{"$ref": schema["$ref"]}],
                       "$defs": schema["$defs"]})


def make_trials(tick: types.Tick) -> list[Trial]:
    """Return the rows of trials.jsonl for a tick's outcomes."""
    shot = tick.memory.last_shot
    return [Trial(outcome, shot if shot is not None and shot.trial == outcome.trial else None)
            for outcome in tick.outcomes]


def make_header(config: Config, gate: Gate | None, started: str | None, aim: aim_file.AimFile | None = None,
                wall_offset_ns: int | UnsetType = UNSET) -> Header:
    """Return the content of session.json."""
    return Header(FORMAT, version("truearc"), config_hash(config), gate.sha256 if gate else None, config.gate.policy,
                  started, aim.sha256 if aim else UNSET, wall_offset_ns)


def load_header(session: Path) -> Header:
    """Load session.json; InputError if this is not a session, or has a newer format."""
    path = session / HEADER
    if not path.exists():
        raise InputError(f"{path}: not a recording (there is no such file)")
    data = load_bytes(path, MAX_TEXT_BYTES)
    with naming(f"{path}: not a recording"):
        header = msgspec.json.decode(data, type=Header)
    if header.format != FORMAT:
        raise InputError(f"{path}: format {header.format}, this version reads {FORMAT}")
    return header


def load_session_config(session: Path) -> Config:
    """Load the configuration of a session; InputError if it is not the one that its header names."""
    header, path = load_header(session), session / CONFIG
    with naming(path):
        config = config_of(msgspec.json.decode(load_bytes(path, MAX_TEXT_BYTES), type=dict[str, Any]))
    if not is_hash_of(header.config_sha256, config):
        raise InputError(f"{path}: changed since the recording was made (hash differs from {HEADER})")
    return config


def load_session_gate(session: Path) -> Gate | None:
    """Load the model of a session; InputError if it is missing or differs."""
    header, path = load_header(session), session / MODEL
    if header.model_sha256 is None:
        return None
    if not path.exists():
        raise InputError(f"{path}: the model that gated the recording is missing")
    if hashlib.sha256(load_bytes(path)).hexdigest() != header.model_sha256:
        raise InputError(f"{path}: not the model that gated the recording")
    return load_gate(path)


def load_session_aims(session: Path) -> aim_file.Aims:
    """Load the aim files that a session may have used; InputError if the first is missing or differs."""
    header, path = load_header(session), session / AIM
    aims = {one.sha256: one for one in map(aim_file.load_aim, sorted((session / AIMS).glob("*.json")))}
    if header.aim_sha256 is not UNSET:
        if not path.exists():
            raise InputError(f"{path}: the aim file of the recording is missing")
        aims[""] = aim_file.load_aim(path)
        if aims[""].sha256 != header.aim_sha256:
            raise InputError(f"{path}: not the aim file of the recording")
    return aims


def load_trials(session: Path) -> list[Trial]:
    """Load every marked trial in order; a later line replaces an earlier one of the same trial.

    A last line cut short by a power loss is dropped; any other broken line is InputError with its number.
    """
    load_header(session)
    path = session / TRIALS
    lines = load_bytes(path).split(b"\n") if path.exists() else []
    trials: dict[int, Trial] = {}
    for number, line in enumerate(lines, 1):
        if not line:
            continue
        try:
            trial = decode_trial(line)
        except NO_JSON as error:
            if number == len(lines):
                break
            raise InputError(f"{path}:{number}: {in_words(error)}") from error
        trials[trial.outcome.trial] = trial
    return [trials[key] for key in sorted(trials)]


def wall_time(header: Header) -> WallTime:
    """Return how to date a session. The robot's clock is monotonic with an arbitrary zero, so it does not matter if the
    wall clock was set later."""
    if header.wall_offset_ns is UNSET:
        return WallTime(0, "an emulated robot's clock, which begins at zero (1970)")
    return WallTime(header.wall_offset_ns, "wall clock, as at the start of the session")

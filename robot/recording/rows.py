"""How ticks and trials are written in a session's files: the newest format, and whichever an older session has."""

from typing import Any, Protocol

import msgspec
from msgspec import Struct

from truearc.hw.reason import Reason
from truearc.robot.types import Outcome, Shot, Tick


class Trial(Struct, frozen=True):
    """One line of trials.jsonl; a later line for the same trial replaces it."""

    outcome: Outcome
    shot: Shot | None


class RowFormat(Protocol):
    """Bytes of a tick and of a trial, both ways. Decoding raises msgspec.MsgspecError on what is not one."""

    def decode_tick(self, data: bytes) -> Tick: ...

    def encode_tick(self, tick: Tick) -> bytes: ...

    def decode_trial(self, data: bytes) -> Trial: ...

    def encode_trial(self, trial: Trial) -> bytes: ...

    def schema(self, kind: type[Tick] | type[Trial]) -> bytes:
        """JSON schema of a tick or a trial."""

    def recorded(self, reasons: tuple[Reason, ...]) -> tuple[Reason, ...]:
        """These as they are after they were written and read."""


def as_object(schema: dict[str, Any]) -> dict[str, Any]:
    """A JSON schema that says at its root that it is an object: a viewer refuses one whose root is a reference."""
    return {"type": "object", "properties": {}, "allOf": [{"$ref": schema["$ref"]}], "$defs": schema["$defs"]}


class Rows2:
    """truearc.session/2: the structs as they are, reasons as code and parameters."""

    def __init__(self) -> None:
        self.encode_tick = self.encode_trial = msgspec.json.Encoder().encode
        self.decode_tick = msgspec.json.Decoder(Tick).decode
        self.decode_trial = msgspec.json.Decoder(Trial).decode

    def schema(self, kind: type[Tick] | type[Trial]) -> bytes:
        return msgspec.json.encode(as_object(msgspec.json.schema(kind)))

    def recorded(self, reasons: tuple[Reason, ...]) -> tuple[Reason, ...]:
        return reasons

"""Claims about sealed worlds, `truearc.claims/2`: the keys that a grader reads (docs/how-to/challenge.md).

Everything that is compared is an id: verdicts, names of terms, parameters, columns, stages, directions, instruments.
Sentences are for people. `truearc.claims/1`, which the published rounds have, named instruments by their text.
"""

from collections.abc import Mapping
from pathlib import Path
from typing import Any, Literal

import msgspec
from msgspec import Struct, field

from truearc.errors import InputError

SCHEMA, SCHEMA_1 = "truearc.claims/2", "truearc.claims/1"
# {text of schema 1: id of the instrument}, as truearc wrote them at tag proof-1.
INSTRUMENTS_1: Mapping[str, str] = {
    "target height with a tape": "target_height_tape",
    "exit height with a tape": "exit_height_tape",
    "distance with a tape at 3 stations": "distance_tape",
    "hood angle with an inclinometer": "inclinometer",
    "hood angle with an inclinometer, from both sides": "inclinometer_both_ways",
    "wheel diameter with calipers, wheel speed with an optical tachometer": "calipers_tachometer",
    "the wind with an anemometer": "anemometer",
    "the camera's delay, by a lamp in its view that the robot switches": "delay_lamp",
    "a ruler in the tracker's view": "ruler",
    "a plumb line in the tracker's view": "plumb_line",
    "a stopwatch in the tracker's view": "stopwatch",
}


class Mismatch(Struct):
    found: bool
    p_value: float | None = None


class Term(Struct):
    term: str
    probability: float | None = None
    parameters: dict[str, Any] | None = None


class Finding(Struct):
    mismatch: Mismatch
    verdict: str
    what: list[Term] | None = None


class Believed(Struct):
    """Tables of truearc.sim.infer.belief that forecast shots without the finding, and with it."""

    before: dict[str, Any]
    after: dict[str, Any]


class Claims(Struct):
    """Claims about one world; further keys are ignored.

    data: {file: SHA-256}. written: requests for further shots, or for one measurement, as
    the file has them, by which the ledger knows them. rivals: {name: its claim}. believed: the two beliefs of the
    sealed test.
    """

    data: dict[str, str]
    finding: dict[str, Any]
    schema: Literal["truearc.claims/1", "truearc.claims/2"] = "truearc.claims/2"
    written: list[Any] = field(name="asked", default_factory=list)
    rivals: dict[str, Any] = {}
    believed: Believed | None = None

    @property
    def asked(self) -> list[Any]:
        """`written` with instruments by their ids, whatever the schema."""
        return self.written if self.schema == SCHEMA else list(map(_upgrade_request, self.written))


def load_claims(path: Path) -> Claims:
    """Read claims of either schema; keys are as in schema 2.

    Raises:
        InputError: with the file, and the key that is missing or of another kind than it must be.
    """
    try:
        claims = msgspec.json.decode(path.read_bytes(), type=Claims)
    except OSError as error:
        raise InputError(f"{path}: {error.strerror or error}") from error
    except (msgspec.MsgspecError, UnicodeDecodeError) as error:
        raise InputError(f"{path}: {error}") from error
    try:
        msgspec.convert(claims.finding, Finding)
    except msgspec.ValidationError as error:
        raise InputError(f"{path}: finding: {error}") from error
    return claims


def _upgrade_request(one: Any) -> Any:
    """A request of schema 1 as schema 2 has it; what no instrument is called is left for the keeper to refuse."""
    if not isinstance(one, dict) or not isinstance(one.get("measure"), str):
        return one
    return {**one, "measure": INSTRUMENTS_1.get(one["measure"], one["measure"])}

"""Result of a discovery: the fields of `truearc.finding/1`. Fields that do not apply are None (null in JSON)."""

from pathlib import Path
from typing import Any

import msgspec
from msgspec import Struct

from truearc.robot.config.schema import InputError, load_bytes

SCHEMA = "truearc.finding/1"


class DataSummary(Struct, frozen=True, omit_defaults=True):
    """The data; `clusters` says which shots have a sign of their own in the test."""

    shots: int
    level: str                        # L0 outcomes | L1 with telemetry | L2 with tracks
    left_out: tuple[str, ...]
    believed: tuple[str, ...]         # terms
    fitted: dict[str, dict[str, float]]       # tracks | outcomes -> shared parameters
    clusters: dict[str, Any]
    accepted: tuple[str, ...] = ()    # objections to the data that the user accepted, or that only warn
    untested: tuple[str, ...] = ()    # kinds of effects that these data have no column for
    topspin: bool = False             # of most balls, by wheels or measurement
    at_limit: dict[str, float] = {}   # fitted numbers that stopped at the end of their range


class TestResult(Struct, frozen=True):
    """One line of the family: the best shape of one channel over one covariate."""

    __test__ = False                  # not one of pytest's

    stage: str
    direction: str
    covariate: str | None
    shape: str
    statistic: float                  # |score| in standard errors, clustered
    p_alone: float
    p_value: float                    # as the largest of the whole family
    amplitude: float                  # per unit of the shape
    unit: str
    log_gain: float


class Mismatch(Struct, frozen=True):
    found: bool
    p_value: float | None
    false_alarm: float
    tests: dict[str, TestResult]
    tests_made: int
    families: dict[str, float]        # terms | free | pattern -> p of the family alone


class Where(Struct, frozen=True):
    stage: str | None
    stage_probability: dict[str, float] | None
    covariate: str | None
    direction: str | None
    region: dict[str, Any]
    times_s: tuple[float, float] | None
    channel: str | None
    inseparable: tuple[str, ...]      # other names that go with the same shots as the covariate
    reason: str | None                # why a field above is null


class Interval(Struct, frozen=True):
    """A fitted amplitude: 90 % interval."""

    value: float
    sd: float
    low90: float
    high90: float
    unit: str


class Named(Struct, frozen=True):
    term: str
    probability: float
    parameters: dict[str, Interval]
    sentence: str
    stage: str
    believed: float | None = None     # the one parameter's value in the belief, where a change of it is tested


class Unknown(Struct, frozen=True):
    covariate: str | None
    direction: str
    amplitude: float
    unit: str
    formula: str | None


class Further(Struct, frozen=True):
    """One effect, those found before it put in: names as in Finding; `unknown` where none of them is it."""

    what: tuple[Named, ...]
    set: tuple[str, ...] | None
    unknown: Unknown | None


class FitSummary(Struct, frozen=True):
    """Figures on shots that the fit had not seen, before and after the free correction."""

    heldout_shots: int
    log_score_before: float
    log_score_after: float | None
    gain_per_shot: float | None
    gain_se: float | None
    height_rmse_before_m: float | None
    height_rmse_after_m: float | None
    accuracy_before: float | None
    accuracy_after: float | None
    height_at: str = "plane"          # or "track end": forecast from the first 40 % of the track


class Finding(Struct, frozen=True):
    data: DataSummary
    mismatch: Mismatch
    where: Where
    verdict: str                      # named | set | unknown | none
    sentence: str
    unknown: Unknown | None
    fit: FitSummary | None
    schema: str = SCHEMA
    what: tuple[Named, ...] = ()
    set: tuple[str, ...] | None = None
    next: tuple[dict[str, Any], ...] = ()
    also: tuple[Further, ...] = ()


def load_finding(path: str | Path) -> Finding:
    """Read a finding that `make_json` wrote, by this version or an earlier one.

    Raises:
        InputError: `path` cannot be read, or is not a truearc.finding/1; with the key.
    """
    try:
        finding = msgspec.json.decode(load_bytes(path), type=Finding)
    except (msgspec.MsgspecError, UnicodeDecodeError) as error:
        raise InputError(f"{path}: {error}") from error
    if finding.schema != SCHEMA:
        raise InputError(f"{path}: schema: got {finding.schema!r}; expected {SCHEMA!r}")
    return finding


def make_json(result: Struct) -> bytes:
    """JSON text of a finding, or of another result; numbers that are not finite become null."""
    return msgspec.json.format(msgspec.json.encode(result), indent=1) + b"\n"

"""The records that discovery writes, `truearc.finding/1` and `truearc.proposal/1`, and discovery's defaults and limits.

This module has no heavy imports, because the command line shows the defaults in --help. A field that does not apply is
None (null in JSON). A proposal changes nothing on a robot.
"""

import hashlib
from pathlib import Path
from typing import Any

import msgspec
from msgspec import UNSET, Struct, UnsetType

from truearc.errors import InputError, load_bytes, naming

FALSE_ALARM = 0.05                    # the promise; source: Fisher's 5 % (1925)
# Derived: p of 0.05 is then known to 0.005
SIGN_DRAWS = 1999                     # sign flips behind a p-value, which is therefore 1 / 2000 at least
LEAST_FALSE_ALARM = 0.002             # a p of at least 1 in 1000 can decide about it; derived: twice that
LEVELS = ("L0", "L1", "L2")           # outcomes | with telemetry | with tracks
LEVEL = "L0"
SEASON_SHOTS = 300                    # of a planned season; chosen: as all rounds of docs/measured/sealed.md
# Measured with outcomes alone: these tell names apart better than 300 at random do; log probability of the right name
# -0.88, not -1.44 (git show archive-1:archive/measurements.md)
PLANNED_SHOTS, CONFIGURATIONS = 100, 5    # of a design


def check_chances(false_alarm: float, seed: int, names: tuple[str, str] = ("false_alarm", "seed")) -> None:
    """Reject settings that no discovery can run with.

    Raises:
        InputError: names the argument, by `names`: a false alarm not from LEAST_FALSE_ALARM to 1, or a negative seed.
    """
    if not LEAST_FALSE_ALARM <= false_alarm < 1.0:
        raise InputError(f"{names[0]}: {false_alarm} is not between {LEAST_FALSE_ALARM} (rarer alarms would take more "
                         "draws than are made) and 1")
    if seed < 0:
        raise InputError(f"{names[1]}: {seed} is negative")


SCHEMA = "truearc.finding/1"


class DataSummary(Struct, frozen=True, omit_defaults=True):
    """The data; `clusters`: which shots have their own sign in the test."""

    shots: int                        # in the dataset
    level: str                        # L0 outcomes | L1 with telemetry | L2 with tracks
    left_out: tuple[str, ...]         # shots or columns without use, and why
    believed: tuple[str, ...]         # terms
    fitted: dict[str, dict[str, float]]       # tracks | outcomes -> shared parameters
    clusters: dict[str, Any]          # `by`: shot, ball_id, session ...; `count`
    accepted: tuple[str, ...] = ()    # objections to the data that the user accepted, or that only warn
    untested: tuple[str, ...] = ()    # kinds of effects for which these data have no column
    topspin: bool = False             # of most balls, by wheels or measurement
    at_limit: dict[str, float] = {}   # fitted numbers that stopped at the end of their range
    improbable: dict[str, float] = {} # fitted numbers with improbable values, and the tracker's
    notes: tuple[str, ...] = ()       # what limits the shots, or is unusual for real shots
    sha256: str = ""                  # of the dataset's content, as in provenances


class TestResult(Struct, frozen=True):
    """One line of the family: the best shape of one channel over one covariate."""

    __test__ = False                  # not one of pytest's

    stage: str                        # sensing | launch | flight | arrival
    direction: str                    # along | lateral | vertical
    covariate: str | None             # what the misfit depends on; null: the same in all shots
    shape: str                        # same | proportional | straight | product | wave | step at VALUE
    statistic: float                  # size of the score in standard errors, clustered
    p_alone: float                    # as if this were the only test
    p_value: float                    # as the largest of the whole family
    amplitude: float                  # per unit of the shape
    unit: str                         # of `amplitude`, as in docs/reference/terms.md
    log_gain: float                   # nats by which the data favour it


class Mismatch(Struct, frozen=True):
    found: bool                       # whether the family's p_value is below false_alarm
    p_value: float | None             # of the whole family
    false_alarm: float                # requested rate
    tests: dict[str, TestResult]      # best lines of the family by channel and covariate, or by parameter
    tests_made: int                   # size of the family
    families: dict[str, float]        # terms | free | pattern -> p of the family alone


class Where(Struct, frozen=True):
    stage: str | None                 # sensing | launch | flight | arrival
    stage_probability: dict[str, float] | None # by stage
    covariate: str | None             # column, or name made of columns
    direction: str | None             # along | lateral | vertical
    region: dict[str, Any]            # of the covariate: `from`, `to`, or a group
    times_s: tuple[float, float] | None # first and last time of the shots concerned, s
    channel: str | None               # part of a shot that is off, such as launch speed
    inseparable: tuple[str, ...]      # covariates that these shots cannot distinguish from this one
    reason: str | None                # why a field above is null


class Interval(Struct, frozen=True):
    """The 90 % interval of a fitted amplitude."""

    value: float                      # in `unit`
    sd: float                         # standard deviation
    low90: float                      # lower end of the 90 % interval
    high90: float                     # upper end
    unit: str                         # as in docs/reference/terms.md; 1: a share


class Named(Struct, frozen=True):
    term: str                         # name in docs/reference/terms.md
    probability: float                # that it is among the missing effects, and nothing is unexplained
    parameters: dict[str, Interval]   # by name; for a believed one, its new value
    sentence: str                     # for people
    stage: str                        # sensing | launch | flight | arrival
    believed: float | None = None     # the parameter's value in the belief, if a change of it is tested
    change: Interval | UnsetType = UNSET           # of that parameter since the belief; absent if none is tested

    @property
    def size(self) -> Interval:
        """The change of a believed number, else the amplitude."""
        return next(iter(self.parameters.values())) if isinstance(self.change, UnsetType) else self.change


class Unknown(Struct, frozen=True, omit_defaults=True):
    covariate: str | None             # what the effect depends on; null: the same in all shots
    direction: str                    # along | lateral | vertical
    amplitude: float                  # over the covariate's range, in `unit`
    unit: str                         # of `amplitude`
    low90: float | None = None        # lower end of the 90 % interval of `amplitude`, given the shape
    high90: float | None = None       # upper end


class FoundEffect(Struct, frozen=True):
    """One effect, with those found before it included: names as in FindingRecord; `unknown` if none of them is it."""

    what: tuple[Named, ...]           # as in the finding
    set: tuple[str, ...] | None       # as in the finding
    unknown: Unknown | None           # as in the finding
    unexplained: float | UnsetType = UNSET         # as in the finding
    withheld: str | UnsetType = UNSET              # as in the finding


class FitSummary(Struct, frozen=True):
    """Figures on hold-out shots, before and after the free correction."""

    heldout_shots: int                # number of hold-out shots
    log_score_before: float           # nats of all of them
    log_score_after: float | None     # nats of all of them
    gain_per_shot: float | None       # nats
    gain_se: float | None             # standard error of gain_per_shot
    height_rmse_before_m: float | None # of measured heights or tracks
    height_rmse_after_m: float | None # of measured heights or tracks
    accuracy_before: float | None     # share of outcomes forecast right
    accuracy_after: float | None      # share of outcomes forecast right
    height_at: str = "plane"          # or "track end": forecast from the first 40 % of the track
    side_rmse_before_m: float | UnsetType = UNSET  # of y at the track's end, if a name acts sideways
    side_rmse_after_m: float | UnsetType = UNSET   # of y at the track's end


class Adoption(Struct, frozen=True):
    """Value of the finding on hold-out shots, in points, and whether it is adopted."""

    shots: int                        # with an outcome or a height
    threshold: float                  # P(three) from which the gate fires
    aimed_before: float               # points per ball if all shots were aimed with the old belief
    aimed_after: float                # with the new belief
    fired_before: float               # share of the actual shots that the gate of the old belief passes
    fired_after: float                # of the new belief
    scored_before: float | None       # points per ball of these; null: it passes none
    scored_after: float | None        # of the new belief
    gain: float                       # points per shot, aim and gate together
    low90: float                      # lower end of the 90 % interval over hold-out shots
    high90: float                     # upper end
    refused: str | None               # why it is not adopted, or not as a whole; null: it is adopted
    hit_points: float | UnsetType = UNSET          # of the best hit; absent where that is three


class Story(Struct, frozen=True, omit_defaults=True):
    """A finding in sentences for people, in the order in which they are told; "" where there is nothing to tell."""

    change: str                       # what changed or is missing, with size and interval; or what could not be seen
    where: str = ""                   # where it shows
    worth: str = ""                   # in points per ball, or in the error of forecasts
    sure: str = ""                    # how sure, and what else it may be
    next: str = ""                    # the one thing to do next
    also: tuple[str, ...] = ()        # further effects, and changes of the tracker
    limits: tuple[str, ...] = ()      # doubts about the fit

    @property
    def text(self) -> str:
        """Everything but what to do next."""
        return " ".join(filter(None, (self.change, self.where, self.worth, self.sure, *self.also, *self.limits)))


class FindingRecord(Struct, frozen=True):
    """Every figure of a finding, as its JSON file has it."""

    data: DataSummary                 # the data
    mismatch: Mismatch                # whether simulation and data differ
    where: Where                      # location of the mismatch
    verdict: str                      # named | set | unknown | none
    sentence: str                     # the story's sentences but the last, joined
    unknown: Unknown | None           # if no candidate term explains the effect
    fit: FitSummary | None            # value of the correction on hold-out shots
    schema: str = SCHEMA              # truearc.finding/1
    what: tuple[Named, ...] = ()      # candidate terms, most probable first
    set: tuple[str, ...] | None = None # terms that these data cannot distinguish; null: a single name
    next: tuple[dict[str, Any], ...] = () # shots or measurements to make next, as in truearc.design/1
    also: tuple[FoundEffect, ...] = ()    # further effects, in the order in which they were found
    unexplained: float | UnsetType = UNSET         # probability of an effect outside the catalogue
    adoption: Adoption | UnsetType = UNSET         # absent if nothing was found, or without a target
    tracker: FoundEffect | UnsetType = UNSET       # errors of its calibration, or changes since `since`
    withheld: str | UnsetType = UNSET              # why an effect that a term explains has no name
    story: Story | UnsetType = UNSET               # `sentence` in parts; absent in files of earlier versions

    @property
    def told(self) -> Story:
        """The story; of a file without one, its sentence."""
        return Story(self.sentence) if isinstance(self.story, UnsetType) else self.story


def load_record(path: str | Path) -> FindingRecord:
    """Read a finding that `make_json` wrote, by this version or an earlier one.

    Raises:
        InputError: `path` cannot be read, or is not a truearc.finding/1; with the key.
    """
    with naming(path):
        finding = msgspec.json.decode(load_bytes(path), type=FindingRecord)
    if finding.schema != SCHEMA:
        raise InputError(f"{path}: schema: got {finding.schema!r}; expected {SCHEMA!r}")
    return finding


def make_json(result: Struct) -> bytes:
    """Return the JSON text of a finding, or of another result; numbers that are not finite become null."""
    return msgspec.json.format(msgspec.json.encode(result), indent=1) + b"\n"


PROPOSAL_SCHEMA = "truearc.proposal/1"


class BeliefFile(Struct, frozen=True):
    """A belief and the file that holds it."""

    file: str                         # its path as given; relative to the proposal if it has no folder
    sha256: str                       # of the file's bytes


class ProposedEffect(Struct, frozen=True):
    """One effect that the proposed belief has and the previous one did not."""

    term: str                         # name in docs/reference/terms.md
    probability: float                # of this term among all candidates and an unknown effect
    value: float                      # in `unit`
    low90: float                      # lower end of the 90 % interval
    high90: float                     # upper end
    unit: str                         # as in docs/reference/terms.md; 1: a share
    sentence: str                     # for people
    change: Interval | UnsetType = UNSET           # change of a believed number; `value` is its new value


class SetPointChange(Struct, frozen=True):
    """Set points of one distance under both beliefs; null: none scores there under that belief."""

    distance_m: float                 # from exit to target
    hood_before_deg: float | None     # launch elevation
    hood_after_deg: float | None      # proposed
    motor_before_rad_s: float | None  # motor speed
    motor_after_rad_s: float | None   # proposed
    points_after: float | None        # expected by the proposed belief
    points_kept: float | None         # expected by the proposed belief, if the former set point is kept


class AimProposal(Struct, frozen=True):
    """A new belief with its aim, to accept or reject."""

    id: str                           # of the content; another proposal has another
    t: str | None                     # when it was made, ISO 8601, UTC
    sentence: str                     # for people, one line
    effects: tuple[ProposedEffect, ...]            # likeliest first
    since_shot: str                   # shot_id of the likeliest beginning of the change
    since_number: int                 # the same, counted from 1 among the marked shots that were followed
    alarm_shot: str                   # shot_id of the alarm
    shots: int                        # marked shots that were followed
    e_value: float                    # largest so far; an alarm from 1 / false_alarm on
    false_alarm: float                # probability of an alarm if nothing changes
    before: BeliefFile                # belief that was followed
    after: BeliefFile                 # proposed belief
    rows: tuple[SetPointChange, ...]  # by distance
    schema: str = PROPOSAL_SCHEMA              # truearc.proposal/1


def with_id(proposal: AimProposal) -> AimProposal:
    """Return the record with the id of its content, excluding its time."""
    content = msgspec.json.encode(msgspec.structs.replace(proposal, id="", t=None))
    return msgspec.structs.replace(proposal, id=hashlib.sha256(content).hexdigest()[:16])

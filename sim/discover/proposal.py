"""A change that is proposed to the driver: the fields of `truearc.proposal/1`. Nothing on a robot is changed by it."""

import hashlib

import msgspec
from msgspec import Struct

SCHEMA = "truearc.proposal/1"


class BeliefFile(Struct, frozen=True):
    """A belief and the file that holds it."""

    file: str                         # its path, as given; beside the proposal where it has no folder
    sha256: str                       # of the file's bytes


class ProposedEffect(Struct, frozen=True):
    """One effect that the proposed belief has and the former did not."""

    term: str                         # name in docs/reference/terms.md
    probability: float                # that it is this term, of all candidates and an unknown one
    value: float                      # in `unit`
    low90: float                      # lower end of the 90 % interval
    high90: float                     # upper end
    unit: str                         # as in docs/reference/terms.md; 1: a share
    sentence: str                     # for people


class SetPointChange(Struct, frozen=True):
    """Set points of one distance by both beliefs; null: by that belief none scores there."""

    distance_m: float                 # from exit to target
    hood_before_deg: float | None     # launch elevation
    hood_after_deg: float | None      # proposed
    motor_before_rad_s: float | None  # motor speed
    motor_after_rad_s: float | None   # proposed
    points_after: float | None        # expected by the proposed belief
    points_kept: float | None         # expected by the proposed belief, if the former set point is kept


class AimProposal(Struct, frozen=True):
    """A new belief with its aim, to accept or not."""

    id: str                           # of the content; another proposal has another
    t: str | None                     # when it was made, ISO 8601, UTC
    sentence: str                     # for people, one line
    effects: tuple[ProposedEffect, ...]            # likeliest first
    since_shot: str                   # shot_id from which on the change is likeliest
    since_number: int                 # the same, counted from 1 among the marked shots that were followed
    alarm_shot: str                   # shot_id of the alarm
    shots: int                        # marked shots that were followed
    e_value: float                    # largest so far; an alarm from 1 / false_alarm on
    false_alarm: float                # probability of an alarm where nothing changes
    before: BeliefFile                # belief that was followed
    after: BeliefFile                 # proposed belief
    rows: tuple[SetPointChange, ...]  # by distance
    schema: str = SCHEMA              # truearc.proposal/1


def with_id(proposal: AimProposal) -> AimProposal:
    """The same with the id of its content, its time aside."""
    content = msgspec.json.encode(msgspec.structs.replace(proposal, id="", t=None))
    return msgspec.structs.replace(proposal, id=hashlib.sha256(content).hexdigest()[:16])

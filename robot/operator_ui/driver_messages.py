"""Tells a driver what each reason for a HOLD means, and what can be done about it.

`driver_messages.toml` has the words, in the order of importance. `docs/reference/reasons.md` shows them all.
"""

import tomllib
from collections.abc import Iterable, Iterator
from importlib.resources import files
from itertools import product
from operator import itemgetter

from msgspec import Struct

from truearc.hw.devices.registry import find_messages
from truearc.hw.reason import FAULT, Message, Reason, fill
from truearc.robot import reasons as bot

SEVERAL = ("motor", "device", "joint")           # reasons that differ in these alone are shown as one ...
PASSING = ("age_s",)                  # ... whatever these are


class Told(Struct, frozen=True):
    """One or several reasons as the page words them; `reasons`: their log texts."""

    kind: str
    means: str
    do: str
    reasons: tuple[str, ...]


def load_messages() -> Iterator[Message]:
    """The messages of driver_messages.toml, most important first."""
    text = (files("truearc.robot.operator_ui") / "driver_messages.toml").read_text(encoding="utf-8")
    for row in tomllib.loads(text)["message"]:
        for code, case in product(_listed(row["code"]), _listed(row.get("case", ""))):
            yield Message(bot.BY_NAME[code], row["kind"], row["means"], row.get("do", ""), case)


def _listed(names: str | list[str]) -> list[str]:
    return [names] if isinstance(names, str) else names


MESSAGES = tuple(load_messages())
RANKS = {(message.code.name, message.case): rank for rank, message in enumerate(MESSAGES)}


def tell(reasons: Iterable[Reason]) -> tuple[Told, ...]:
    """The reasons as messages, most important first.

    Those of other distributions' motors come before all, and so does one without a message, as its log text.
    """
    groups: dict[tuple[object, ...], tuple[int, Message | None, list[Reason]]] = {}
    for reason in reasons:
        message = find_message(reason)
        rank = -1 if message is None else RANKS.get((message.code.name, message.case), -1)
        alike = (bot.text(reason),) if message is None else (reason.code, *_differing(reason))
        groups.setdefault((rank, *alike), (rank, message, []))[2].append(reason)
    return tuple(_together(message, members) for _, message, members in sorted(groups.values(), key=itemgetter(0)))


def find_message(reason: Reason) -> Message | None:
    """The message for a reason; None where there is none."""
    case = _case(reason)
    own = find_messages(case if reason.code == bot.MOTOR_ERROR.name else reason.code)
    rank = RANKS.get((reason.code, case), RANKS.get((reason.code, "")))
    return next((message for message in own if message.case in ("", case)), None if rank is None else MESSAGES[rank])


def _case(reason: Reason) -> str:
    cause, errors = reason.params.get("cause"), reason.params.get("errors", ())
    only = errors[0] if isinstance(errors, tuple | list) and len(errors) == 1 else cause
    return only.code if isinstance(only, Reason) else ""


def _differing(reason: Reason) -> tuple[object, ...]:
    return tuple(str(value) for name, value in reason.params.items() if name not in SEVERAL + PASSING)


def _together(message: Message | None, members: list[Reason]) -> Told:
    reasons = tuple(bot.texts(members))
    if message is None:
        return Told(FAULT, reasons[0], "", reasons)
    params = dict(members[0].params)
    for name in SEVERAL:
        if name in params:
            params[name] = tuple(str(member.params[name]) for member in members)
    means = fill(message.means, params, bot.BY_NAME)
    return Told(message.kind, means[:1].upper() + means[1:], fill(message.do, params, bot.BY_NAME), reasons)

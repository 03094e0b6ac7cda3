"""`docs/reference/reasons.md`, made from the codes: `python -m tools.reasons_doc > docs/reference/reasons.md`.

With names of installed motor drivers (`python -m tools.reasons_doc samplemotor`) their own reasons are listed, too.
"""

import sys
from collections.abc import Iterable
from itertools import groupby
from string import Formatter

from truearc.hw import fault_codes
from truearc.hw.devices.registry import find_family
from truearc.hw.reason import NESTED, OPTIONAL, Code, Message
from truearc.robot import reasons
from truearc.robot.operator_ui.view import MESSAGES

HEAD = """# Reasons

A reason says why the robot holds or what is wrong with it: a code with parameters. Recordings keep the code, such as
`{"code": "device_stale", "params": {"device": "hood motor", "age_s": 0.312}}`. Made by `python -m tools.reasons_doc`.
"""
MESSAGE_HEAD = """
## What the operator's page says
Most important first. `fault`: something is not as it should be; `you`: it is the driver's turn; `wait`: it comes by
itself. The second column names a cause, or a motor's single error, for which the page has a message of its own.

| code | in case of | kind | the page says | what to do |
|---|---|---|---|---|"""
CODE_HEAD = """
## Codes
Names in ‹› are parameters; their ending is the unit. The third column has those that may be absent (`?`) or that
the text does not show. `cause` and `causes` are reasons themselves. A code without a message above is a cause of one
that has a message, or an error that stops a command before it starts. A motor driver of another distribution has its
own reasons, named `DRIVER.WHAT` (`MotorFamily.messages`).

| code | log text | more |
|---|---|---|"""


def make_page(drivers: Iterable[str] = ()) -> str:
    """The whole page, with the own reasons of these drivers."""
    own = [message for driver in drivers for message in find_family(driver).messages]
    codes = (*reasons.CODES, *fault_codes.CODES, *(message.code for message in own))
    alike = groupby((*own, *MESSAGES), key=lambda one: (one.code.name, one.kind, one.means, one.do))
    return "\n".join([HEAD.rstrip(), MESSAGE_HEAD, *(_message_row(list(group)) for _, group in alike), CODE_HEAD,
                      *map(_code_row, codes), ""])


def _message_row(alike: list[Message]) -> str:
    """A row for messages of one code that differ in their case alone."""
    first = alike[0]
    means = _shown(first.means)
    cases = ", ".join(f"`{message.case}`" for message in alike if message.case)
    return (f"| `{first.code.name}` | {cases} | {first.kind} | {means[:1].upper()}{means[1:]} | "
            f"{_shown(first.do)} |")


def _code_row(code: Code) -> str:
    text = _shown(code.text)
    more = ", ".join(f"`{name}{OPTIONAL if unit.endswith(OPTIONAL) else ''}`" for name, unit in code.params.items()
                     if unit.endswith(OPTIONAL) or f"‹{name}›" not in text)
    return f"| `{code.name}` | {text} | {more} |"


def _shown(template: str) -> str:
    """A template for people: each field as its name in angle brackets, and what stands around it."""
    return "".join(literal + ("" if name is None else _field(name, spec or ""))
                   for literal, name, spec, _ in Formatter().parse(template))


def _field(name: str, spec: str) -> str:
    return spec.replace(NESTED, f"‹{name}›") if NESTED in spec else f"‹{name}›"


if __name__ == "__main__":
    print(make_page(sys.argv[1:]), end="")

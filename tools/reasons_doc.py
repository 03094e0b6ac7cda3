"""`docs/reference/reasons.md`, made from the codes: `python -m tools.reasons_doc > docs/reference/reasons.md`.

With names of installed motor drivers (`python -m tools.reasons_doc samplemotor`) their own reasons are listed, too.
"""

import sys
from collections.abc import Iterable
from string import Formatter

from truearc.hw import fault_codes
from truearc.hw.devices.registry import find_family
from truearc.hw.reason import NESTED, OPTIONAL, Code, Message
from truearc.robot import reasons
from truearc.robot.operator_ui.driver_messages import MESSAGES

HEAD = """# Reasons

Why the robot holds, and what is wrong with it, is a code with parameters. Recordings keep it as such, for example
`{"code": "device_stale", "params": {"device": "hood motor", "age_s": 0.312}}`. Replay compares it and other code tests
it; text is made from it where people read. Made by `python -m tools.reasons_doc`.
"""
MESSAGE_HEAD = """
## What the operator's page says
Most important first. `fault`: something is not as it should be; `you`: it is the driver's turn; `wait`: it comes by
itself. The second column names a cause, or a motor's single error, for which the page has a message of its own.

| code | in case of | kind | the page says | what to do |
|---|---|---|---|---|"""
CODE_HEAD = """
## Codes
A parameter that ends in `?` may be absent. `cause` and `causes` are reasons themselves. A code without a
message above is a cause of one that has a message, or an error that stops a command before it starts.
A motor driver of another distribution has its own reasons, named `DRIVER.WHAT` (`MotorFamily.messages`).

| code | log text | parameters |
|---|---|---|"""


def make_page(drivers: Iterable[str] = ()) -> str:
    """The whole page, with the own reasons of these drivers."""
    own = [message for driver in drivers for message in find_family(driver).messages]
    codes = (*reasons.CODES, *fault_codes.CODES, *(message.code for message in own))
    return "\n".join([HEAD.rstrip(), MESSAGE_HEAD, *map(_message_row, (*own, *MESSAGES)), CODE_HEAD,
                      *map(_code_row, codes), ""])


def _message_row(message: Message) -> str:
    means = _shown(message.means)
    case = f"`{message.case}`" if message.case else ""
    return (f"| `{message.code.name}` | {case} | {message.kind} | {means[:1].upper()}{means[1:]} | "
            f"{_shown(message.do)} |")


def _code_row(code: Code) -> str:
    params = ", ".join(f"`{name}{OPTIONAL if unit.endswith(OPTIONAL) else ''}` [{unit.rstrip(OPTIONAL)}]"
                       for name, unit in code.params.items())
    return f"| `{code.name}` | {_shown(code.text)} | {params} |"


def _shown(template: str) -> str:
    """A template for people: each field as its name in angle brackets, and what stands around it."""
    return "".join(literal + ("" if name is None else _field(name, spec or ""))
                   for literal, name, spec, _ in Formatter().parse(template))


def _field(name: str, spec: str) -> str:
    return spec.replace(NESTED, f"‹{name}›") if NESTED in spec else f"‹{name}›"


if __name__ == "__main__":
    print(make_page(sys.argv[1:]), end="")

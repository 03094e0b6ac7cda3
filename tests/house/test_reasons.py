"""Reasons are complete: every code has its text, parameters and message, and is made somewhere."""

import ast
import string
from pathlib import Path

from tests.robot.samples import check, sample
from truearc.hw import fault_codes
from truearc.hw.reason import OPTIONAL
from truearc.robot import reasons
from truearc.robot.operator_ui.view import MESSAGES

ROOT = Path(__file__).parents[2]
CODES = (*fault_codes.CODES, *reasons.CODES)
DECLARING = (ROOT / "hw" / "fault_codes.py", ROOT / "robot" / "reasons.py")
TELLING = (ROOT / "robot" / "operator_ui" / "view.py",)
KINDS = {"text", "count", "flag", "motor", "device", "texts", "counts", "reason", "reasons"}
UNITS = {"s", "m", "m/s", "deg", "rad/s", "Nm", "px", "ms", "ratio", "share", "probability", "of the signal",
         "of the parameter"}
SUFFIXES = {"s": "_s", "m": "_m", "deg": "_deg", "rad/s": "_rad_s", "Nm": "_nm", "px": "_px", "ms": "_ms"}


def calls():
    """(code constant, keyword names, place) of every call of a code in the product."""
    for path in (path for room in ("hw", "robot", "truearc", "frc") for path in (ROOT / room).rglob("*.py")):
        if path in DECLARING or path in TELLING:
            continue
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            name = node.attr if isinstance(node, ast.Attribute) else node.id if isinstance(node, ast.Name) else ""
            if name.lower() in NAMES and name.isupper():
                yield name, None, path
            if is_reason(node):
                yield called(node), {word.arg for word in node.keywords}, f"{path.name}:{node.lineno}"


def called(call):
    return call.func.attr if isinstance(call.func, ast.Attribute) else getattr(call.func, "id", "")


def is_reason(node):
    """Whether a reason is made there, by calling its code."""
    return isinstance(node, ast.Call) and called(node).lower() in NAMES and called(node).isupper()


NAMES = {code.name for code in CODES}
CALLS = list(calls())


def test_a_code_declares_its_parameters_and_words_them():
    for code in CODES:
        fields = {name for _, name, _, _ in string.Formatter().parse(code.text) if name is not None}
        assert fields <= code.params.keys(), code.name
        for name, unit in code.params.items():
            unit = unit.rstrip(OPTIONAL)
            assert unit in KINDS | UNITS, (name, unit)
            assert name.endswith(SUFFIXES.get(unit, "")), f"{name} is in {unit}"
        reason = sample(code)
        check(reason)
        assert reasons.text(reason) and "{" not in reasons.text(reason), code.name


def test_a_code_is_made_somewhere():
    assert {code.name.upper() for code in CODES} - {name for name, _, _ in CALLS} == set()


def test_every_reason_is_made_with_the_parameters_that_its_code_declares():
    for name, keywords, place in CALLS:
        if keywords is None or None in keywords:  # named, or made with **
            continue
        code = next(code for code in CODES if code.name == name.lower())
        needed = {param for param, unit in code.params.items() if not unit.endswith(OPTIONAL)}
        later = {"device", "frame"} if name in ("FRAME_LENGTH", "FRAME_VALUE", "FRAME_SIGNALS") else set()
        assert needed - later <= keywords <= code.params.keys(), f"{place}: {name}"


def test_every_code_has_a_message_or_is_the_cause_of_one_that_has():
    own = {message.code.name for message in MESSAGES}
    alone = [code.name for code in CODES if code.name not in own]
    causes = {code.name for code in CODES if "cause" not in code.params and code.name not in own}
    assert set(alone) == causes, "a reason with a cause of its own needs a message"
    for name, keywords, place in CALLS:           # what is in no cause is in the tick, and needs a message
        if keywords is not None and Path(str(place).split(":")[0]).name in ("verdict.py", "rig.py", "watch.py"):
            assert name.lower() in own, f"{place}: {name} has no message"

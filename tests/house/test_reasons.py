"""Reasons are complete: every code has its text, parameters and message, is made somewhere, and is in the docs."""

import ast
import builtins
import re
import string
from pathlib import Path

import pytest

from tests.robot.samples import check, sample
from truearc.hw import fault_codes
from truearc.hw.reason import OPTIONAL, Code
from truearc.robot import reasons
from truearc.robot.operator_ui.view import MESSAGES

ROOT = Path(__file__).parents[2]
CODES = (*fault_codes.CODES, *reasons.CODES)
DECLARING = (ROOT / "hw" / "fault_codes.py", ROOT / "robot" / "reasons.py")
TELLING = (ROOT / "robot" / "operator_ui" / "view.py",)
KINDS = {"text", "count", "flag", "motor", "device", "texts", "counts", "reason", "reasons"}
UNITS = {"s", "m", "m/s", "deg", "rad/s", "Nm", "px", "ms", "ratio", "share", "probability", "of the signal",
         "of the parameter"}
SENTENCE = re.compile(r"[A-Za-z]{2,}\W+[A-Za-z]{2,}")
NAMING = {"device", "controller", "bus", "motor"}  # "canandmag device " is a name
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


def params_in(tree):
    """(name, expression) of every parameter of every reason that is made in `tree`."""
    for node in ast.walk(tree):
        if is_reason(node):
            yield from ((word.arg, word.value) for word in node.keywords if word.arg not in NAMING)


def has_sentence(expression):
    return any(isinstance(part, ast.Constant) and isinstance(part.value, str) and SENTENCE.search(part.value)
               for part in ast.walk(expression))


def sentences_in(source):
    """Lines at which a parameter of a reason gets a sentence, directly or as an argument of the function around it."""
    tree = ast.parse(source)
    lines = [value.lineno for _, value in params_in(tree) if has_sentence(value)]
    for function in (node for node in ast.walk(tree) if isinstance(node, ast.FunctionDef)):
        own = [arg.arg for arg in (*function.args.args, function.args.vararg, *function.args.kwonlyargs) if arg]
        passed = {part.id for _, value in params_in(function) for part in ast.walk(value) if isinstance(part, ast.Name)}
        if passed & set(own):
            lines += [call.lineno for call in ast.walk(tree) if isinstance(call, ast.Call)
                      and called(call) == function.name
                      and any(map(has_sentence, (*call.args, *(word.value for word in call.keywords))))]
    return lines


NAMES = {code.name for code in CODES}
CALLS = list(calls())


@pytest.mark.parametrize("module", [fault_codes, reasons])
def test_a_constant_has_the_name_of_its_code(module):
    named = {name: code for name, code in vars(module).items() if isinstance(code, Code)}
    assert len(named) == len(module.CODES) and all(name.lower() == code.name for name, code in named.items())


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


@pytest.mark.parametrize(("source", "lines"), [
    ('PIPE_CLOSED(detail="the sender has ended")', [1]), ('hw.PIPE_CLOSED(detail=f"ended: {name} has gone")', [1]),
    ('PIPE_CLOSED(detail=str(error))', []), ('PERIOD_RANGE(device=f"canandmag device {number}", period_ms=0)', []),
    ('def _said(words):\n    return PIPE_CLOSED(detail=words)\n_said("it has ended")\n_said("TxSdo")', [3]),
    ('def _said(*, words):\n    return PIPE_CLOSED(detail=words[:9])\n_said(words="it has ended")', [3])])
def test_a_sentence_in_a_parameter_is_found(source, lines):
    assert sentences_in(source) == lines


def test_no_parameter_of_a_reason_has_a_sentence_of_ours():
    rooms = [ROOT / room for room in ("hw", "robot", "sim", "truearc", "examples")]
    for path in (path for room in rooms for path in room.rglob("*.py")):
        assert sentences_in(path.read_text(encoding="utf-8")) == [], f"{path}: a sentence is a code"


def test_no_recording_error_that_becomes_a_reason_has_a_sentence_of_ours():
    for path in (ROOT / "robot" / "recording").glob("*.py"):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.Raise) and isinstance(node.exc, ast.Call):
                kind = getattr(builtins, called(node.exc), None)
                assert not (kind and issubclass(kind, OSError) and has_sentence(node.exc)), f"{path}:{node.lineno}"


def test_every_code_has_a_message_or_is_the_cause_of_one_that_has():
    own = {message.code.name for message in MESSAGES}
    alone = [code.name for code in CODES if code.name not in own]
    causes = {code.name for code in CODES if "cause" not in code.params and code.name not in own}
    assert set(alone) == causes, "a reason with a cause of its own needs a message"
    for name, keywords, place in CALLS:           # what is in no cause is in the tick, and needs a message
        if keywords is not None and Path(str(place).split(":")[0]).name in ("verdict.py", "rig.py", "watch.py"):
            assert name.lower() in own, f"{place}: {name} has no message"

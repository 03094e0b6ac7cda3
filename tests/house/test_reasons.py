"""Reasons are complete: every code has its text and a message, and is made with the parameters that it declares."""

import ast
import string
from collections.abc import Iterator
from pathlib import Path

from tests.robot.samples import check, sample
from truearc.hw import fault_codes
from truearc.hw.reason import OPTIONAL
from truearc.robot import reasons
from truearc.robot.operator_ui.view import MESSAGES

ROOT = Path(__file__).parents[2]
CODES = {code.name.upper(): code for code in (*fault_codes.CODES, *reasons.CODES)}
DECLARING = (ROOT / "hw" / "fault_codes.py", ROOT / "robot" / "reasons.py")


def calls() -> Iterator[tuple[str, set[str | None], str]]:
    """(code, keyword names, place) of every reason that the product makes."""
    for path in (path for room in ("hw", "robot", "truearc", "frc") for path in (ROOT / room).rglob("*.py")):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))) if path not in DECLARING else ():
            if isinstance(node, ast.Call):
                name = getattr(node.func, "attr", getattr(node.func, "id", ""))
                if name in CODES:
                    yield name, {word.arg for word in node.keywords}, f"{path.name}:{node.lineno}"


def test_a_code_words_its_parameters() -> None:
    for code in CODES.values():
        fields = {name for _, name, _, _ in string.Formatter().parse(code.text) if name is not None}
        assert fields <= code.params.keys(), code.name
        reason = sample(code)
        check(reason)
        assert reasons.text(reason) and "{" not in reasons.text(reason), code.name


def test_every_reason_is_made_with_the_parameters_that_its_code_declares() -> None:
    made = list(calls())
    assert len(made) > 100
    for name, keywords, place in made:
        if None not in keywords:      # nor made with **
            params = CODES[name].params
            needed = {param for param, unit in params.items() if not unit.endswith(OPTIONAL)}
            later = {"device", "frame"} if name in ("FRAME_LENGTH", "FRAME_VALUE", "FRAME_SIGNALS") else set()
            assert needed - later <= keywords <= params.keys(), f"{place}: {name}"


def test_every_code_has_a_message_or_is_the_cause_of_one_that_has() -> None:
    own = {message.code.name for message in MESSAGES}
    alone = {code.name for code in CODES.values() if code.name not in own}
    assert alone == {code.name for code in CODES.values() if "cause" not in code.params and code.name not in own}
    for name, _, place in calls():    # what is in no cause is in the tick
        assert place.partition(":")[0] not in ("verdict.py", "rig.py", "watch.py") or name.lower() in own, place

"""Text of reasons."""

from truearc.hw.fault_codes import BOX_LINES_REFUSED, BY_NAME
from truearc.hw.reason import render


def test_unprintable_characters_of_a_parameter_are_escaped() -> None:
    assert render(BOX_LINES_REFUSED(lines=2, first="\0q\n"), BY_NAME) == "button box: 2 lines refused, first \\x00q\\n"

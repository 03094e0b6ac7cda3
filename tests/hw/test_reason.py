"""Text of reasons."""

import pytest

from truearc.hw.fault_codes import BOX_LINES_REFUSED, BY_NAME
from truearc.hw.reason import Code, render


def test_unprintable_characters_of_a_parameter_are_escaped() -> None:
    assert render(BOX_LINES_REFUSED(lines=2, first="\0q\n"), BY_NAME) == "button box: 2 lines refused, first \\x00q\\n"


def test_a_number_whose_name_has_no_unit_must_be_declared() -> None:
    """Taken for text it would not be kept from being infinite."""
    with pytest.raises(ValueError, match="code odd: declare the unit of share"):
        Code("odd", "off by {share:.2f}")
    assert Code("odd", "off by {share:.2f}", {"share": "1"}).has_numbers
    assert Code("odd", "off by {share_rad:.2f} of {what}").params == {"share_rad": "rad", "what": "text"}

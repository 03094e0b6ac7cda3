"""The button box's line protocol: whatever the cable does to it, no press that was not made; and text of reasons."""

import re
from itertools import pairwise
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from truearc.hw.devices import button_box as buttons
from truearc.hw.fault_codes import BOX_LINES_REFUSED, BY_NAME
from truearc.hw.protocols import ButtonEvent
from truearc.hw.reason import Code, render

PAGE = Path(__file__).parents[2] / "docs" / "how-to" / "button-box.md"
seqs = st.integers(0, 65535)
events = st.one_of(st.builds(ButtonEvent, st.just(5), seqs, st.sampled_from(buttons.BUTTONS)),
                   st.builds(buttons.BoxHeartbeat, st.just(5), seqs))


def say(event: ButtonEvent | buttons.BoxHeartbeat) -> bytes:
    is_press = isinstance(event, ButtonEvent)
    return buttons.make_press(event.seq, event.button) if is_press else buttons.make_heartbeat(event.seq)


def hear(chunks: list[bytes]) -> tuple[list[ButtonEvent | buttons.BoxHeartbeat], list[str]]:
    heard, rest, faults = [], b"", []
    for chunk in chunks:
        more, rest, wrong = buttons.parse_lines(rest, chunk, 5)
        assert len(rest) <= buttons.LONGEST and len(wrong) <= 1
        heard += more
        faults += wrong
    return heard, faults


def test_the_page_for_builders_is_right() -> None:
    text = PAGE.read_text(encoding="utf-8")
    lines = re.findall(r"^\$[BH],\d+.*\*[0-9A-F]{2}$", text, re.MULTILINE)
    heard, faults = hear([line.encode() + b"\r\n" for line in lines])
    assert heard == [buttons.BoxHeartbeat(5, 0), ButtonEvent(5, 1, "arm"), ButtonEvent(5, 2, "fire")] and not faults
    assert re.findall(r"^\| `([a-z-]+)` \|", text, re.MULTILINE) == list(buttons.BUTTONS)


def test_checksum_unknown_buttons_and_gaps() -> None:
    # the check value that catalogues of CRCs give for CRC-8/SMBUS
    assert buttons._crc(b"123456789") == 0xF4
    with pytest.raises(ValueError, match="launch"):
        buttons.make_press(1, "launch")
    assert [buttons.lost_presses(*seqs) for seqs in ((65535, 0), (65534, 1), (3, 4))] == [0, 2, 0]


@given(said=st.lists(events, max_size=8), cuts=st.lists(st.integers(0, 200), max_size=10))
def test_any_chunking_gives_what_was_said(said, cuts) -> None:
    line = b"".join(say(event) for event in said)
    edges = [0, *sorted(min(cut, len(line)) for cut in cuts), len(line)]
    heard, faults = hear([line[a:b] for a, b in pairwise(edges)])
    assert heard == said and not faults


@given(said=st.lists(events, min_size=1, max_size=3), bit=st.integers(0, 7), data=st.data())
def test_a_flipped_bit_loses_a_line_but_never_changes_one(said, bit, data) -> None:
    whole = bytearray(b"".join(say(event) for event in said))
    whole[data.draw(st.integers(0, len(whole) - 1))] ^= 1 << bit
    heard, _ = hear([bytes(whole)])
    assert len(said) - 2 <= len(heard) < len(said)          # the line that was hit, and the next if an end was hit
    remaining = iter(said)
    assert all(event in remaining for event in heard)       # in order, and nothing that was not said


@given(garbage=st.lists(st.binary(max_size=300), max_size=10))
def test_garbage_never_raises_or_grows(garbage) -> None:
    hear(garbage)


def test_what_is_no_line_is_a_fault_and_costs_no_other() -> None:
    heard, faults = hear([b"x" * 100_000, b"\n", buttons.make_press(9, "two")])
    assert heard == [ButtonEvent(5, 9, "two")]
    assert len(faults) == 2 and all(len(fault.params["first"]) <= buttons.LONGEST for fault in faults)
    heard, faults = hear([b"\xff\x00" + buttons.make_press(9, "two")])
    assert heard == [ButtonEvent(5, 9, "two")] and len(faults) == 1
    heard, faults = hear([buttons.make_press(1, "arm")[1:]])
    assert not heard and len(faults) == 1


@pytest.mark.parametrize("body", [b"B,1,launch", b"B,01,arm", b"B,65536,arm", b"B,-1,arm", b"B,1,ARM", b"H,",
                                  b"B,1,arm "])
def test_a_right_checksum_does_not_make_a_wrong_line_right(body: bytes) -> None:
    heard, faults = hear([b"$%b*%02X\r\n" % (body, buttons._crc(body))])
    assert not heard and len(faults) == 1


def test_unprintable_characters_of_a_parameter_are_escaped() -> None:
    assert render(BOX_LINES_REFUSED(lines=2, first="\0q\n"), BY_NAME) == "button box: 2 lines refused, first \\x00q\\n"


def test_a_number_whose_name_has_no_unit_must_be_declared() -> None:
    """Taken for text it would not be kept from being infinite."""
    with pytest.raises(ValueError, match="code odd: declare the unit of share"):
        Code("odd", "off by {share:.2f}")
    assert Code("odd", "off by {share:.2f}", {"share": "1"}).has_numbers
    assert Code("odd", "off by {share_rad:.2f} of {what}").params == {"share_rad": "rad", "what": "text"}

"""Every built-in family of motor controllers does what it declares, and frames are those of our own DBC files."""

import math
import struct
from functools import cache

import cantools
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.hw.dbc_facts import is_float, length, limits, messages
from tests.hw.family_checks import CHECKS, check_frames, codec_of
from truearc.hw.codec import DBC, load_codec
from truearc.hw.devices.registry import BY_DRIVER, FAMILIES, drivers, find_family
from truearc.hw.fault_codes import FRAME_LENGTH
from truearc.hw.protocols import BadFrame

names = pytest.mark.parametrize("family", FAMILIES, ids=lambda family: family.driver)


@names
@pytest.mark.parametrize("check", CHECKS, ids=lambda check: check.__name__)
def test_a_family_passes(check, family) -> None:
    check(family)


@pytest.mark.parametrize("family", [one for one in FAMILIES if one.dbc], ids=lambda family: family.driver)
def test_its_frames_come_back_as_they_went_out(family) -> None:
    check_frames(codec_of(family))


def test_a_driver_that_does_not_exist_is_an_error() -> None:
    assert set(BY_DRIVER) <= set(drivers())
    with pytest.raises(LookupError):
        find_family("sprak")


ODRIVE, CANANDMAG, SPARK = load_codec("odrive"), load_codec("canandmag"), load_codec("spark")
MESSAGES = [(codec, name) for codec in (ODRIVE, CANANDMAG, SPARK) for name in messages(codec)]


def test_missing_and_unknown_signals_are_named() -> None:
    with pytest.raises(BadFrame, match="velocity_rev_s"):
        ODRIVE.make("Set_Limits", {"current_a": 1.0})
    with pytest.raises(BadFrame, match="torque"):
        ODRIVE.make("Set_Input_Torque", {"torque_nm": 1.0, "torque": 1.0})


@pytest.mark.parametrize(("codec", "name"), MESSAGES)
@given(data=st.binary(max_size=12))
def test_any_bytes_are_parsed_or_refused(codec, name, data) -> None:
    try:
        values = codec.parse(name, data)
    except BadFrame as error:
        assert name in str(error) and codec.name in str(error)
        if len(data) != length(codec, name):
            assert error.reason == FRAME_LENGTH(message=f"{codec.name} {name}", bytes=len(data),
                                                wanted_bytes=length(codec, name))
        return
    assert len(data) == length(codec, name)
    assert all(math.isfinite(value) for value in values.values())
    assert codec.parse(name, codec.make(name, values)) == values


@cache
def reference(codec_name):
    return cantools.database.load_file(DBC / f"{codec_name}.dbc")


@pytest.mark.parametrize(("codec", "name"), [(codec, name) for codec, name in MESSAGES if limits(codec, name)])
@given(draw=st.data())
def test_packing_by_layout_is_what_cantools_gives(codec, name, draw) -> None:
    """The reference is cantools on the same file, asked directly."""
    message = reference(codec.name).get_message_by_name(name)
    values = {signal: draw.draw(st.floats(low, high, width=32) if is_float(codec, name, signal)
                                else st.integers(math.ceil(low), math.floor(high)))
              for signal, (low, high) in limits(codec, name).items()
              if not is_float(codec, name, signal) or (low, high) == tuple(map(as_single, (low, high)))}
    if values.keys() != limits(codec, name).keys() or any(signal.scale != 1 for signal in message.signals):
        return
    data = codec.make(name, values)
    assert data == message.encode(values, strict=False)
    assert codec.parse(name, data) == message.decode_simple(data, decode_choices=False)


def as_single(value: float) -> float:
    return float(struct.unpack("<f", struct.pack("<f", value))[0])

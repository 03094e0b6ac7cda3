"""Canandmag frames against the public facts, and against somebody else's DBC file."""

import math

import cantools
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.hw.dbc_facts import length
from truearc.hw.codec import load_codec
from truearc.hw.devices import canandmag
from truearc.hw.protocols import AngleReading, BadFrame, Frame

ENCODER = 5
POSITION_ID, STATUS_ID = 0x070E07C5, 0x070E0185


def frame(frame_id: int, data: bytes, t_ns: int = 7) -> Frame:
    return Frame(t_ns, frame_id, data, is_extended=True)


def test_the_known_position_frame_and_a_status_alone() -> None:
    # relative 1.5 turns, magnet in range, absolute a quarter turn
    reading = canandmag.parse(ENCODER, frame(POSITION_ID, bytes.fromhex("006000000040")), None)
    assert reading == AngleReading(7, math.pi / 2, True, faults_t_ns=0)
    assert canandmag.parse(ENCODER, frame(STATUS_ID, bytes(8)), None) is None


@given(counts=st.integers(0, 16383), status=st.integers(0, 3), relative=st.integers(-(1 << 31), (1 << 31) - 1))
def test_angle_is_fourteen_bits_of_a_turn(counts: int, status: int, relative: int) -> None:
    data = (relative & 0xFFFFFFFF | status << 32 | counts << 34).to_bytes(6, "little")
    reading = canandmag.parse(ENCODER, frame(POSITION_ID, data), None)
    assert reading is not None
    assert reading.angle_rad == pytest.approx(math.tau * counts / 16384) and 0.0 <= reading.angle_rad < math.tau
    assert reading.magnet_ok == (status == 0)


def test_a_fault_that_spoils_the_angle_outlasts_the_next_angle() -> None:
    good, hardware = bytes.fromhex("006000000040"), bytes([0x10, 0, 25, 0, 0, 0, 0, 0])
    reading = canandmag.parse(ENCODER, frame(POSITION_ID, good), None)
    reading = canandmag.parse(ENCODER, frame(STATUS_ID, hardware), reading)
    assert reading is not None and not reading.magnet_ok and canandmag.fault_words(reading.faults) == ("hardware",)
    reading = canandmag.parse(ENCODER, frame(POSITION_ID, good, 8), reading)
    assert reading is not None and not reading.magnet_ok
    reading = canandmag.parse(ENCODER, frame(STATUS_ID, bytes([0x04, 4, 25, 0, 0, 0, 0, 0]), 8), reading)
    reading = canandmag.parse(ENCODER, frame(POSITION_ID, good, 9), reading)
    assert reading == AngleReading(9, math.pi / 2, True, faults=0x04, faults_t_ns=8)


@pytest.mark.parametrize("data", [b"", bytes(5), bytes(7)])
def test_wrong_lengths_are_refused_by_name(data: bytes) -> None:
    with pytest.raises(BadFrame, match=f"device 5, id 0x070e07c5: canandmag POSITION_OUTPUT: {len(data)} bytes"):
        canandmag.parse(ENCODER, frame(POSITION_ID, data), None)


def test_foreign_frames_and_impossible_periods_are_refused() -> None:
    with pytest.raises(BadFrame, match="0x070e07c6"):
        canandmag.parse(ENCODER, frame(POSITION_ID + 1, bytes(6)), None)
    for period_ms in (0, -1, 65536):
        with pytest.raises(BadFrame, match="period"):
            canandmag.make_position_period(ENCODER, period_ms)


THEIRS = {
    "POSITION_OUTPUT": ("position_output", {"relative_rev": "relative_position", "magnet_status": "magnet_status",
                                            "absolute_rev": "absolute_position"}),
    "VELOCITY_OUTPUT": ("velocity_output", {"velocity_rev_s": "velocity", "magnet_status": "magnet_status"}),
    "CLEAR_STICKY_FAULTS": ("clear_sticky_faults", {}),
    "REPORT_SETTING": ("report_setting", {"setting": "address", "value": "value", "accepted": "flags_set_success",
                                          "committed": "flags_commit_success"}),
    "SETTING_COMMAND": ("setting_command", {"command": "control_flag", "setting": "setting_index"}),
    "SET_SETTING": ("set_setting", {"setting": "address", "value": "value",
                                    "ephemeral": "setting_flags_ephemeral"})}


@pytest.fixture(scope="module")
def theirs(data_dir) -> cantools.database.Database:
    return cantools.database.load_file(data_dir / "dbc" / "canandmag_fixed.dbc", strict=False)


@pytest.mark.data
@pytest.mark.parametrize("name", sorted(THEIRS))
@given(data=st.data())
def test_bytes_agree_with_the_makers_dbc(theirs, name: str, data: st.DataObject) -> None:
    codec, (their_name, signals) = load_codec("canandmag"), THEIRS[name]
    message = theirs.get_message_by_name(their_name)
    assert (codec.base_id(name), length(codec, name)) == (message.frame_id, message.length)
    random = data.draw(st.binary(min_size=message.length, max_size=message.length))
    meant = message.decode(random, decode_choices=False)
    values = {ours: meant[their] for ours, their in signals.items()}
    assert codec.parse(name, random) == values
    reserved = {signal: 0 for signal in meant if signal not in signals.values()}
    ours_bytes = codec.make(name, values)
    assert message.decode(ours_bytes, decode_choices=False) == {**meant, **reserved}


@pytest.mark.data
@given(data=st.binary(min_size=8, max_size=8))
def test_status_agrees_with_the_makers_dbc(theirs, data: bytes) -> None:
    meant = theirs.get_message_by_name("status").decode(data, decode_choices=False)
    ours = load_codec("canandmag").parse("STATUS", data)
    assert ours["temperature_degc"] == meant["temperature"]
    words = canandmag.fault_words(int(ours["faults"]))
    names = {"power cycle": "power_cycle", "id conflict": "can_id_conflict", "CAN error": "can_general_error",
             "temperature": "out_of_temperature_range", "hardware": "hardware_fault",
             "magnet out of range": "magnet_out_of_range", "supply low": "under_volt"}
    assert {word for word, name in names.items() if meant[f"faults_{name}"]} == set(words)


@pytest.mark.data
@given(period_ms=st.integers(1, 65535), device=st.integers(0, 63))
def test_what_the_driver_sends_reads_there_as_meant(theirs, period_ms: int, device: int) -> None:
    sent = canandmag.make_position_period(device, period_ms)
    message = theirs.get_message_by_frame_id(sent.arbitration_id - device)
    assert sent.is_extended and message.name == "set_setting"
    meant = message.decode(sent.data, decode_choices=False)
    assert (meant["address"], meant["value"], meant["setting_flags_ephemeral"]) == (253, period_ms, 1)

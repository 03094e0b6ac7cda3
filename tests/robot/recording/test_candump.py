"""Candump lines, against themselves and against python-can's own reader."""

import can
from hypothesis import given
from hypothesis import strategies as st

from truearc.hw.protocols import Frame
from truearc.robot.recording.files import candump_line, parse_candump


@st.composite
def frames(draw):
    extended, remote = draw(st.booleans()), draw(st.booleans())
    data = bytes(draw(st.integers(0, 8))) if remote else draw(st.binary(max_size=8))
    return Frame(draw(st.integers(0, 10**15)) * 1000, draw(st.integers(0, 0x1FFFFFFF if extended else 0x7FF)), data,
                 extended, remote)


@given(frame=frames(), sent=st.booleans(), t_us=st.integers(0, 10**12))
def test_a_line_says_all_of_a_frame(frame, sent, t_us):
    line = candump_line(frame, sent, t_us * 1000)
    assert parse_candump(line) == ((frame._replace(t_ns=0) if sent else frame), sent)
    assert parse_candump(line[:-1]) is None            # torn


@given(text=st.text(max_size=60))
def test_any_other_line_is_none(text):
    assert parse_candump(text) is None


def test_a_recorded_log_is_read_alike_by_python_can(plain):
    lines = [parse_candump(line) for line in (plain / "can0.log").open()]
    messages = list(can.CanutilsLogReader(plain / "can0.log"))
    assert len(messages) == len(lines) > 3000
    for (frame, sent), message in zip(lines, messages, strict=True):
        data = bytes(message.dlc) if message.is_remote_frame else bytes(message.data)
        assert (frame.arbitration_id, frame.data, frame.is_extended, frame.is_remote) == (
            message.arbitration_id, data, message.is_extended_id, message.is_remote_frame)
        assert message.is_rx is not sent
        assert sent or frame.t_ns == round(message.timestamp * 1e6) * 1000

"""Sentences of format 1 are read as codes, without loss, and written as they were."""

import msgspec
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.robot.samples import check
from truearc.hw import fault_codes as hw
from truearc.hw.reason import OPTIONAL, Reason
from truearc.robot import reasons as bot
from truearc.robot.recording.rows import Trial
from truearc.robot.recording.schema1 import Rows1, load_forms, read, write
from truearc.robot.types import Outcome

STUCK = "feeder motor: odrive node 4 says 126 rad/s, but its position stands still: encoder stuck?"
SENTENCES = (
    ("not armed", bot.NOT_ARMED()),
    ("not armed: the button box lost presses", bot.DISARMED_BY_BOX(cause=hw.BOX_PRESSES_LOST())),
    ("hood motor silent for 0.31 s", bot.DEVICE_STALE(device="hood motor", age_s=0.31)),
    ("hood encoder has said nothing of its faults yet",    # prose: allow
     bot.DEVICE_FAULTS_NEVER_RECEIVED(device="hood encoder")),
    ("wheels at nan rad/s, wanted 359", bot.WHEELS_OFF_SPEED(speed_rad_s=float("nan"), wanted_rad_s=359.0)),
    ("target last seen -0.4 s ago (2 things in view look like the target)",
     bot.TARGET_STALE(age_s=-0.4, cause=bot.SEVERAL_TARGETS(count=2))),
    ("target seen inf m away, give or take 0.0",    # prose: allow
     bot.TARGET_IMPLAUSIBLE(distance_m=float("inf"), sigma_m=0.0)),
    ("model: three points 27% likely, 30% needed", bot.MODEL_BELOW_THRESHOLD(p_three=0.27, threshold=0.3)),
    ("CAN lost: CAN slcan /dev/ttyACM0: bus off", bot.CAN_LOST(cause=hw.CAN_BUS_OFF(bus="CAN slcan /dev/ttyACM0"))),
    ("CAN lost: CAN slcan /dev/ttyACM0: Could not read: gone",
     bot.CAN_LOST(cause=hw.CAN_ADAPTER_ERROR(bus="CAN slcan /dev/ttyACM0", detail="Could not read: gone"))),
    ("camera lost: camera 0: gives no images", bot.CAMERA_LOST(cause=hw.CAMERA_SILENT(camera="0"))),
    ("not recording: No space left on device", bot.NOT_RECORDING(cause=bot.DISK_FULL())),
    ("not recording: Read-only file system", bot.NOT_RECORDING(cause=bot.DISK_ERROR(detail="Read-only file system"))),
    ("not recording: can0.log has been deleted", bot.NOT_RECORDING(cause=bot.FILE_DELETED(file="can0.log"))),
    ("not recording: 000000007.png: the image cannot be encoded",
     bot.NOT_RECORDING(cause=bot.IMAGE_NOT_ENCODED(file="000000007.png"))),
    ("not recording: the disk took nothing for so long that the rest is not kept",
     bot.NOT_RECORDING(cause=bot.DISK_BACKLOG_FULL())),
    ("spark 3: frame 0x0205b883 is not one of its readings",
     hw.FRAME_UNEXPECTED(device="spark 3", frame="0x0205b883", wanted=("one of its readings",))),
    ("bad frame: odrive node 1, id 0x029: odrive Heartbeat: 3 bytes instead of 8",
     bot.BAD_FRAME(cause=hw.FRAME_LENGTH(device="odrive node 1", frame="0x029", message="odrive Heartbeat", bytes=3,
                                         wanted_bytes=8))),
    ("button box: 1 lines refused, first b'$B,7,fi\\x80e*00\\r'",
     hw.BOX_LINES_REFUSED(lines=1, first="$B,7,fi\x80e*00\r")),
    ("hood motor: has reset (was the supply interrupted?), too hot",
     bot.MOTOR_ERROR(motor="hood motor", errors=(hw.ERROR_HAS_RESET(), hw.ERROR_OVER_TEMPERATURE()))),
    (STUCK, hw.ENCODER_STUCK(motor="feeder motor", controller="odrive node 4", speed_rad_s=126.0)),
    ("hood motor: spark 3 has not taken parameters 70, 53",
     hw.SPARK_SETTINGS_UNCONFIRMED(motor="hood motor", spark=3, parameters=(70, 53))),
    ("identify: hood ramp down (4 of 19)",
     bot.IDENTIFY_RUNNING(joint="hood", phase="ramp", sign=-1, number=4, last=19)),
    (f"identify: CAN lost: CAN can0: bus off; {STUCK}",
     bot.IDENTIFY_STOPPED(causes=(bot.CAN_LOST(cause=hw.CAN_BUS_OFF(bus="CAN can0")), read(STUCK)))),
    ("identify: hood motor: spark 3 runs firmware 24.0.1; only 25 to 26 are understood here: update it with its "
     "maker's tool; hood angle unknown",
     bot.IDENTIFY_STOPPED(causes=(hw.SPARK_FIRMWARE_UNSUPPORTED(motor="hood motor", spark=3, version="24.0.1",
                                                                oldest=25, newest=26), bot.HOOD_UNKNOWN()))),
)


@pytest.mark.parametrize(("sentence", "reason"), SENTENCES, ids=[sentence for sentence, _ in SENTENCES])
def test_a_sentence_is_a_code_with_parameters_and_back(sentence, reason):
    assert read(sentence) == reason and write(reason) == sentence
    check(reason)


def values(form, name):
    """What stood for a parameter in a sentence of this form."""
    unit = form.code.params[name].rstrip(OPTIONAL)
    if name in form.fixed:
        return st.just(form.fixed[name])
    kinds = {"count": st.integers(0, 9999), "px": st.integers(0, 9999), "motor": st.just("hood motor"),
             "device": st.just("flywheel motor 2"), "texts": st.just(("spinout", "watchdog expired")),
             "counts": st.just((70, 71)), "reason": st.just(bot.TAPE_NARROW()), "reasons": st.just((bot.NO_AIM(),)),
             "text": st.from_regex("[a-z]{1,8}", fullmatch=True)}
    return kinds.get(unit, st.floats(-1e3, 1e3).map(lambda value: round(value, 4)))


@pytest.mark.parametrize("form", load_forms(), ids=lambda form: form.template)
@settings(max_examples=30)          # of 130 forms each, most of which have one parameter or none
@given(data=st.data())
def test_every_form_is_read_again_as_its_own_code(form, data):
    names = [name for name in form.code.params if "{" + name in form.template or name in form.fixed]
    box = data.draw(st.sampled_from([hw.BOX_RESTARTED(), hw.BOX_PRESSES_LOST()]))
    params = {name: box if "{cause:box}" in form.template and name == "cause" else data.draw(values(form, name))
              for name in names}
    sentence = write(Reason(form.code.name, params))
    again = read(sentence, form.within)
    assert write(again) == sentence
    assert again.code == form.code.name or bot.LEGACY_TEXT.name in (again.code, form.code.name), again


@given(st.text())
def test_any_text_is_kept_whole(sentence):
    assert write(read(sentence)) == sentence


def test_a_sentence_that_no_code_stands_for_is_kept_as_it_is():
    assert read("the moon is full") == bot.LEGACY_TEXT(text="the moon is full")
    assert read("hood motor: howls") == bot.LEGACY_TEXT(text="hood motor: howls")


def test_a_trial_of_format_1_is_read_and_written():
    row = b'{"outcome":{"trial":3,"t_ns":5,"outcome":"held","reasons":["no aim","the moon is full"]},"shot":null}'
    trial = Rows1().decode_trial(row)
    assert trial == Trial(Outcome(3, 5, "held", (bot.NO_AIM(), bot.LEGACY_TEXT(text="the moon is full"))), None)
    assert Rows1().encode_trial(trial) == row


@pytest.mark.parametrize("row", [b"[]", b"{}", b"7", b'{"inputs":{},"memory":{}}', b'{"outcome":3}'])
def test_what_is_no_row_is_refused(row):
    for decode in (Rows1().decode_tick, Rows1().decode_trial):
        with pytest.raises(msgspec.MsgspecError):
            decode(row)

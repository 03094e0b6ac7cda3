"""Every sentence that sessions of format truearc.session/1 have for a reason, as a template over its parameters.

For `truearc.robot.recording.schema1` alone: nothing is added here, and no wording changes.
"""

from collections.abc import Mapping
from typing import Any, NamedTuple

from truearc.hw import fault_codes as hw
from truearc.hw.reason import Code
from truearc.robot import reasons as bot


class Form(NamedTuple):
    """One sentence. `fixed`: parameters that it has without showing them; `within`: only as the cause of this code."""

    code: Code
    template: str
    fixed: Mapping[str, Any] = {}
    within: str = ""


HOOD = {"device": "hood encoder"}
DEVICE_ID = "{device}, id {frame}: "
FORMS = (
    Form(bot.NOT_ARMED, "not armed"),
    Form(bot.DISARMED_BY_BOX, "not armed: the button box {cause:box}"),
    Form(bot.SHOT_NOT_MARKED, "mark the last shot first"),
    Form(bot.BALL_CLEARING, "the last ball is still clearing"),
    Form(bot.FIRE_NOT_REQUESTED, "waiting for the fire button"),
    Form(bot.CAN_LOST, "CAN lost: {cause}"),
    Form(bot.CAMERA_LOST, "camera lost: {cause}"),
    Form(bot.BOX_LOST, "button box lost: {cause}"),
    Form(bot.BOX_SILENT, "button box silent: outcomes cannot be marked"),
    Form(bot.BOX_PRESS_UNCERTAIN, "button box: a press may have got lost"),
    Form(bot.FRAMES_NOT_SENT, "{frames} frames could not be sent"),
    Form(bot.BAD_FRAME, "bad frame: {cause}"),
    Form(bot.TICKS_STALLED, "ticks stood still for {stall_s:.2f} s"),
    Form(bot.VISION_FAILED, "vision failed on an image ({detail})"),
    Form(bot.VISION_UNRESPONSIVE, "the vision process does not answer"),
    Form(bot.NOT_RECORDING, "not recording: {cause}"),
    Form(bot.DISK_FULL, "No space left on device", within=bot.NOT_RECORDING.name),
    Form(bot.DISK_UNRESPONSIVE, "the disk does not answer"),
    Form(bot.RECORDER_UNRESPONSIVE, "the recorder does not answer"),
    Form(hw.PROCESS_STARTING, "the {process} process has not started yet"),
    Form(hw.PROCESS_KILLED, "the {process} process ended (signal {signal})"),
    Form(hw.PROCESS_ENDED, "the {process} process ended (exit code {exit_code})"),
    Form(hw.PROCESS_ENDED, "the {process} process has died"),
    Form(bot.DISK_ERROR, "{detail}", within=bot.NOT_RECORDING.name),
    Form(bot.DEVICE_NEVER_RECEIVED, "{device} has never answered"),
    Form(bot.DEVICE_STALE, "{device} silent for {age_s:.2f} s"),
    Form(bot.DEVICE_HEARTBEAT_STALE, "{device} sends no heartbeat since {age_s:.2f} s"),
    Form(bot.DEVICE_FAULTS_NEVER_RECEIVED, "hood encoder has said nothing of its faults yet", HOOD),
    Form(bot.DEVICE_FAULTS_NEVER_RECEIVED, "{device} has said nothing of its errors yet"),
    Form(bot.DEVICE_FAULTS_STALE, "hood encoder has said nothing of its faults for {age_s:.2f} s", HOOD),
    Form(bot.DEVICE_FAULTS_STALE, "{device} has said nothing of its errors for {age_s:.2f} s"),
    Form(bot.MOTOR_NOT_FINITE, "{motor} reads what is no number"),
    Form(bot.MOTOR_NOT_DRIVEN, "{motor} is not under control (state {state})"),
    Form(bot.MAGNET_LOST, "hood encoder cannot see its magnet"),
    Form(bot.HOOD_NOT_HOMED, "hood not homed"),
    Form(bot.NO_AIM, "no aim"),
    Form(bot.NOT_AT_PLACE, "stand at {place_m:.2f} m"),
    Form(bot.WHEELS_OFF_SPEED, "wheels at {speed_rad_s:.0f} rad/s, wanted {wanted_rad_s:.0f}"),
    Form(bot.FLYWHEELS_DIFFER, "flywheel motors differ by {spread_rad_s:.0f} rad/s: belt?"),
    Form(bot.HOOD_UNKNOWN, "hood angle unknown"),
    Form(bot.HOOD_ENCODERS_DISAGREE, "hood encoder says {encoder_deg:.1f} deg, its screw {screw_deg:.1f}"),
    Form(bot.HOOD_OFF_ANGLE, "hood at {angle_deg:.1f} deg, wanted {wanted_deg:.1f}"),
    Form(bot.NOT_SETTLED, "wheels and hood only just arrived"),
    Form(bot.TARGET_NEVER_SEEN, "target never seen"),
    Form(bot.TARGET_NEVER_SEEN, "target never seen ({cause})"),
    Form(bot.TARGET_STALE, "target last seen {age_s:.1f} s ago"),
    Form(bot.TARGET_STALE, "target last seen {age_s:.1f} s ago ({cause})"),
    Form(bot.TARGET_IMPLAUSIBLE, "target seen {distance_m:.1f} m away, give or take {sigma_m:.1f}"),
    Form(bot.MODEL_MISSING, "no gate model loaded"),
    Form(bot.MODEL_NO_INPUT, "nothing to rate"),
    Form(bot.MODEL_FAILED, "model failed: {error}"),
    Form(bot.MODEL_NOT_FINITE, "model gives no number"),
    Form(bot.MODEL_OUTSIDE_DOMAIN, "model: outside what it was trained on"),
    Form(bot.MODEL_OUTSIDE_DOMAIN, "model: outside what it was trained on (novelty {novelty:.2f})"),
    Form(bot.MODEL_BELOW_THRESHOLD, "model: three points {p_three:.0%} likely, {threshold:.0%} needed"),
    Form(bot.IDENTIFY_WAITING, "identify: waiting for the arm button"),
    Form(bot.IDENTIFY_STARTING, "identify: waiting for the axes"),
    Form(bot.IDENTIFY_DONE, "identify: done"),
    Form(bot.IDENTIFY_RELEASED, "identify: released by the operator ({button})"),
    Form(bot.IDENTIFY_RELEASED_BY_BOX, "identify: released, as the button box {cause:box}"),
    Form(bot.IDENTIFY_RUNNING, "identify: {joint} coast ({number} of {last})", {"phase": "coast", "sign": 1}),
    Form(bot.IDENTIFY_RUNNING, "identify: {joint} {phase} up ({number} of {last})", {"sign": 1}),
    Form(bot.IDENTIFY_RUNNING, "identify: {joint} {phase} down ({number} of {last})", {"sign": -1}),
    Form(bot.IDENTIFY_STOPPED, "identify: {causes}"),
    Form(bot.JOINT_OVERSPEED, "{joint} at {speed_rad_s:.0f} rad/s, above {factor:g} x {top_rad_s:.0f}"),
    Form(bot.JOINT_BACKWARDS, "{joint} turns against its torque: is its direction right?"),
    Form(bot.HOOD_AT_LIMIT, "hood at {angle_deg:.1f} deg and still moving outwards"),
    Form(bot.SWITCH_NOT_REACHED, "the hood's limit switch was not reached in {limit_s:g} s"),
    Form(bot.JOINT_STILL_TURNING, "{joint} still turns after {limit_s:g} s of coasting"),
    Form(bot.JOINT_NOT_TURNING, "{joint} does not turn at {torque_nm:g} Nm"),
    Form(bot.IMAGE_TOO_SMALL, "the image is only {width_px} x {height_px} pixels"),
    Form(bot.IMAGE_BRIGHT, "the picture is bright all over: the exposure is too long, or not locked"),
    Form(bot.IMAGE_BURNT, "large parts of the picture are burnt out: the exposure is too long, or not locked"),
    Form(bot.IMAGE_DARK, "the picture is dark all over: no tape in view, no light on it, or the lens covered"),
    Form(bot.NO_TAPE_COLOUR, "nothing of the tape's colour is large enough"),
    Form(bot.SEVERAL_TARGETS, "{count} things in view look like the target"),
    Form(bot.NO_POSE, "no camera pose explains the four corners"),
    Form(bot.POSE_OFF_MOUNTING, "seen so, the camera's {quantity} would be far from what the configuration says"),
    Form(bot.POSE_CONTRADICTION, "edges, mounting and calibration contradict each other by {sigmas:.0f} sigmas"),
    Form(bot.TAPE_OFF_SHAPE, "the corners miss the tape's shape by {error_px:.1f} px"),
    Form(bot.TAPE_CUT_OFF, "what may be the tape is cut off by the image's edge"),
    Form(bot.TAPE_OUTLINE_UNLIT, "only {lit:.0%} of the tape's outline is lit"),
    Form(bot.TAPE_OPENING_LIT, "the opening that the tape encloses is lit"),
    Form(bot.REGION_FILLED, "a region of the tape's colour is filled, not an open outline"),
    Form(bot.REGION_CORNERS, "a region of the tape's colour does not have four corners"),
    Form(bot.REGION_SMALL, "a region of the tape's colour is too small to tell its corners"),
    Form(bot.REGION_SIDES, "a region of the tape's colour does not have tape on three sides and none on the fourth"),
    Form(bot.TAPE_EDGES_HIDDEN, "the edges of what may be the tape are hidden, or not straight"),
    Form(bot.TAPE_ENDS_HIDDEN, "the upper ends of what may be the tape are hidden, or not cut level"),
    Form(bot.TAPE_EDGES_APART, "the edges of what may be the tape do not meet at its corners"),
    Form(bot.TAPE_SMEARED, "the tape is smeared or glaring: it looks far wider than it is"),
    Form(bot.TAPE_NARROW, "the tape is narrower than it is said to be, or partly hidden"),
    Form(bot.TAPE_WIDE, "the tape is wider than it is said to be, or something touches it"),
    Form(bot.TAPE_UNEVEN, "the tape's straights are not equally wide: part of it is hidden, or something touches it"),
    Form(hw.CAN_OVERRUN, "{bus}: {frames} frames lost, the tick came too late for them"),
    Form(hw.CAN_REOPENED, "{bus}: opened again, nothing heard yet ({cause})"),
    Form(hw.CAN_SILENT, "{bus}: nothing heard for {silence_s:g} s"),
    Form(hw.CAN_BUS_OFF, "{bus}: bus off"),
    Form(hw.CAN_CLOSED, "closed", {"bus": "CAN"}, within=bot.CAN_LOST.name),
    Form(hw.CAN_ADAPTER_ERROR, "{bus}: {detail}", within=bot.CAN_LOST.name),
    Form(hw.CAN_ADAPTER_ERROR, "{bus}: {detail}", within=hw.CAN_REOPENED.name),
    Form(hw.FRAME_NOT_ALLOWED, "not sent: a question about frame {frame} with {bytes} bytes is not among those that "
                               "may be sent", {"remote": True}),
    Form(hw.FRAME_NOT_ALLOWED, "not sent: frame {frame} with {bytes} bytes is not among those that may be sent",
         {"remote": False}),
    Form(hw.FRAME_RATE_EXCEEDED, "not sent: frame {frame} may be sent {most} times in {window_s:g} s and no more"),
    Form(hw.FOREIGN_HOST, "another host sends {frame}, which is ours to send"),
    Form(hw.DUPLICATE_ID, "two devices with one id? {frame} came more than {most} times in {window_s:g} s, "
                          "{usual} are usual"),
    Form(hw.FRAME_LENGTH, DEVICE_ID + "{message}: {bytes} bytes instead of {wanted_bytes}"),
    Form(hw.FRAME_VALUE, DEVICE_ID + "{message} ({bytes} bytes): {signal} {value:g} outside {low:g} to {high:g}"),
    Form(hw.FRAME_UNEXPECTED, "{device}: frame {frame} is not {wanted}"),
    Form(hw.ENDSTOP_VALUE, "{device} TxSdo: a limit switch is 0 or 1, not {value:g}"),
    Form(hw.PARAMETER_VALUE, "spark parameter {parameter}: {value:g}"),
    Form(hw.SERIAL_ERROR, "serial port {port}: {detail}"),
    Form(hw.CAMERA_SILENT, "camera {camera}: gives no images"),
    Form(hw.CAMERA_FROZEN, "camera {camera}: gives the same image again and again"),
    Form(hw.CAMERA_STOPPED, "camera {camera}: stopped giving images"),
    Form(hw.CAMERA_NOT_OPENED, "camera {camera}: cannot be opened"),
    Form(hw.CAMERA_WRONG_SIZE, "camera {camera}: gives {width_px} x {height_px} pixels, not {wanted_width_px} x "
                               "{wanted_height_px}"),
    Form(hw.CAMERA_EXPOSURE_AUTOMATIC, "camera {camera}: keeps its exposure automatic"),
    Form(hw.CAMERA_EXPOSURE_WRONG, "camera {camera}: exposes for {exposure_s:ms} ms where {wanted_s:ms} ms were asked "
                                   "for"),
    Form(hw.CAMERA_ERROR, "camera {camera}: {detail}"),
    Form(hw.ENCODER_STUCK, "{motor}: {controller} says {speed_rad_s:.0f} rad/s, but its position stands still: encoder "
                           "stuck?"),
    Form(hw.ENCODER_MISMATCH, "{motor}: {controller} says {speed_rad_s:.0f} rad/s, but its position turns at "
                              "{turned_rad_s:.0f}: encoder or firmware?"),
    Form(hw.SPARK_FIRMWARE_UNKNOWN, "{motor}: spark {spark} has not said which firmware it runs"),
    Form(hw.SPARK_FIRMWARE_UNSUPPORTED, "{motor}: spark {spark} runs firmware {version}; only {oldest} to {newest} are "
                                        "understood here: update it with its maker's tool"),
    Form(hw.SPARK_STATUS_OFF, "{motor}: spark {spark} has not turned its status frames on"),
    Form(hw.SPARK_SETTINGS_UNCONFIRMED, "{motor}: spark {spark} has not taken parameters {parameters}"),
    Form(hw.SPARK_FAULTS_STALE, "{motor}: spark {spark} says nothing of its faults"),
    Form(hw.SPARK_NOT_DRIVING, "{motor}: spark {spark} applies nothing of the duty that it is sent: a limit switch, or "
                               "another's heartbeat?"),
    Form(hw.BOX_LINES_REFUSED, "button box: {lines} lines refused, first {first:bytes}"),
    Form(hw.BOX_RESTARTED, "button box: restarted"),
    Form(hw.BOX_PRESSES_LOST, "button box: {presses} presses lost"),
    Form(hw.BOX_PRESSES_REPEATED, "button box: {presses} presses told twice"),
    Form(bot.MOTOR_ERROR, "{motor}: {errors}"),
)

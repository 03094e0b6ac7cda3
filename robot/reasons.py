"""The codes of the robot's reasons for a HOLD, and the log text of every reason.

Fields and units are described in truearc.hw.reason.Code.
"""

from collections.abc import Iterable

from truearc.hw import fault_codes
from truearc.hw.reason import Code, Reason, index, render

# The operator
NOT_ARMED = Code("not_armed", "not armed")
DISARMED_BY_BOX = Code("disarmed_by_box", "not armed: {cause}")
SHOT_NOT_MARKED = Code("shot_not_marked", "last shot not marked")
BALL_CLEARING = Code("ball_clearing", "last ball still clearing")
FIRE_NOT_REQUESTED = Code("fire_not_requested", "waiting for the fire button")

# Wires
CAN_LOST = Code("can_lost", "CAN lost: {cause}")
CAMERA_LOST = Code("camera_lost", "camera lost: {cause}")
BOX_LOST = Code("box_lost", "button box lost: {cause}")
BOX_SILENT = Code("box_silent", "button box: no heartbeat, outcomes cannot be marked")
BOX_PRESS_UNCERTAIN = Code("box_press_uncertain", "button box: a press may be lost")
FRAMES_NOT_SENT = Code("frames_not_sent", "{frames} frames could not be sent")
BAD_FRAME = Code("bad_frame", "bad frame: {cause}")
TICKS_STALLED = Code("ticks_stalled", "ticks stalled for {stall_s:.2f} s")
BALL_WITHHELD = Code("ball_withheld", "ball not fed: its tick took {late_s:.2f} s")

# Vision and recording
VISION_FAILED = Code("vision_failed", "vision failed on an image ({detail})")
VISION_UNRESPONSIVE = Code("vision_unresponsive", "the vision process does not respond")
NOT_RECORDING = Code("not_recording", "not recording: {cause}")
DISK_FULL = Code("disk_full", "no space left on the disk")
DISK_ERROR = Code("disk_error", "{detail}")
DISK_BACKLOG_FULL = Code("disk_backlog_full", "the disk took nothing for so long that the rest is not kept")
FILE_DELETED = Code("file_deleted", "{file} has been deleted")
IMAGE_NOT_ENCODED = Code("image_not_encoded", "{file}: the image cannot be encoded")
DISK_UNRESPONSIVE = Code("disk_unresponsive", "the disk does not respond")
RECORDER_UNRESPONSIVE = Code("recorder_unresponsive", "the recorder does not respond")

# Readings that firing needs. device: a motor or the hood encoder
DEVICE_NEVER_RECEIVED = Code("device_never_received", "{device}: no frames received since the start",
                             {"device": "device"})
DEVICE_STALE = Code("device_stale", "{device}: no frames for {age_s:.2f} s", {"device": "device"})
DEVICE_HEARTBEAT_STALE = Code("device_heartbeat_stale", "{device}: no heartbeat for {age_s:.2f} s",
                              {"device": "device"})
DEVICE_FAULTS_NEVER_RECEIVED = Code("device_faults_never_received", "{device}: no fault report since the start",
                                    {"device": "device"})
DEVICE_FAULTS_STALE = Code("device_faults_stale", "{device}: no fault report for {age_s:.2f} s", {"device": "device"})
FRAMES_UNUSABLE = Code("frames_unusable", "{motor}: {frames} frames in a row cannot be used")
MOTOR_NOT_FINITE = Code("motor_not_finite", "{motor}: non-finite reading")
MOTOR_ERROR = Code("motor_error", "{motor}: {errors:,}")
MOTOR_NOT_DRIVEN = Code("motor_not_driven", "{motor}: not under control (state {state})", {"state": "count"})
MOTOR_LEFT_CONTROL = Code("motor_left_control", "{motor}: enabled, and not under control (state {state})",
                          {"state": "count"})     # on the page alone: of MOTOR_NOT_DRIVEN after a while
MAGNET_LOST = Code("magnet_lost", "hood encoder: magnet out of range, or no signal")

# The launcher
HOOD_NOT_HOMED = Code("hood_not_homed", "hood not homed")
NO_AIM = Code("no_aim", "no aim")
AIM_FILE_MISSING = Code("aim_file_missing", "no aim file loaded")
NO_SET_POINT = Code("no_set_point", "the aim file has no set point for {distance_m:.2f} m")
NOT_AT_PLACE = Code("not_at_place", "stand at {place_m:.2f} m")
WHEELS_OFF_SPEED = Code("wheels_off_speed", "wheels at {speed_rad_s:.0f} rad/s, set point {wanted_rad_s:.0f}")
FLYWHEELS_DIFFER = Code("flywheels_differ", "flywheel motors differ by {spread_rad_s:.0f} rad/s: belt?")
HOOD_UNKNOWN = Code("hood_unknown", "hood angle unknown")
HOOD_ENCODERS_DISAGREE = Code("hood_encoders_disagree", "hood encoder reads {encoder_deg:.1f} deg, its screw "
                              "{screw_deg:.1f}")
HOOD_OFF_ANGLE = Code("hood_off_angle", "hood at {angle_deg:.1f} deg, set point {wanted_deg:.1f}")
NOT_SETTLED = Code("not_settled", "wheels and hood not settled")

# Interlocks of motion (truearc.robot.motion). joint: wheels or hood
AXIS_RELEASED = Code("axis_released", "{joint} released: {cause}")
AXIS_LATCHED = Code("axis_latched", "{joint} released until armed again: {cause}")
JOINT_OVERSPEED = Code("joint_overspeed", "{joint} at {speed_rad_s:.0f} rad/s, above {factor:g} x {top_rad_s:.0f}",
                       {"factor": "ratio"})
JOINT_BACKWARDS = Code("joint_backwards", "{joint} turns against its torque: is its direction right?")
JOINT_NOT_TURNING = Code("joint_not_turning", "{joint} does not turn at {torque_nm:g} Nm")
HOOD_JAMMED = Code("hood_jammed", "hood does not move at {torque_nm:.2f} Nm")
HOOD_PUSH_DROPPED = Code("hood_push_dropped", "hood does not reach {wanted_deg:.1f} deg: a small torque does not move "
                         "it")
SWITCH_NOT_REACHED = Code("switch_not_reached", "the hood's limit switch was not reached in {limit_s:g} s")
SWITCH_STUCK = Code("switch_stuck", "the hood's limit switch is still closed at {angle_deg:.1f} deg")
HOOD_GIVEN_UP = Code("hood_given_up", "{count} times in a row its motion was not known; restart truearc",
                     {"count": "count"})
WHEELS_GIVEN_UP = Code("wheels_given_up", "{count} times in a row nothing showed them turning; restart truearc",
                       {"count": "count"})
RELEASED_REPEATEDLY = Code("released_repeatedly", "{count} times in {window_s:g} s, last: {cause}",
                           {"count": "count"})
WHEELS_IDLE = Code("wheels_idle", "wheels idle: no target and no request")

# Readings that another program publishes
NT_LOST = Code("nt_lost", "no connection to the server of the robot's program")
KEY_MISSING = Code("key_missing", "{key}: the robot publishes no such key", {"key": "text"})
KEY_IMPLAUSIBLE = Code("key_implausible", "{key}: {value} is not an angle", {"key": "text", "value": "text"})
KEY_JUMPED = Code("key_jumped", "{key} jumped {ago_s:.1f} s ago", {"key": "text"})
NT_VALUE_IMPOSSIBLE = Code("nt_value_impossible", "{key}: not a possible value", {"key": "text"})

# Shots on the move
ROBOT_SPEED_UNKNOWN = Code("robot_speed_unknown", "the robot's velocity is not known, or old")
ROBOT_TOO_FAST = Code("robot_too_fast", "the robot drives at {speed_m_s:.1f} m/s, above {limit_m_s:.1f}")
ROBOT_MOVES = Code("robot_moves", "the robot drives at {speed_m_s:.1f} m/s, and there is no set point for that")
NOT_LED = Code("not_led", "the launcher points {off_deg:+.1f} deg beside its lead of {lead_deg:+.1f}")

# The target
TARGET_NEVER_SEEN = Code("target_never_seen", "target not seen since the start{cause: (~)}")
TARGET_STALE = Code("target_stale", "target last seen {age_s:.1f} s ago{cause: (~)}")
TARGET_IMPLAUSIBLE = Code("target_implausible", "implausible target distance: {distance_m:.1f} ± {sigma_m:.1f} m")

# The model. p_three, threshold: probabilities; novelty: 1 is the edge of what the model was trained on
MODEL_MISSING = Code("model_missing", "no gate model loaded")
MODEL_NO_INPUT = Code("model_no_input", "model: distance or hood angle unknown")
MODEL_FAILED = Code("model_failed", "model failed: {error}")
MODEL_NOT_FINITE = Code("model_not_finite", "model: non-finite probability")
MODEL_OUTSIDE_DOMAIN = Code("model_outside_domain", "model: outside its training data{novelty: (novelty ~)}",
                            {"novelty": "ratio?"})
MODEL_BELOW_THRESHOLD = Code("model_below_threshold", "model: full points {p_three:.0%} likely, {threshold:.0%} "
                             "needed", {"p_three": "probability", "threshold": "probability"})

# `truearc sysid`: where it stands and why it ended
IDENTIFY_WAITING = Code("identify_waiting", "identify: waiting for the arm button")
IDENTIFY_STARTING = Code("identify_starting", "identify: waiting for the axes")
IDENTIFY_RUNNING = Code("identify_running", "identify: {joint} {phase} ({number} of {last}, direction {sign:+d})",
                        {"joint": "text", "phase": "text", "sign": "count", "number": "count", "last": "count"})
IDENTIFY_DONE = Code("identify_done", "identify: done")
IDENTIFY_RELEASED = Code("identify_released", "identify: released by the operator ({button})")
IDENTIFY_RELEASED_BY_BOX = Code("identify_released_by_box", "identify: released ({cause})")
IDENTIFY_STOPPED = Code("identify_stopped", "identify: {causes}")
HOOD_AT_LIMIT = Code("hood_at_limit", "hood at {angle_deg:.1f} deg and still moving outwards")
JOINT_STILL_TURNING = Code("joint_still_turning", "{joint} still turns after {limit_s:g} s of coasting")

# Why an image shows no target
IMAGE_TOO_SMALL = Code("image_too_small", "the image is only {width_px} x {height_px} pixels")
IMAGE_BRIGHT = Code("image_bright", "the image is bright all over: exposure too long, or not locked")
IMAGE_BURNT = Code("image_burnt", "large parts of the image are saturated: exposure too long, or not locked")
IMAGE_DARK = Code("image_dark", "the image is dark all over: no tape in view, no light on it, or the lens covered")
NO_TAPE_COLOUR = Code("no_tape_colour", "no region of the tape's colour is large enough")
SEVERAL_TARGETS = Code("several_targets", "{count} things in view look like the target", {"count": "count"})
NO_POSE = Code("no_pose", "no camera pose explains the four corners")
POSE_OFF_MOUNTING = Code("pose_off_mounting", "the camera's {quantity} would be far from the configured value")
POSE_CONTRADICTION = Code("pose_contradiction", "edges, mounting and calibration contradict each other by {sigmas:.0f} "
                          "sigmas", {"sigmas": "ratio"})
NO_TAG = Code("no_tag", "no AprilTag of the configured numbers is in view")
TAG_EDGES_HIDDEN = Code("tag_edges_hidden", "the AprilTag's edges are hidden")
TAG_OFF_SHAPE = Code("tag_off_shape", "the corners miss the tag's square by {error_px:.1f} px")
TAPE_OFF_SHAPE = Code("tape_off_shape", "the corners miss the tape's shape by {error_px:.1f} px")
TAPE_CUT_OFF = Code("tape_cut_off", "the region is cut off by the image's edge")
TAPE_OUTLINE_UNLIT = Code("tape_outline_unlit", "only {lit:.0%} of the tape's outline is lit", {"lit": "share"})
TAPE_OPENING_LIT = Code("tape_opening_lit", "the opening that the tape encloses is lit")
REGION_FILLED = Code("region_filled", "the region is filled, not an open outline")
REGION_CORNERS = Code("region_corners", "the region does not have four corners")
REGION_SMALL = Code("region_small", "the region is too small to locate its corners")
REGION_SIDES = Code("region_sides", "the region does not have tape on three sides and none on the fourth")
TAPE_EDGES_HIDDEN = Code("tape_edges_hidden", "the tape's edges are hidden, or not straight")
TAPE_ENDS_HIDDEN = Code("tape_ends_hidden", "the tape's upper ends are hidden, or not cut level")
TAPE_EDGES_APART = Code("tape_edges_apart", "the tape's edges do not meet at its corners")
TAPE_SMEARED = Code("tape_smeared", "the tape is blurred or glaring: it looks far wider than it is")
TAPE_NARROW = Code("tape_narrow", "the tape is narrower than configured, or partly hidden")
TAPE_WIDE = Code("tape_wide", "the tape is wider than configured, or something touches it")
TAPE_UNEVEN = Code("tape_uneven", "the tape's straights are not equally wide: part of it is hidden, or something "
                   "touches it")

CODES = tuple(code for code in globals().values() if isinstance(code, Code))


class _Codes(dict[str, Code]):
    """Codes by name, those of installed motor families included."""

    def __missing__(self, name: str) -> Code:
        from truearc.hw.devices.registry import find_messages  # needs cantools, which most commands do without
        for message in find_messages(name):
            return message.code
        raise KeyError(name)


BY_NAME = _Codes(index((*fault_codes.CODES, *CODES)))

# With these alone the model is all that stands in the way of firing
MODEL_DOUBTS = frozenset((MODEL_OUTSIDE_DOMAIN.name, MODEL_BELOW_THRESHOLD.name))
BOX_GONE = frozenset((BOX_LOST.name, BOX_SILENT.name))


def text(reason: Reason) -> str:
    """Return the log text of one reason."""
    return render(reason, BY_NAME)


def texts(reasons: Iterable[Reason]) -> list[str]:
    """Return the log texts of several reasons."""
    return [text(reason) for reason in reasons]

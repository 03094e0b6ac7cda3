"""The codes for faults of wires and devices.

Their fields and units are described in truearc.hw.reason.Code.
"""

from truearc.hw.reason import Code, index

# The CAN bus. Those with a cause of their own name are why it is lost; the others are faults of a bus that works.
CAN_ADAPTER_ERROR = Code("can_adapter_error", "{bus}: {detail}")
CAN_BUS_OFF = Code("can_bus_off", "{bus}: bus off")
CAN_SILENT = Code("can_silent", "{bus}: no frames for {silence_s:g} s")
CAN_CLOSED = Code("can_closed", "{bus}: closed")
CAN_REOPENED = Code("can_reopened", "{bus}: reopened, no frames received yet{cause: (~)}", {"cause": "reason"})
CAN_OVERRUN = Code("can_overrun", "{bus}: {frames} frames lost: ticks came too late to read them")
FRAME_NOT_ALLOWED = Code("frame_not_allowed", "not sent: frame {frame} with {bytes} bytes is not on the allow list",
                         {"remote": "flag"})
FRAME_RATE_EXCEEDED = Code("frame_rate_exceeded", "not sent: frame {frame} exceeds {most} per {window_s:g} s",
                           {"most": "count"})
FOREIGN_HOST = Code("foreign_host", "another host sends frame {frame}, which only this robot may send")
DUPLICATE_ID = Code("duplicate_id", "two devices with one id? More than {most} frames {frame} in {window_s:g} s, "
                    "{usual} are usual", {"frame": "text", "most": "count", "window_s": "s", "usual": "count"})

# Frames that cannot be used. device: such as "odrive node 1"; frame: its arbitration id; wanted: names of messages
FRAME_LENGTH = Code("frame_length", "{device:~, }{frame:id ~: }{message}: {bytes} bytes, expected {wanted_bytes}",
                    {"wanted_bytes": "count"})
FRAME_VALUE = Code("frame_value", "{device:~, }{frame:id ~: }{message}: {signal} is {value:g}, expected {low:g} to "
                   "{high:g}",
                   {"device": "text?", "frame": "text?", "message": "text", "bytes": "count", "signal": "text",
                    "value": "of the signal", "low": "of the signal", "high": "of the signal"})
FRAME_SIGNALS = Code("frame_signals", "{message}: missing or unknown signals {signals}",
                     {"device": "text?", "frame": "text?", "message": "text", "signals": "texts"})
FRAME_UNEXPECTED = Code("frame_unexpected", "{device}: unexpected frame {frame}; expected {wanted}",
                        {"wanted": "texts"})
ENDSTOP_VALUE = Code("endstop_value", "{device} TxSdo: a limit switch is {value:g}, expected 0 or 1",
                     {"value": "of the signal"})
PARAMETER_VALUE = Code("parameter_value", "spark parameter {parameter}: {value:g} is not finite",
                       {"parameter": "count", "value": "of the parameter"})
PERIOD_RANGE = Code("period_range", "{device}: period is {period_ms} ms, expected 1 to 65535", {"period_ms": "ms"})

# The serial port, the camera, and processes beside the one that controls
SERIAL_ERROR = Code("serial_error", "serial port {port}: {detail}")
CAMERA_ERROR = Code("camera_error", "camera {camera}: {detail}")
CAMERA_SILENT = Code("camera_silent", "camera {camera}: no images")
CAMERA_FROZEN = Code("camera_frozen", "camera {camera}: repeats the same frame")
CAMERA_STOPPED = Code("camera_stopped", "camera {camera}: stopped giving images")
CAMERA_NOT_OPENED = Code("camera_not_opened", "camera {camera}: cannot be opened")
CAMERA_WRONG_SIZE = Code("camera_wrong_size", "camera {camera}: gives {width_px} x {height_px} pixels, expected "
                         "{wanted_width_px} x {wanted_height_px}")
CAMERA_EXPOSURE_AUTOMATIC = Code("camera_exposure_automatic", "camera {camera}: keeps its exposure automatic")
CAMERA_EXPOSURE_WRONG = Code("camera_exposure_wrong", "camera {camera}: exposes for {exposure_s:.4f} s, expected "
                             "{wanted_s:.4f} s")
PROCESS_STARTING = Code("process_starting", "the {process} process has not started yet")
PROCESS_KILLED = Code("process_killed", "the {process} process ended (signal {signal})", {"signal": "count"})
PROCESS_ENDED = Code("process_ended", "the {process} process ended{exit_code: (exit code ~)}", {"exit_code": "count?"})
PIPE_ENDED = Code("pipe_ended", "pipe from another process: the sender has ended")
PIPE_CLOSED = Code("pipe_closed", "pipe from another process: {detail}")

# Motors. motor: which axis, as whoever reads the fault adds; controller: such as "odrive node 1"
ENCODER_STUCK = Code("encoder_stuck", "{motor:~: }{controller} reports {speed_rad_s:.0f} rad/s, but its position does "
                     "not change: encoder stuck?")
ENCODER_MISMATCH = Code("encoder_mismatch", "{motor:~: }{controller} reports {speed_rad_s:.0f} rad/s, but its position "
                        "turns at {turned_rad_s:.0f}: encoder or firmware?")
SPEED_JUMPED = Code("speed_jumped", "{motor:~: }{controller} reports {after_rad_s:.0f} rad/s right after "
                    "{before_rad_s:.0f}: no motor does that")
FEEDBACK_UNMEASURED = Code("feedback_unmeasured", "{motor:~: }{controller} has answered no question yet: how late its "
                           "readings come is not known")
FEEDBACK_LATE = Code("feedback_late", "{motor:~: }{controller} answers after {delay_s:.2f} s: its readings are as old "
                     "as that")
CONTROLLER_NOT_ANSWERING = Code("controller_not_answering", "{motor:~: }{controller} has answered no question for "
                                "{silence_s:.0f} s")
SPARK_FIRMWARE_UNKNOWN = Code("spark_firmware_unknown", "{motor:~: }spark {spark} has not reported its firmware")
SPARK_FIRMWARE_UNSUPPORTED = Code("spark_firmware_unsupported", "{motor:~: }spark {spark} runs firmware {version}, "
                                  "expected {oldest} to {newest}: update it with its maker's tool",
                                  {"oldest": "count", "newest": "count"})
SPARK_STATUS_OFF = Code("spark_status_off", "{motor:~: }spark {spark} has not turned its status frames on")
SPARK_SETTINGS_UNCONFIRMED = Code("spark_settings_unconfirmed", "{motor:~: }spark {spark} has not confirmed parameters "
                                  "{parameters}", {"parameters": "counts"})
SPARK_FAULTS_STALE = Code("spark_faults_stale", "{motor:~: }spark {spark} does not report its faults")
SPARK_NOT_DRIVING = Code("spark_not_driving", "{motor:~: }spark {spark} does not apply the duty it is sent: a limit "
                         "switch, or another host's heartbeat?")

# Errors that motor controllers report: the ODrive's of its enumeration Error, the SPARK's of its frame STATUS_1
ERROR_INITIALIZING = Code("error_initializing", "initializing")
ERROR_SYSTEM_LEVEL = Code("error_system_level", "system")
ERROR_TIMING = Code("error_timing", "timing")
ERROR_MISSING_ESTIMATE = Code("error_missing_estimate", "no encoder estimate")
ERROR_BAD_CONFIG = Code("error_bad_config", "bad configuration")
ERROR_GATE_DRIVER = Code("error_gate_driver", "gate driver")
ERROR_MISSING_INPUT = Code("error_missing_input", "no input")
ERROR_DC_BUS_OVER_VOLTAGE = Code("error_dc_bus_over_voltage", "bus over voltage")
ERROR_DC_BUS_UNDER_VOLTAGE = Code("error_dc_bus_under_voltage", "bus under voltage")
ERROR_DC_BUS_OVER_CURRENT = Code("error_dc_bus_over_current", "bus over current")
ERROR_DC_BUS_OVER_REGEN_CURRENT = Code("error_dc_bus_over_regen_current", "bus over regeneration")
ERROR_CURRENT_LIMIT = Code("error_current_limit", "current limit")
ERROR_MOTOR_OVER_TEMPERATURE = Code("error_motor_over_temperature", "motor too hot")
ERROR_INVERTER_OVER_TEMPERATURE = Code("error_inverter_over_temperature", "inverter too hot")
ERROR_VELOCITY_LIMIT = Code("error_velocity_limit", "velocity limit")
ERROR_POSITION_LIMIT = Code("error_position_limit", "position limit")
ERROR_WATCHDOG_EXPIRED = Code("error_watchdog_expired", "watchdog expired")
ERROR_ESTOP_REQUESTED = Code("error_estop_requested", "estop requested")
ERROR_SPINOUT = Code("error_spinout", "spinout")
ERROR_BRAKE_RESISTOR_DISARMED = Code("error_brake_resistor_disarmed", "brake resistor disarmed")
ERROR_THERMISTOR_DISCONNECTED = Code("error_thermistor_disconnected", "thermistor disconnected")
ERROR_CALIBRATION = Code("error_calibration", "calibration")
ERROR_OTHER = Code("error_other", "unnamed fault")
ERROR_MOTOR_TYPE = Code("error_motor_type", "motor type")
ERROR_SENSOR = Code("error_sensor", "sensor")
ERROR_CAN = Code("error_can", "CAN")
ERROR_OVER_TEMPERATURE = Code("error_over_temperature", "too hot")
ERROR_CONTROLLER_MEMORY = Code("error_controller_memory", "controller's memory")
ERROR_FIRMWARE = Code("error_firmware", "firmware")
ERROR_HAS_RESET = Code("error_has_reset", "reset (was the supply interrupted?)")
ERROR_LOCKED = Code("error_locked", "locked to a competition controller until its power is cycled")
ERROR_ID_CONFLICT = Code("error_id_conflict", "another device has its id")
ERROR_BITS = Code("error_bits", "error 0x{bits:08x}", {"bits": "count"})

# The button box
BOX_LINES_REFUSED = Code("box_lines_refused", "button box: {lines} lines refused, first {first}", {"lines": "count"})
BOX_RESTARTED = Code("box_restarted", "button box: restarted")
BOX_PRESSES_LOST = Code("box_presses_lost", "button box:{presses: ~} presses lost")
BOX_PRESSES_REPEATED = Code("box_presses_repeated", "button box: {presses} presses sent twice")

CODES = tuple(code for code in globals().values() if isinstance(code, Code))
BY_NAME = index(CODES)

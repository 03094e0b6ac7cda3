"""The catalogue for advice by NetworkTables: each key freezes, jumps, disappears or is not a number."""

from benchmarks.matrix.breaking import Key
from benchmarks.matrix.keys import BEGIN_S, FRESH_S, HZ, POSE
from benchmarks.matrix.row import Row
from benchmarks.matrix.signs import Signs, says
from truearc.robot import reasons as bot

AT_ONCE_S, OLD_S = 2.0 / HZ, FRESH_S + 3.0 / HZ
JUMPS_S = 0.1 + 2.0 / HZ              # it is away every other tenth of a second
BATTERY_OLD_S = 10.0 * FRESH_S + 2.0 / HZ
LAST_S = BEGIN_S + 2.0                # of a trouble: longer than a battery may stand still
MISSING, IMPOSSIBLE = says(bot.KEY_MISSING), says(bot.CAMERA_LOST)
JUMPED, CAMERA_JUMPED = says(bot.KEY_JUMPED), says(bot.CAMERA_LOST, cause=says(bot.KEY_JUMPED))
UNKNOWN = says(bot.ROBOT_SPEED_UNKNOWN)


def _rows(name: str, key: str, old: Signs, old_s: float, jumped: Signs, gone: Signs) -> list[Row]:
    return [Row(f"advise: {name} {what}", "key", Key(what, key), reason, within_s, lasts_s=LAST_S,
                buses=("virtual",), launcher="NetworkTables")
            for what, reason, within_s in (("freezes", old, old_s), ("jumps", jumped, JUMPS_S),
                                           ("disappears", gone, AT_ONCE_S), ("not a number", gone, AT_ONCE_S))]


def _stale(device: str) -> Signs:
    return says(bot.DEVICE_STALE, device=device)


KEY_ROWS = (
    *_rows("distance", "/Vision/Distance", says(bot.TARGET_STALE), OLD_S, JUMPED, MISSING),
    *_rows("hood angle", "/Hood/Angle", _stale("hood angle"), OLD_S, JUMPED, MISSING),
    *_rows("wheel speed", "/Shooter/RPM", _stale("wheel speed"), OLD_S, JUMPED, MISSING),
    *_rows("battery", "/Battery", _stale("battery"), BATTERY_OLD_S, JUMPED, MISSING),
    *_rows("PhotonVision's target", POSE, says(bot.TARGET_STALE), OLD_S, CAMERA_JUMPED, IMPOSSIBLE),
    *_rows("robot's velocity", "/Drive/Speeds", UNKNOWN, OLD_S, UNKNOWN, UNKNOWN),
    Row("advise: server gone", "key", Key("server gone", ""), says(bot.NT_LOST), AT_ONCE_S, lasts_s=LAST_S,
        buses=("virtual",), launcher="NetworkTables"))

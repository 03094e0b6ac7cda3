"""The catalogue for advice by NetworkTables: each key freezes, jumps, disappears or is not a number."""

from benchmarks.matrix.breaking import Key
from benchmarks.matrix.keys import ALIVE, BEGIN_S, FRESH_S, FRONT, HEADING, HZ, LIMELIGHT, POSE
from benchmarks.matrix.row import Row
from benchmarks.matrix.signs import Signs, says
from truearc.hw.fault_codes import CAMERA_FROZEN
from truearc.robot import reasons as bot

AT_ONCE_S, OLD_S = 2.0 / HZ, FRESH_S + 3.0 / HZ
JUMPS_S = 0.1 + 2.0 / HZ              # it is away every other tenth of a second
BATTERY_OLD_S = 10.0 * FRESH_S + 2.0 / HZ
GONE = ("disappears", "not a number")
LAST_S = BEGIN_S + 2.0                # of a trouble: longer than a battery may stand still
MISSING, IMPOSSIBLE = says(bot.KEY_MISSING), says(bot.CAMERA_LOST)
FROZEN = says(bot.CAMERA_LOST, cause=says(CAMERA_FROZEN))
JUMPED, CAMERA_JUMPED = says(bot.KEY_JUMPED), says(bot.CAMERA_LOST, cause=says(bot.KEY_JUMPED))
UNKNOWN = says(bot.ROBOT_SPEED_UNKNOWN)


PLAIN = {"distance": "/Vision/Distance", "hood angle": "/Hood/Angle", "wheel speed": "/Shooter/RPM",
         "battery": "/Battery"}


def _rows(name: str, key: str, old: Signs, old_s: float, jumped: Signs, gone: Signs) -> list[Row]:
    return [Row(f"advise: {name} {what}", "key", Key(what, key), reason, within_s, lasts_s=LAST_S,
                buses=("virtual",), launcher="NetworkTables")
            for what, reason, within_s in (("freezes", old, old_s), ("jumps", jumped, JUMPS_S),
                                           ("disappears", gone, AT_ONCE_S), ("not a number", gone, AT_ONCE_S))]


def _some(rows: list[Row], *whats: str) -> list[Row]:
    """Those of these troubles: what may stand still, or change at once, is well."""
    return [row for row in rows if row.name.endswith(whats)]


def _stale(device: str) -> Signs:
    return says(bot.DEVICE_STALE, device=device)


KEY_ROWS = (
    *_rows("distance", "/Vision/Distance", says(bot.TARGET_STALE), OLD_S, JUMPED, MISSING),
    *_rows("hood angle", "/Hood/Angle", _stale("hood angle"), OLD_S, JUMPED, MISSING),
    *_rows("wheel speed", "/Shooter/RPM", _stale("wheel speed"), OLD_S, JUMPED, MISSING),
    *_rows("battery", "/Battery", _stale("battery"), BATTERY_OLD_S, JUMPED, MISSING),
    *_rows("PhotonVision's target", POSE, says(bot.TARGET_STALE), OLD_S, CAMERA_JUMPED, IMPOSSIBLE),
    *_some(_rows("PhotonVision's heartbeat", f"{FRONT}/heartbeat", FROZEN, OLD_S, FROZEN, IMPOSSIBLE),
           "freezes", *GONE),
    *_some(_rows("PhotonVision's hasTarget", f"{FRONT}/hasTarget", IMPOSSIBLE, OLD_S, IMPOSSIBLE, IMPOSSIBLE), *GONE),
    *_some(_rows("PhotonVision's latency", f"{FRONT}/latencyMillis", IMPOSSIBLE, OLD_S, IMPOSSIBLE, IMPOSSIBLE), *GONE),
    *_rows("Limelight's target", f"{LIMELIGHT}/targetpose_cameraspace", says(bot.TARGET_STALE), OLD_S, CAMERA_JUMPED,
           IMPOSSIBLE),
    *_some(_rows("Limelight's heartbeat", f"{LIMELIGHT}/hb", FROZEN, OLD_S, FROZEN, IMPOSSIBLE), "freezes", *GONE),
    *(row for name in ("tv", "tid", "cl", "stddevs") for row in _some(
        _rows(f"Limelight's {name}", f"{LIMELIGHT}/{name}", IMPOSSIBLE, OLD_S, IMPOSSIBLE, IMPOSSIBLE), *GONE)),
    *_rows("robot's velocity", "/Drive/Speeds", UNKNOWN, OLD_S, UNKNOWN, UNKNOWN),
    *_rows("robot's heading", HEADING, UNKNOWN, OLD_S, UNKNOWN, UNKNOWN),
    *_some(_rows("robot's loop", ALIVE, UNKNOWN, OLD_S, UNKNOWN, UNKNOWN), "freezes", *GONE),
    *(Row(f"advise: {name} impossible", "key", Key("impossible", key), says(bot.NT_VALUE_IMPOSSIBLE), AT_ONCE_S,
          lasts_s=LAST_S, buses=("virtual",), launcher="NetworkTables") for name, key in PLAIN.items()),
    Row("advise: server gone", "key", Key("server gone", ""), says(bot.NT_LOST), AT_ONCE_S, lasts_s=LAST_S,
        buses=("virtual",), launcher="NetworkTables"))

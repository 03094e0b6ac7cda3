"""Sightings by PhotonVision or a Limelight, from the keys that they publish over NetworkTables.

PhotonVision (table /photonvision/NAME): `targetPose` is the transform from camera to tag (x forward, y left, z up; a
struct, before 2025 an array), `latencyMillis` from the exposure to the publication. Limelight (table /NAME):
`targetpose_cameraspace` is x right, y down, z forward, `cl` + `tl` ms the latency, `stddevs` begins with the standard
deviations of MegaTag 1 along the field's x and y. (PhotonVision's NTTopicSet and NTDataPublisher; Limelight's complete
NetworkTables API.)
"""

import math
from collections.abc import Mapping
from typing import NamedTuple, NoReturn

from truearc.hw.fault_codes import CAMERA_FROZEN
from truearc.hw.protocols import NS_PER_S, CameraFrame, Clock, LinkLost
from truearc.hw.reason import Reason
from truearc.robot import reasons as because
from truearc.robot.config.schema import CameraConfig, Config
from truearc.robot.tick import CALM_S, DISTANCE_RATE_M_S, DISTANCE_STEP_M
from truearc.robot.types import Sighting
from truearc_frc.advice import Keys
from truearc_frc.keys import NtKeys, Reading
from truearc_frc.table import Nt4Vision, nt4_of

MOST_LATENCY_S = 1.0                  # more is a mistake
OFF_SIGMAS = 4.0                      # of a tag's height that contradicts the mounting
MEGATAG_1 = 2                         # of Limelight's standard deviations those of x and y


class Names(NamedTuple):
    """Keys of one camera."""

    alive: str                        # counts images
    seen: str                         # whether one shows a target
    latency: tuple[str, ...]          # ms, to be added up
    pose: str                         # array or struct that begins with the tag's place
    stddevs: str = ""                 # array
    tag: str = ""


def names_of_camera(vision: Nt4Vision) -> Names:
    """The keys that are read of a camera."""
    table = vision.camera.strip("/")
    if vision.kind == "photonvision":
        table = f"/photonvision/{table.removeprefix('photonvision/')}"
        return Names(f"{table}/heartbeat", f"{table}/hasTarget", (f"{table}/latencyMillis",), f"{table}/targetPose")
    return Names(f"/{table}/hb", f"/{table}/tv", (f"/{table}/cl", f"/{table}/tl"),
                 f"/{table}/targetpose_cameraspace", f"/{table}/stddevs", f"/{table}/tid")


def keys_of_camera(vision: Nt4Vision) -> list[str]:
    """Those keys, a part of an array each its own."""
    names = names_of_camera(vision)
    parts = [_part(names.pose, place) for place in range(3)]
    parts += [_part(names.stddevs, place) for place in range(MEGATAG_1) if names.stddevs]
    return [names.alive, names.seen, *names.latency, *parts, *filter(None, [names.tag])]


def calibration_key(vision: Nt4Vision) -> str | None:
    """A key that is there where the camera is calibrated; None: it tells nothing of that."""
    names = names_of_camera(vision)
    return f"{names.pose.rpartition('/')[0]}/cameraIntrinsics/0" if vision.kind == "photonvision" else None


class NtCamera:
    """truearc.robot.eyes.Eyes on keys; neither call waits for the network.

    A distance is horizontal, from the lens to the tag and [apriltag] behind_m more, as that of an image. A tag that is
    not the target's, or whose height contradicts the camera's mounting, does not count. Both raise LinkLost for a key
    that is missing or has an impossible value, for a place that changes while the heartbeat stands still, and for half
    a second after a distance that jumped.
    """

    def __init__(self, config: Config, keys: Keys, clock: Clock) -> None:
        nt4 = nt4_of(config)
        assert nt4 is not None and nt4.vision is not None and config.apriltag is not None
        self._vision, self._tag, self._camera = nt4.vision, config.apriltag, config.camera
        self._keys, self._clock = keys, clock
        self._names, self._needed = names_of_camera(self._vision), keys_of_camera(self._vision)
        self._oldest_ns = round(config.gate.sighting_age_s * NS_PER_S)
        self._told_ns = 0                         # stamp of the newest reading that was used
        self._last: tuple[int, float] | None = None       # stamp and distance of the newest sighting
        self._jumped_ns: int | None = None
        self._doubt: Reason | None = None         # why the newest reading is not believed

    def read(self) -> Sighting | None:
        if not self._keys.connected:
            raise LinkLost(because.NT_LOST())
        return self.sight(self._keys.read(self._clock.now_ns()))

    def picture(self) -> CameraFrame | None:
        return None

    def sight(self, found: Mapping[str, Reading]) -> Sighting | None:
        """What these readings say that is new."""
        told = {key: self._take(found, key) for key in self._needed}
        seen, alive = told[self._names.seen], told[self._names.alive]
        latency_s = 1e-3 * sum(float(told[key].value) for key in self._names.latency)
        newest = told[_part(self._names.pose, 0)] if seen.value else alive
        if newest.t_ns > self._told_ns:
            self._told_ns, self._doubt = newest.t_ns, None
            if not 0.0 <= latency_s <= MOST_LATENCY_S:
                return self._refuse(because.NT_VALUE_IMPOSSIBLE(key=self._names.latency[0]))
            if seen.value not in (0.0, 1.0):
                return self._refuse(because.NT_VALUE_IMPOSSIBLE(key=self._names.seen))
            if newest.t_ns - alive.t_ns > self._oldest_ns:
                return self._refuse(CAMERA_FROZEN(camera=self._vision.camera))
            t_ns = newest.t_ns - round(latency_s * NS_PER_S)
            if not seen.value or (self._names.tag and told[self._names.tag].value not in self._tag.ids):
                return Sighting(t_ns, False, because.NO_TAG())
            return self._sighting(t_ns, told)
        return None if self._doubt is None else self._refuse(self._doubt)

    def _refuse(self, doubt: Reason) -> NoReturn:
        self._doubt = doubt
        raise LinkLost(doubt)

    def _take(self, found: Mapping[str, Reading], key: str) -> Reading:
        reading = found.get(key)
        if reading is None or isinstance(reading.value, str):
            raise LinkLost(because.KEY_MISSING(key=key))
        if not math.isfinite(reading.value):
            raise LinkLost(because.NT_VALUE_IMPOSSIBLE(key=key))
        return reading

    def _sighting(self, t_ns: int, told: Mapping[str, Reading]) -> Sighting:
        place = [float(told[_part(self._names.pose, axis)].value) for axis in range(3)]
        ahead, left, up = place if self._vision.kind == "photonvision" else (place[2], -place[0], -place[1])
        pitch = math.radians(self._camera.pitch_deg)
        forward_m = ahead * math.cos(pitch) - up * math.sin(pitch)
        above_m = ahead * math.sin(pitch) + up * math.cos(pitch)
        to_tag_m = math.hypot(forward_m, left)
        distance_m = to_tag_m + self._tag.behind_m - self._camera.bias_m
        sigma_m = self._sigma_m(distance_m, told)
        if not (math.isfinite(distance_m) and math.isfinite(above_m) and forward_m > 0.0):
            self._refuse(because.NT_VALUE_IMPOSSIBLE(key=self._names.pose))
        if sigma_m is None:
            self._refuse(because.NT_VALUE_IMPOSSIBLE(key=self._names.stddevs))
        off_m = self._camera.height_m + above_m - self._tag.centre_height_m
        if abs(off_m) > OFF_SIGMAS * _height_sigma_m(self._camera, to_tag_m, above_m, sigma_m):
            return Sighting(t_ns, False, because.POSE_OFF_MOUNTING(quantity="height"))
        if (jumped := self._jump(t_ns, distance_m)) is not None:
            self._refuse(jumped)
        return Sighting(t_ns, True, None, distance_m, sigma_m, -math.degrees(math.atan2(left, forward_m)))

    def _sigma_m(self, distance_m: float, told: Mapping[str, Reading]) -> float | None:
        """One standard deviation; None where the camera states one that cannot be."""
        stated = [float(told[_part(self._names.stddevs, place)].value) for place in range(MEGATAG_1)
                  if self._names.stddevs]
        if any(one < 0.0 for one in stated):
            return None
        return math.hypot(self._vision.sigma_m, self._vision.sigma_share * distance_m, self._camera.bias_sigma_m,
                          *stated)

    def _jump(self, t_ns: int, distance_m: float) -> Reason | None:
        last, self._last = self._last, (t_ns, distance_m)
        if last is not None:
            gap_s = max(t_ns - last[0], 0) / NS_PER_S
            if abs(distance_m - last[1]) > DISTANCE_STEP_M + DISTANCE_RATE_M_S * gap_s:
                self._jumped_ns = t_ns
        ago_s = math.inf if self._jumped_ns is None else (t_ns - self._jumped_ns) / NS_PER_S
        return because.KEY_JUMPED(key=self._names.pose, ago_s=ago_s) if ago_s <= CALM_S else None


class OwnNtCamera(NtCamera):
    """With a connection of its own, to be closed."""

    def __init__(self, config: Config, clock: Clock) -> None:
        nt4 = nt4_of(config)
        assert nt4 is not None and nt4.vision is not None
        self._own = NtKeys(nt4.server, keys_of_camera(nt4.vision))
        super().__init__(config, self._own, clock)

    def close(self) -> None:
        self._own.close()


def _part(key: str, place: int) -> str:
    return f"{key}/{place}"


def _height_sigma_m(camera: CameraConfig, to_tag_m: float, above_m: float, sigma_m: float) -> float:
    """Of the tag's height above the floor, by mounting and distance."""
    slope = abs(above_m) / to_tag_m if to_tag_m > 0.0 else 0.0
    return math.hypot(camera.height_sigma_m, to_tag_m * math.radians(camera.pitch_sigma_deg), slope * sigma_m)

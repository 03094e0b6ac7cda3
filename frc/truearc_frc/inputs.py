"""Launcher inputs read from the robot's NetworkTables: camera sightings, the robot's velocity and the hood angle.

PhotonVision publishes in the table /photonvision/NAME. Its `targetPose` is the transform from the camera to the tag (x
forward, y left, z up; a struct, or an array before 2025), and its `latencyMillis` is the time from exposure to
publication. Limelight publishes in the table /NAME. Its `targetpose_cameraspace` has x right, y down and z forward; the
latency in ms is `cl` + `tl`, and `stddevs` begins with the standard deviations of MegaTag 1 along the field's x and y.
Sources: PhotonVision's NTTopicSet and NTDataPublisher; Limelight's complete NetworkTables API.

If the control loop has its own process, another process reads the velocity keys, so that the tick never accesses the
network.
"""

import math
from collections.abc import Callable, Iterator, Mapping
from contextlib import ExitStack
from typing import NamedTuple, NoReturn

import msgspec
from msgspec.structs import replace

from truearc.errors import InputError
from truearc.hw.devices.family import CHECK, Around, Encoder, EncoderFamily, Finding, Heard, failure, ok
from truearc.hw.emulated.nodes import Plant
from truearc.hw.fault_codes import CAMERA_FROZEN
from truearc.hw.protocols import NS_PER_MS as MS
from truearc.hw.protocols import NS_PER_S, AngleReading, CameraFrame, Clock, LinkLost
from truearc.hw.real.clock import MonotonicClock
from truearc.hw.real.processes import Capacity, Child, Line, Slots, make_shared
from truearc.hw.reason import Reason
from truearc.robot import reasons as because
from truearc.robot.advice import CALM_S, DISTANCE_RATE_M_S, DISTANCE_STEP_M
from truearc.robot.config.named_tables import ReadEncoder
from truearc.robot.config.schema import Config
from truearc.robot.runtime import RigLayer, RobotIo
from truearc.robot.types import Inputs, RobotVelocity, Sighting
from truearc_frc.keys import Keys, NtKeys, Reading
from truearc_frc.table import NAME, Nt4Velocity, Nt4Vision, nt4_of

# --- camera

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
    """Return the keys that are read for a camera."""
    table = vision.camera.strip("/")
    if vision.kind == "photonvision":
        table = f"/photonvision/{table.removeprefix('photonvision/')}"
        return Names(f"{table}/heartbeat", f"{table}/hasTarget", (f"{table}/latencyMillis",), f"{table}/targetPose")
    return Names(f"/{table}/hb", f"/{table}/tv", (f"/{table}/cl", f"/{table}/tl"),
                 f"/{table}/targetpose_cameraspace", f"/{table}/stddevs", f"/{table}/tid")


def keys_of_camera(vision: Nt4Vision) -> list[str]:
    """Return those keys, with each array element as a separate key."""
    names = names_of_camera(vision)
    parts = [_part(names.pose, place) for place in range(3)]
    parts += [_part(names.stddevs, place) for place in range(MEGATAG_1) if names.stddevs]
    return [names.alive, names.seen, *names.latency, *parts, *filter(None, [names.tag])]


def calibration_key(vision: Nt4Vision) -> str | None:
    """Return a key that is present if the camera is calibrated; None if none tells."""
    names = names_of_camera(vision)
    return f"{names.pose.rpartition('/')[0]}/cameraIntrinsics/0" if vision.kind == "photonvision" else None


class NtCamera:
    """truearc.robot.eyes.Eyes on keys; neither call waits for the network.

    A distance is horizontal, from the lens to [apriltag] behind_m beyond the tag, as for an image. Tags that are not
    the target's, or whose height contradicts the camera's mounting, are ignored. Both calls raise LinkLost for a key
    that is missing or has an impossible value, for a position that changes while the heartbeat does not, and for half a
    second after a distance that jumped.
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
        """Return the new sighting in these readings."""
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
        slope = abs(above_m) / to_tag_m if to_tag_m > 0.0 else 0.0      # what a distance's error makes of the height
        if abs(off_m) > OFF_SIGMAS * math.hypot(
                self._camera.height_sigma_m, to_tag_m * math.radians(self._camera.pitch_sigma_deg), slope * sigma_m):
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
    """An NtCamera that owns its connection and closes it."""

    def __init__(self, config: Config, clock: Clock) -> None:
        nt4 = nt4_of(config)
        assert nt4 is not None and nt4.vision is not None
        self._own = NtKeys(nt4.server, keys_of_camera(nt4.vision))
        super().__init__(config, self._own, clock)

    def close(self) -> None:
        self._own.close()


def _part(key: str, place: int) -> str:
    return f"{key}/{place}"


# --- velocity

# Most that a robot's velocity and heading can change by: at once, and on top of it per second
STEP_M_S, RATE_M_S2 = 1.0, 15.0
STEP_RAD, RATE_RAD_S = 0.3, 20.0
LOOK_S = 0.005                        # between looks for a newer velocity, of the process that reads it
CLOSE_S = 2.0                         # for that process to end
ROOM = Capacity(4, 256)


def keys_of_velocity(velocity: Nt4Velocity) -> list[str]:
    """Return the keys that are read, with each array element as a separate key."""
    return [f"{velocity.key}/0", f"{velocity.key}/1", *filter(None, [velocity.heading, velocity.alive])]


class NtVelocity:
    """Velocity from keys: none if one is missing or not finite, and for half a second after one that jumped.

    It is as old as its oldest part; with `alive`, it is as old as that key, so that a velocity or heading may stay
    constant.
    """

    def __init__(self, config: Config, keys: Keys, clock: Clock) -> None:
        nt4 = nt4_of(config)
        assert nt4 is not None and nt4.velocity is not None
        self._asked, self._keys, self._clock = nt4.velocity, keys, clock
        self._last: tuple[RobotVelocity, float] | None = None       # and the heading, rad
        self._jumped_ns: int | None = None

    def read(self) -> RobotVelocity | None:
        return self.take(self._keys.read(self._clock.now_ns())) if self._keys.connected else None

    def take(self, found: Mapping[str, Reading]) -> RobotVelocity | None:
        """Return the velocity in these readings."""
        keys = keys_of_velocity(self._asked)
        readings = [found[key] for key in keys if key in found]
        numbers = [one.value for one in readings if not isinstance(one.value, str)]
        if len(numbers) < len(keys) or not all(map(math.isfinite, numbers)):
            return None
        forward, left = numbers[:2]
        heading, stamps = 0.0, [max(one.t_ns for one in readings[:2])]      # one array: of the part that changed last
        if self._asked.heading:
            heading = numbers[2] if self._asked.heading_unit == "rad" else math.radians(numbers[2])
            c, s = math.cos(heading), math.sin(heading)
            forward, left = c * forward + s * left, c * left - s * forward
            stamps.append(readings[2].t_ns)
        new = RobotVelocity(readings[-1].t_ns if self._asked.alive else min(stamps), forward, left)
        return None if self._jumps(new, heading) else new

    def _jumps(self, new: RobotVelocity, heading: float) -> bool:
        before, self._last = self._last, (new, heading)
        if before is not None:
            last, gap_s = before[0], max(new.t_ns - before[0].t_ns, 0) / NS_PER_S
            change = math.hypot(new.forward_m_s - last.forward_m_s, new.left_m_s - last.left_m_s)
            turned = abs(math.remainder(heading - before[1], math.tau))
            if change > STEP_M_S + RATE_M_S2 * gap_s or turned > STEP_RAD + RATE_RAD_S * gap_s:
                self._jumped_ns = new.t_ns
        return self._jumped_ns is not None and (new.t_ns - self._jumped_ns) / NS_PER_S <= CALM_S


class OwnNtVelocity(NtVelocity):
    """An NtVelocity that owns its connection and closes it."""

    def __init__(self, config: Config, clock: Clock) -> None:
        nt4 = nt4_of(config)
        assert nt4 is not None and nt4.velocity is not None
        self._own = NtKeys(nt4.server, keys_of_velocity(nt4.velocity))
        super().__init__(config, self._own, clock)

    def close(self) -> None:
        self._own.close()


def tell_velocity(velocity: NtVelocity, slots: Slots, is_over: Callable[[float], bool]) -> None:
    """Report every change until `is_over`, which is called with the time to wait."""
    told: RobotVelocity | None = None
    while not is_over(LOOK_S):
        newest = velocity.read()
        if newest != told:
            told = newest
            slots.put(msgspec.json.encode(newest))


class FarVelocity:
    """The velocity reported by another process; if that process dies, its timestamp becomes old."""

    def __init__(self, slots: Slots) -> None:
        self._slots = slots
        self._newest: RobotVelocity | None = None
        self._decoder = msgspec.json.Decoder(RobotVelocity | None)

    def read(self) -> RobotVelocity | None:
        text = self._slots.read()
        if text is not None:
            self._newest = self._decoder.decode(text)
        return self._newest


class MovingRig(RigLayer):
    """A rig whose inputs include the robot's motion."""

    def __init__(self, rig: RobotIo, velocity: "NtVelocity | FarVelocity") -> None:
        super().__init__(rig)
        self._velocity = velocity

    def read(self) -> Inputs | None:
        inputs, newest = self._rig.read(), self._velocity.read()
        return inputs if inputs is None or newest is None else replace(inputs, velocity=newest)


def open_moving(config: Config, wires: ExitStack, is_apart: bool) -> Callable[[RobotIo], RobotIo]:
    """Return a factory of rigs whose inputs include the robot's motion; `wires` closes it. is_apart: in a separate
    process."""
    if not is_apart:
        own = OwnNtVelocity(config, MonotonicClock())
        wires.callback(own.close)
        return lambda rig: MovingRig(rig, own)
    shared = make_shared(ROOM.bytes)
    far = FarVelocity(Slots(shared, ROOM))
    child = Child("velocity", _drive, (config, shared), restarts=True, mortal=True)
    wires.callback(child.close, CLOSE_S)
    return lambda rig: MovingRig(rig, far)


def _drive(line: Line, is_first: bool, config: Config, memory: object) -> None:
    """The process that reads how the robot drives."""
    velocity = OwnNtVelocity(config, MonotonicClock())
    line.say(None)
    tell_velocity(velocity, Slots(memory, ROOM), line.is_over)
    velocity.close()


# --- the hood's angle

DEGREES = {"deg": 1.0, "rad": 180.0 / math.pi, "rev": 360.0}
MOST_DEG = 360.0                      # in size; more is not an angle of a hood, or not in this unit
SIGMA_DEG = 0.3                       # it is up to two of the robot's loops old, and so may a moving hood's be off
LOOP_NS = 20 * MS                     # of a robot program
LOOK_NS, STEP_NS = 2000 * MS, 5 * MS  # that the doctor waits for the server


class NtEncoder(Encoder):
    """The newest value of a key, stamped when it was published, so that a missing value grows old."""

    def __init__(self, table: ReadEncoder, keys: Keys) -> None:
        self._key, self._deg, self._keys = table.key, DEGREES[table.unit], keys
        self._faults: tuple[Reason, ...] = ()

    def read(self, t_ns: int) -> AngleReading | None:
        found = self._keys.read(t_ns).get(self._key)
        self._faults = () if self._keys.connected else (because.NT_LOST(),)
        if found is None:
            self._faults += (because.KEY_MISSING(key=self._key),)
        elif isinstance(found.value, str) or not abs(angle_deg := found.value * self._deg) <= MOST_DEG:
            self._faults += (because.KEY_IMPLAUSIBLE(key=self._key, value=str(found.value)),)
        else:
            self.reading = AngleReading(found.t_ns, math.radians(angle_deg % 360.0), True)
        return self.reading

    def faults(self, t_ns: int) -> tuple[Reason, ...]:
        return self._faults


def examine(table: ReadEncoder, around: Around, heard: Heard) -> Iterator[Finding]:
    """Check whether the server is there, has the key, and publishes it often enough."""
    try:
        keys = NtKeys(around.readings[NAME]["server"], [table.key])
    except InputError as error:
        yield failure(CHECK, str(error), "see nt4.server")
        return
    encoder, clock, last, changes = NtEncoder(table, keys), MonotonicClock(), 0, 0
    until_ns = clock.now_ns() + LOOK_NS
    while (now_ns := clock.now_ns()) < until_ns and changes < 3:
        reading = encoder.read(now_ns)
        if reading is not None and reading.t_ns - last > MS:      # two clocks: the same value's stamp moves a little
            last, changes = reading.t_ns, changes + 1
        clock.sleep_until_ns(now_ns + STEP_NS)
    keys.close()
    if faults := encoder.faults(now_ns):
        yield failure(CHECK, "; ".join(because.texts(faults)), "look at nt4.server, hood_encoder.key and unit")
    elif changes < 3:
        yield failure(CHECK, f"{table.key} stands still", "publish it in each loop, equal values too")
    else:
        yield ok(CHECK, f"{table.key} is published")


class _WorldKeys:
    """Keys of the emulated robot's own program: the angle as of its newest loop."""

    connected = True

    def __init__(self, table: ReadEncoder, plant: Plant) -> None:
        self._table, self._plant = table, plant
        self._newest: Reading | None = None

    def read(self, now_ns: int) -> Mapping[str, Reading]:
        table = self._table
        if self._newest is None or now_ns - self._newest.t_ns >= LOOP_NS:
            angle_deg = table.zero_deg + table.direction * math.degrees(self._plant.hood_encoder_rad())
            self._newest = Reading(now_ns, angle_deg / DEGREES[table.unit])
        return {table.key: self._newest}


NT_ENCODER = EncoderFamily(
    driver=NAME, table=ReadEncoder, example=ReadEncoder(NAME, "/Hood/AngleDeg", "deg", 0.0, 1),
    least_sigma_deg=SIGMA_DEG,
    make=lambda table, around: NtEncoder(table, NtKeys(around.readings[NAME]["server"], [table.key])),
    make_rules=lambda table, each_tick: (), questions=lambda table: (), examine=examine,
    make_node=lambda table, plant, nodes: None,
    make_off_bus=lambda table, plant: NtEncoder(table, _WorldKeys(table, plant)))

"""The schema and hash of launcher.toml. No key has a default, so a misspelt key cannot silently fall back to one."""

import hashlib
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Any, Literal, TypeVar

import msgspec
from msgspec import Struct
from msgspec.structs import replace

from truearc import errors
from truearc.errors import ELSEWHERE, InputError, PluginError, line_of_key, load_text, needs, struct_in
from truearc.hw.devices import registry
from truearc.hw.devices.family import Axis, Finite, HoodEncoder, Positive
from truearc.robot.config import named_tables
from truearc.robot.config.limits import cannot_throw, contradictions, warn_of_pitch, warn_of_terms
from truearc.robot.config.rig_spec import Rig, rig_errors
from truearc.robot.config.targets import misplaced

Kind = TypeVar("Kind")
Doubt = Annotated[float, msgspec.Meta(ge=0.0, lt=1e9)]
Place = Annotated[float, msgspec.Meta(gt=-1e6, lt=1e6)]   # any number, but neither infinite nor none
Share = Annotated[float, msgspec.Meta(ge=0.0, le=1.0)]
Some = Annotated[float, msgspec.Meta(ge=0.0, le=1e4)]     # a finite standard deviation, or 0
Least = Annotated[float, msgspec.Meta(gt=0.0, le=1e4)]    # ... and some in any case
Hue = Annotated[int, msgspec.Meta(ge=0, le=179)]          # OpenCV's, two degrees each
Slope = Annotated[float, msgspec.Meta(gt=-90.0, lt=90.0)]
Level = Annotated[int, msgspec.Meta(ge=0, le=255)]
Count = Annotated[int, msgspec.Meta(gt=0, lt=1_000_000)]


class Can(Struct, frozen=True, forbid_unknown_fields=True):
    interface: str                    # python-can interface name: socketcan, slcan, virtual, ...
    channel: str
    bitrate: Annotated[int, msgspec.Meta(ge=10_000, le=1_000_000)]


class Buttons(Struct, frozen=True, forbid_unknown_fields=True):
    port: str                         # serial device or pyserial URL such as socket://host:port
    baud: Annotated[int, msgspec.Meta(ge=300, le=4_000_000)]


class _AnyDevice(Struct):
    """The key of every device's table; nothing is ever one of these."""

    driver: str


class Axes(Struct, frozen=True, forbid_unknown_fields=True):
    flywheels: Annotated[tuple[Axis, ...], msgspec.Meta(min_length=1)]    # every motor on the one flywheel belt
    hood: Axis
    feeder: Axis


class PidGains(Struct, frozen=True, forbid_unknown_fields=True):
    kp: Finite
    ki: Finite
    kd: Finite
    derivative_tau_s: Doubt           # first-order filter of the derivative, taken on the measurement
    integral_limit: Doubt             # |integral term| at most, in output units
    output_low: Finite
    output_high: Finite


class Flywheel(Struct, frozen=True, forbid_unknown_fields=True, omit_defaults=True):
    """Speed loop on the belt: output is torque on each motor; feed-forward ks + kv w + ka dw/dt."""

    pid: PidGains                     # input rad/s at the motor
    ks_nm: Finite
    kv_nm_s: Finite                    # per rad/s
    ka_nm_s2: Finite                   # per rad/s^2
    brake: bool                       # may an overspeeding wheel be given negative torque?
    tolerance_rad_s: Positive
    spread_rad_s: Positive               # motors of one belt may differ by this much
    steady_s: Doubt                   # within tolerance this long before firing
    idle_s: Doubt = 10.0                  # without target and request; 0 = never


class Hood(Struct, frozen=True, forbid_unknown_fields=True, omit_defaults=True):
    """Angle loop over an acme screw: a motor on a pivot turns the screw, a nut on the hood rides it."""

    pid: PidGains                     # input degrees of elevation; output Nm at the motor
    friction_nm: Doubt                # torque that just moves the screw, added in the direction of motion
    deadband_deg: Doubt               # inside it the self-locking screw is left alone
    low_deg: Finite                    # elevation at the limit switch
    high_deg: Finite
    tolerance_deg: Positive
    screw_lead_m: Positive               # nut travel per screw turn
    screw_gear: Positive                 # screw turns per motor turn
    pivot_to_motor_m: Positive
    pivot_to_nut_m: Positive
    included_deg: Finite               # angle motor-pivot-nut when the elevation is 0; it grows with elevation
    homing_torque_nm: Finite           # negative: towards the switch
    crosscheck_deg: Positive             # absolute and screw encoder may differ by this much
    max_deg_s: Positive = 20.0        # fastest change of elevation, homing included
    holds_itself: bool = False        # it stays where it is without torque; no other hood is driven


class Feeder(Struct, frozen=True, forbid_unknown_fields=True):
    torque_nm: Finite
    feed_s: Positive
    clear_s: Doubt                    # no new shot for this long after one


class CameraConfig(Struct, frozen=True, forbid_unknown_fields=True, omit_defaults=True):
    """Pinhole and Brown distortion at the stated size; the mounting relative to the ball's exit point.

    The calibration's own standard deviations are 0 where none is stated, so that recordings from before these keys
    existed keep their hash (as with the exposure). `truearc vision-calibrate` writes them.
    """

    device: str                       # V4L2 path or index
    width_px: Count
    height_px: Count
    fps: Positive
    fx_px: Positive
    fy_px: Positive
    cx_px: Place
    cy_px: Place
    distortion: tuple[Place, Place, Place, Place, Place]    # k1 k2 p1 p2 k3
    height_m: Place                   # lens above floor
    height_sigma_m: Least             # how well that is known, one standard deviation
    pitch_deg: Slope                  # optical axis above horizontal
    pitch_sigma_deg: Least            # how well that, and that the camera is not rolled, is known
    behind_exit_m: Place              # lens behind the ball's exit point
    focal_sigma: Share = 0.0          # of both focal lengths together
    aspect_sigma: Share = 0.0         # of fy / fx
    centre_sigma_px: Some = 0.0       # of cx and of cy
    bias_m: Place = 0.0               # distances come out this much too long whatever they are
    bias_sigma_m: Some = 0.0
    exposure_s: Doubt = 0.0           # set in a local device at start and read back; 0: the camera chooses
    readout_s: Share = 0.03           # of a rolling shutter, from the first row's exposure to the last one's
    target: Literal["tape", "apriltag"] = "tape"
    turn_sigma_deg_s: Some = 10.0     # how fast the camera may turn meanwhile, one standard deviation


class Tape(Struct, frozen=True, forbid_unknown_fields=True):
    """Outer outline of the retro-reflective target: the lower half of a regular hexagon, open at the top."""

    top_width_m: Positive
    bottom_width_m: Positive
    height_m: Positive
    tape_width_m: Positive
    centre_height_m: Place            # tape's vertical middle above floor


class AprilTag(Struct, frozen=True, forbid_unknown_fields=True):
    """Tags of the family 36h11, hung upright at one height; `behind_m`: distance of the target plane behind them."""

    ids: tuple[Annotated[int, msgspec.Meta(ge=0, le=586)], ...]
    side_m: Positive                  # of the black square
    centre_height_m: Place            # tag's centre above floor
    behind_m: Place = 0.0
    corner_sigma_px: Positive = 0.02  # of a corner's coordinate of a tag that is near; far away it is worse


class Vision(Struct, frozen=True, forbid_unknown_fields=True):
    hue_low: Hue                      # low > high wraps around
    hue_high: Hue
    saturation_low: Level
    value_low: Level
    min_area_px: Doubt
    corner_sigma_px: Positive         # of a corner's coordinate, beside what its edges' own unevenness shows
    max_reprojection_px: Positive


class GateConfig(Struct, frozen=True, forbid_unknown_fields=True):
    policy: str                       # "collect": fires on the driver's button; "model": the model must agree
    threshold: Annotated[float, msgspec.Meta(ge=0.0, le=1.0)]                  # p_three at least
    reading_age_s: Positive              # oldest motor or encoder reading that may fire
    sighting_age_s: Positive             # oldest sighting that may fire
    request_s: Positive                  # a fire request lapses after this
    doubt_s: Doubt                    # ... and after this when only the model says no


class Prescribed(Struct, frozen=True, forbid_unknown_fields=True):
    """One configuration to be shot exactly as given."""

    distance_m: Positive              # where the driver is to stand: ball exit to target plane, horizontal
    motor_ratio: Annotated[float, msgspec.Meta(gt=0.0, le=1.0)]
    hood_deg: Finite


class Collect(Struct, frozen=True, forbid_unknown_fields=True, omit_defaults=True):
    """Deliberately spread set points, aimed by vacuum ballistics with a correction from the driver's marks.

    If `prescribed` is given, those are shot in order, and marks do not change them. It has a default, so that older
    recordings keep their meaning.
    """

    hood_low_deg: Finite
    hood_high_deg: Finite
    spread: Doubt                     # speeds are trimmed by up to this fraction
    repeats: Annotated[int, msgspec.Meta(ge=1)]                      # shots at each configuration
    efficiency: Positive                 # first guess of vacuum exit speed / mean wheel surface speed, air included
    walk_start: tuple[Finite, Finite, Finite]    # where the walk begins: level, slope in distance, slope in elevation
    walk_step: Finite                  # log speed per high/low mark
    prescribed: tuple[Prescribed, ...] = ()       # what `--plan` gives; see truearc.robot.aim_file


class AimConfig(Struct, frozen=True, forbid_unknown_fields=True):
    """Where set points come from: the plan of [collect], or an aim file (truearc.robot.aim_file)."""

    policy: Literal["plan", "belief"]
    correction_step: Doubt            # belief: change of log speed per miss marked high or low


class Excite(Struct, frozen=True, forbid_unknown_fields=True):
    """How `truearc sysid` drives one joint: torque at the motor shaft, speed at the motor."""

    repeats: Annotated[int, msgspec.Meta(ge=0)]              # 0 leaves the joint alone
    ramp_nm_s: Positive               # quasistatic: the torque grows this fast, up to that of the step
    step_nm: Positive                 # dynamic: this torque at once
    top_rad_s: Positive               # here driving ends and coasting begins
    longest_s: Positive               # of one phase


class ExciteFlywheel(Excite, frozen=True, forbid_unknown_fields=True):
    reverse: bool                     # may the wheels be driven backwards?


class ExciteHood(Excite, frozen=True, forbid_unknown_fields=True):
    margin_deg: Positive              # driving ends this far before the ends of the hood's travel


class Identify(Struct, frozen=True, forbid_unknown_fields=True):
    flywheel: ExciteFlywheel
    hood: ExciteHood


class RecordingConfig(Struct, frozen=True, forbid_unknown_fields=True, omit_defaults=True):
    """How much of earlier sessions `truearc run` keeps on the disk; an absent key sets no limit."""

    keep_gb: Positive | None = None   # 1e9 bytes, of all sessions
    keep_days: Positive | None = None     # since a session's last tick


class Config(Struct, frozen=True, forbid_unknown_fields=True, omit_defaults=True):
    """launcher.toml. Without [identify] the robot runs no identification; without [aim] it aims by the plan; recordings
    made before these sections existed keep their meaning."""

    tick_hz: Count
    can: Can
    buttons: Buttons
    axes: Axes
    hood_encoder: HoodEncoder
    flywheel: Flywheel
    hood: Hood
    feeder: Feeder
    camera: CameraConfig
    tape: Tape
    vision: Vision
    gate: GateConfig
    collect: Collect
    rig: Rig
    identify: Identify | None = None
    aim: AimConfig = AimConfig("plan", 0.0)
    apriltag: AprilTag | None = None
    recording: RecordingConfig | None = None
    readings: dict[str, dict[str, Any]] = {}      # tables of other distributions, by name, as plain data

    @property
    def driving(self) -> named_tables.Driving | None:
        """What the tick must know of a robot that reports its motion; None: it must stand still to shoot."""
        if not self.readings:
            return None
        found = next((table["velocity"] for table in self.readings.values() if "velocity" in table), None)
        return found and named_tables.Driving(found["most_m_s"], found["pointing_deg"], found.get("delay_s", 0.0))

    @property
    def is_seen_elsewhere(self) -> bool:
        """Whether a camera other than [camera] sees the target."""
        return any("vision" in table for table in self.readings.values())


class CameraFile(Struct, frozen=True, forbid_unknown_fields=True, omit_defaults=True):
    """camera.toml: the sections of launcher.toml that `truearc vision` needs."""

    camera: CameraConfig
    tape: Tape
    vision: Vision
    apriltag: AprilTag | None = None


def load_config(path: str | Path) -> Config:
    """Read launcher.toml; InputError names file, key and line, or the key of an impossible number."""
    text = load_text(path)
    config = parse_toml(text, Config, str(path))
    for key in errors.unknown_keys(errors.parse_table(text, str(path))["rig"], Rig):
        raise InputError(f"{path}{line_of_key(text, f'rig.{key}')}: rig.{key}: unknown key"
                         f"{errors.near_key(key, Rig, None)}")
    stated = misplaced(errors.parse_table(text, str(path))["rig"])
    of_rig = ((f"rig.{key}", what) for key, what in (*stated, *rig_errors(config.rig)))
    for key, what in (*of_rig, *contradictions(config), *cannot_throw(config.rig)):
        raise InputError(f"{path}{line_of_key(text, key)}: {key}: {what}")
    warn_of_pitch(path, config.camera)
    warn_of_terms(path, config.rig)
    return config


def load_toml(path: str | Path, kind: type[Kind]) -> Kind:
    """Read a TOML file into a struct; InputError names file, key and line."""
    return parse_toml(load_text(path), kind, str(path))


def parse_toml(text: str, kind: type[Kind], name: str) -> Kind:
    """Parse TOML text as load_toml does; `name` is its source."""
    others = _other_tables(errors.parse_table(text, name), text, name) if kind is Config else ()
    plain: Kind = _as_plain(
        errors.parse_struct(text, _beside(kind, others), name, read_axis, table_struct, _known), kind, others)
    return plain


def _other_tables(table: dict[str, Any], text: str, name: str) -> tuple[named_tables.ReadingTable, ...]:
    """The tables of other distributions, where there is one that is not truearc's own.

    Raises:
        InputError: one is of a distribution that is not installed, or that cannot be loaded.
    """
    if "readings" in table:
        raise InputError(f"{name}{line_of_key(text, 'readings')}: readings: unknown key")
    if table.keys() <= set(Config.__struct_fields__):
        return ()
    installed = named_tables.table_names()
    for absent in sorted((table.keys() & ELSEWHERE.keys()) - {*installed}):
        raise InputError(f"{name}: [{absent}]: {needs(absent)}")
    try:
        return tuple(map(named_tables.find_table, installed))
    except PluginError as error:
        raise InputError(f"{name}: {error}") from error


def _beside(kind: Any, others: Sequence[named_tables.ReadingTable]) -> Any:
    """The struct with a field for each of these tables, so that what is wrong in one is said as of truearc's own."""
    if not others:
        return kind
    return msgspec.defstruct(kind.__name__, [(one.name, one.table | None, None) for one in others], bases=(kind,),
                             frozen=True, forbid_unknown_fields=True, omit_defaults=True)


def _as_plain(found: Any, kind: Any, others: Sequence[named_tables.ReadingTable]) -> Any:
    """What was read, with those tables as plain data in `readings`."""
    if not others:
        return found
    read = {one.name: named_tables.stated(table) for one in others if (table := getattr(found, one.name)) is not None}
    return kind(**{field: getattr(found, field) for field in kind.__struct_fields__} | {"readings": read})


def read_axis(kind: type, table: Any) -> Axis | HoodEncoder:
    """Decode an axis or [hood_encoder] (msgspec's dec_hook) by its driver's family; ValueError says what is wrong."""
    driver = table.get("driver") if isinstance(table, dict) else None
    try:
        struct: Any = table_of(kind, table) if isinstance(driver, str) else _AnyDevice
        read: Axis | HoodEncoder = msgspec.convert(table, struct, dec_hook=read_axis)
        return read
    except LookupError:
        raise ValueError(f"Invalid value {driver!r} - at `$.driver`") from None
    except msgspec.ValidationError as error:
        raise ValueError(errors.joined(str(error))) from error


def table_struct(annotation: Any, table: Any) -> Any:
    """Return the struct of a field's table, from its annotation or a device's driver; None if there is none."""
    if (plain := struct_in(annotation)) is not None:
        return plain
    driver = table.get("driver") if isinstance(table, dict) else None
    kind = _device(annotation)
    try:
        return table_of(kind, table) if kind is not None and isinstance(driver, str) else None
    except (LookupError, PluginError):
        return None


def _device(annotation: Any) -> Any:
    if annotation in (Axis, HoodEncoder):
        return annotation
    return next(filter(None, map(_device, getattr(annotation, "__args__", ()))), None)


def table_of(kind: Any, table: dict[str, Any]) -> Any:
    """Return the struct of a device's table, by its driver; kind: Axis or HoodEncoder. Raises as find_family does."""
    if kind is HoodEncoder:
        return named_tables.encoder_table(table["driver"], "key" in table)
    return registry.find_family(table["driver"]).axis


def _known(key: str) -> list[str]:
    """The values of a key that takes few."""
    if key == "hood_encoder.driver":
        return list(named_tables.encoder_drivers())
    if key.endswith(".driver") or key == "hood_encoder.controller":
        return list(registry.drivers())
    few = {"aim.policy": ["plan", "belief"]}
    return ["1", "-1"] if key.endswith(".direction") else few.get(key, [])


def with_ports(config: Config, can: str | None, buttons: str | None, camera: str | None) -> Config:
    """Return `config` with these ports; InputError names one that is invalid."""
    if can is not None:
        interface, channel = split_bus(can, "--can")
        config = replace(config, can=Can(interface, channel, config.can.bitrate))
    if buttons is not None:
        config = replace(config, buttons=replace(config.buttons, port=buttons))
    if camera is not None:
        config = replace(config, camera=replace(config.camera, device=camera))
    return config


def split_bus(bus: str, option: str) -> tuple[str, str]:
    """Return (interface, channel) of `interface:channel`; the channel may contain colons."""
    interface, _, channel = bus.partition(":")
    if not interface or not channel:
        raise InputError(f"{option} {bus}: an interface and a channel, such as slcan:/dev/ttyACM0 or socketcan:can0")
    return interface, channel


# --- as a recording keeps it: config.json, and the hash by which session.json names it

def config_hash(config: Config) -> str:
    """Return the SHA-256 of the configuration's content, independent of how it was written or obtained.

    An optional key with its default value counts as absent, so that a later version may add keys.
    """
    table = named_tables.stated(config)
    return _sha256(table | table.pop("readings", {}))


def is_hash_of(sha256: str, config: Config) -> bool:
    """Return whether a recording's hash is this configuration's.

    Recordings made until November 2026 hash the encoded text, which omitted a default only if it was the same object; a
    configuration read back from its own file is still encoded in that way.
    """
    return sha256 in (config_hash(config), hashlib.sha256(msgspec.json.encode(plain_table(config))).hexdigest())


def plain_table(config: Config) -> dict[str, Any]:
    """Return the configuration as in config.json: tables of other distributions stand beside truearc's own."""
    table: dict[str, Any] = msgspec.to_builtins(config)
    others: dict[str, Any] = table.pop("readings", {})
    last = {key: table.pop(key) for key in ("recording",) if key in table}
    return table | others | last


def config_of(data: dict[str, Any]) -> Config:
    """Return the configuration in config.json's data; msgspec.ValidationError if it is invalid.

    A table of another distribution is accepted as it is, even if that distribution is not installed.
    """
    others = {name: part for name, part in data.items()
              if name not in Config.__struct_fields__ and isinstance(part, dict)}
    own = {name: part for name, part in data.items() if name not in others}
    return msgspec.convert(own | {"readings": {name: _without_defaults(name, part) for name, part in others.items()}},
                           Config, dec_hook=read_axis)


def _without_defaults(name: str, table: dict[str, Any]) -> dict[str, Any]:
    """The table as a hash takes it; as it is where nothing installed knows it."""
    try:
        plain: dict[str, Any] = named_tables.stated(msgspec.convert(table, named_tables.find_table(name).table))
        return plain
    except (LookupError, PluginError):
        return table


def _sha256(content: object) -> str:
    return hashlib.sha256(msgspec.json.encode(content, order="deterministic")).hexdigest()

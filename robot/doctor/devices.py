"""Every device on the bus: what to ask, and what to make of it; the gate's model, and the aim file."""

from collections.abc import Iterator
from pathlib import Path

from truearc.hw.devices.canandmag.doctor import check_encoder
from truearc.hw.devices.canandmag.frames import Encoder
from truearc.hw.devices.family import AxisCheck, Endpoints
from truearc.hw.devices.listening import Heard
from truearc.hw.devices.odrive.parameters import parse_endpoints
from truearc.hw.devices.registry import family_of
from truearc.hw.finding import Finding, failure, ok
from truearc.hw.protocols import Frame
from truearc.robot.aim_file import load_aim_for, needs_aim
from truearc.robot.config.schema import Config, GateConfig, InputError, load_text
from truearc.robot.gate.contract import FEATURES
from truearc.robot.gate.model import load_gate
from truearc.robot.motors import name_axes


def load_endpoints(path: Path) -> Endpoints:
    """Read flat_endpoints.json; InputError names the file and what is missing."""
    try:
        return parse_endpoints(load_text(path))
    except ValueError as error:
        raise InputError(f"{path}: {error}") from error


def questions(config: Config, endpoints: Endpoints | None) -> list[Frame]:
    """Reads only: each axis's version, and its parameters when their numbers are known; nothing of advisory ones."""
    return [frame for _, axis in name_axes(config) for frame in family_of(axis).questions(axis, endpoints)]


def check_devices(config: Config, endpoints: Endpoints | None, heard: Heard) -> Iterator[Finding]:
    """Axes in the configuration's order, then the hood's encoder."""
    for name, axis in name_axes(config):
        yield from family_of(axis).examine(axis, AxisCheck(name, config.tick_hz, endpoints), heard)
    encoder = config.hood_encoder
    yield check_encoder(Encoder(encoder.device), encoder.period_ms, config.gate.reading_age_s, heard)


def check_model(gate: GateConfig, path: Path | None) -> Finding:
    """Whether the model that the policy asks for is there, whole, and made for this robot's contract."""
    check = "gate model"
    if path is None:
        if gate.policy == "model":
            return failure(check, "gate.policy is 'model' and no model was given", "give --gate, as to `truearc run`")
        return ok(check, f"none is needed: gate.policy is {gate.policy!r}")
    try:
        model = load_gate(path)
    except InputError as error:
        return failure(check, str(error), "export it again with this version of truearc, and copy it whole")
    domain = ", ".join(f"{feature.name} {low:g} to {high:g}"
                       for feature, (low, high) in zip(FEATURES, model.domain, strict=True))
    return ok(check, f"sha256 {model.sha256[:12]}, this robot's contract; speaks of {domain}")


def check_aim(config: Config, path: Path | None) -> Iterator[Finding]:
    """Whether the aim file that the policy asks for is there, whole, and for this launcher; nothing without one."""
    check = "aim file"
    if not needs_aim(config):
        if path is not None:
            yield failure(check, f"aim.policy is {config.aim.policy!r}", "leave --aim out, or set it to 'belief'")
    elif path is None:
        yield failure(check, "aim.policy is 'belief' and no aim file was given", "give --aim, as to `truearc run`")
    else:
        try:
            aim = load_aim_for(path, config)
        except InputError as error:
            yield failure(check, str(error), "make it again with `truearc aim --robot` and this launcher.toml")
            return
        spans = ", ".join(f"{one.distance_m[0]:g} to {one.distance_m[-1]:g} m" for one in aim.content.segments)
        yield ok(check, f"sha256 {aim.sha256[:12]}, set points for {spans}")

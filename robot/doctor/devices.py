"""Every device on the bus: what to ask, and what to make of it."""

from collections.abc import Iterator

from hw import odrive
from hw.link import Frame
from robot.config import Config
from robot.doctor.finding import Finding
from robot.doctor.hood import check_encoder
from robot.doctor.listening import Heard
from robot.doctor.motors import check_errors, check_firmware, check_rates, named_axes
from robot.doctor.parameters import Endpoints, check_filter, check_table, check_watchdog
from robot.doctor.parameters import questions as parameter_questions


def questions(config: Config, endpoints: Endpoints | None) -> list[Frame]:
    """Reads only: each axis's version, and its parameters when their numbers are known."""
    return [frame for _, axis, _ in named_axes(config.axes)
            for frame in (odrive.make_version_query(axis), *parameter_questions(axis, endpoints))]


def check_devices(config: Config, endpoints: Endpoints | None, heard: Heard) -> Iterator[Finding]:
    """Axes in the configuration's order, then the hood's encoder."""
    for name, axis, rates in named_axes(config.axes):
        yield check_firmware(name, axis, heard)
        yield check_rates(name, axis, rates, heard)
        yield check_errors(name, axis, heard)
        if (finding := check_table(name, axis, endpoints, heard)) is not None:
            yield finding
        yield check_watchdog(name, axis, endpoints, heard)
        yield check_filter(name, axis, endpoints, config.tick_hz, heard)
    yield check_encoder(config, heard)

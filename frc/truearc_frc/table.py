"""The schema of [nt4] in launcher.toml: the robot's NetworkTables server and the values exchanged with it."""

import re
from collections.abc import Iterator
from types import SimpleNamespace
from typing import Annotated, Literal

import msgspec
from msgspec import Meta, Struct
from msgspec.structs import replace

from truearc.hw.devices.family import Positive
from truearc.robot.config.limits import Limit, out_of_range
from truearc.robot.config.named_tables import stated
from truearc.robot.config.schema import Config

TEAM = re.compile(r"0*([1-9][0-9]{0,3}|1[0-9]{4}|2[0-4][0-9]{3}|25[0-5][0-9]{2})")   # as 10.TE.AM.2 can say
PORT = re.compile(r"[1-9][0-9]{0,4}")
MOST_PORT = 65535
EXPECTED = "give a team number (1 to 25599) or HOST[:PORT]"
NAME = "nt4"
LISTEN_S = 2.0                        # to the server's keys before they are judged, if not said
LIMITS = (
    Limit("nt4.velocity.most_m_s", 0.01, 6, "above, no robot drives; this may be another unit"),
    Limit("nt4.velocity.pointing_deg", 0.1, 15, "below, no heading is so exact; above, every ball misses"),
    Limit("nt4.velocity.delay_s", 0, 1, "above, no ball is so late"),
)


class Nt4Vision(Struct, frozen=True, forbid_unknown_fields=True, omit_defaults=True):
    """An external camera that sees tags. [camera] gives its mounting; [apriltag] gives the valid tags and their height.

    The standard deviation of a distance combines all of these and what the camera itself reports.
    """

    kind: Literal["photonvision", "limelight"]
    camera: str                       # its name there: PhotonVision's nickname, Limelight's table ("limelight")
    sigma_m: Positive                 # standard deviation of a distance, whatever it is
    sigma_share: Annotated[float, Meta(ge=0.0, le=1.0)] = 0.0      # and as a share of it


class Nt4Velocity(Struct, frozen=True, forbid_unknown_fields=True, omit_defaults=True):
    """The robot's velocity, for shots on the move; forward is where the launcher throws and the camera looks."""

    key: str                          # struct ChassisSpeeds, or an array that begins with forward and left, m/s
    most_m_s: Positive                # faster: HOLD
    pointing_deg: Positive            # the launcher may point this far off the lead
    delay_s: Annotated[float, Meta(ge=0.0, le=1.0)] = 0.0          # from a FIRE to when the ball leaves
    frame: Literal["robot", "field"] = "robot"
    heading: str = ""                 # field: key of the robot's heading, counter-clockwise
    heading_unit: Literal["rad", "deg"] = "rad"
    alive: str = ""                   # key that changes in every loop of the robot's program, so a velocity may rest


class Nt4(Struct, frozen=True, forbid_unknown_fields=True, omit_defaults=True):
    """Where `truearc run` publishes the values of `truearc advise`, and what it reads."""

    server: str                       # team number, or host[:port]
    vision: Nt4Vision | None = None
    velocity: Nt4Velocity | None = None


def server_parts(server: str) -> tuple[int, str, int] | None:
    """Return (team number, host, port) of TEAM or HOST[:PORT]; team 0: a host; port 0: the default port. None if it is
    neither."""
    if TEAM.fullmatch(server):
        return int(server), "", 0
    host, colon, port = server.partition(":")
    if not host or host.isdigit() or (colon and not (PORT.fullmatch(port) and int(port) <= MOST_PORT)):
        return None
    return 0, host, int(port) if colon else 0


def nt4_of(config: Config) -> Nt4 | None:
    """Return the table of a configuration; None if it has none."""
    return msgspec.convert(config.readings[NAME], Nt4) if NAME in config.readings else None


def with_nt4(config: Config, nt4: Nt4) -> Config:
    """Return the configuration with this table."""
    return replace(config, readings={**config.readings, NAME: stated(nt4)})


def nt4_errors(nt4: Nt4, config: Config) -> Iterator[tuple[str, str]]:
    """Return the key and error of each invalid value; config: all other tables."""
    yield from out_of_range(SimpleNamespace(nt4=nt4), LIMITS)
    if server_parts(nt4.server) is None:
        yield "nt4.server", f"{nt4.server!r} is not a robot: {EXPECTED}"
    if nt4.vision is not None and config.apriltag is None:
        yield "nt4.vision", "needs [apriltag], whose ids, centre_height_m and behind_m say which tags mark the target"
    if nt4.vision is not None and not nt4.vision.camera.strip("/"):
        yield "nt4.vision.camera", "is empty; give the camera's name"
    if nt4.velocity is not None and (nt4.velocity.frame == "field") != bool(nt4.velocity.heading):
        yield "nt4.velocity.heading", "is needed where frame = \"field\", and only there"

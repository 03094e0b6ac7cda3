"""`[nt4]` of launcher.toml: the robot's NetworkTables server, and what is exchanged with it."""

import re
from collections.abc import Iterator

from msgspec import Struct

TEAM = re.compile(r"0*([1-9][0-9]{0,3}|1[0-9]{4}|2[0-4][0-9]{3}|25[0-5][0-9]{2})")   # as 10.TE.AM.2 can say
PORT = re.compile(r"[1-9][0-9]{0,4}")
MOST_PORT = 65535
EXPECTED = "give a team number (1 to 25599) or HOST[:PORT]"


class Nt4(Struct, frozen=True, forbid_unknown_fields=True, omit_defaults=True):
    """Where `truearc run` publishes what `truearc advise` does."""

    server: str                       # team number, or host[:port]


def server_parts(server: str) -> tuple[int, str, int] | None:
    """(team number, host, port) of TEAM or HOST[:PORT]; team 0: a host; port 0: the usual one. None: it is neither."""
    if TEAM.fullmatch(server):
        return int(server), "", 0
    host, colon, port = server.partition(":")
    if not host or host.isdigit() or (colon and not (PORT.fullmatch(port) and int(port) <= MOST_PORT)):
        return None
    return 0, host, int(port) if colon else 0


def nt4_errors(nt4: Nt4) -> Iterator[tuple[str, str]]:
    """Key and objection of each value that cannot be."""
    if server_parts(nt4.server) is None:
        yield "nt4.server", f"{nt4.server!r} is not a robot: {EXPECTED}"

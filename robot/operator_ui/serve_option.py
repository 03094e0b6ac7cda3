"""`--page`: where the operator's page is served."""

import argparse
import sys

from truearc.hw.protocols import Clock
from truearc.robot.config.schema import Config, InputError
from truearc.robot.operator_ui.server import OperatorPage, ShowingRecorder
from truearc.robot.runtime import Recorder

HOST = "127.0.0.1"
PORT = 5808                           # a competition's network lets 5800 to 5810 through; 5810 is NetworkTables'
OFF = "off"


def add_page_argument(parser: argparse.ArgumentParser, default: str, note: str = "") -> None:
    parser.add_argument("--page", metavar="[HOST:]PORT", nargs="?", default=default, const=str(PORT),
                        help=f"the operator's page{note}; host 0.0.0.0 lets other machines look, 'off' serves none "
                             f"(default: {default}; without a value: {PORT})")


def parse_page(text: str) -> tuple[str, int] | None:
    """(host, port) of what --page says; None for off; InputError for what is no address."""
    if text == OFF:
        return None
    host, _, port = text.rpartition(":")
    if not port.isdecimal() or int(port) > 65535:
        raise InputError(f"--page {text}: a port from 0 to 65535, HOST:PORT, or 'off'")
    return host.removeprefix("[").removesuffix("]") or HOST, int(port)


def open_page(text: str, config: Config, recording: str, clock: Clock) -> OperatorPage | None:
    """The page, if one is wanted and can be had; a robot runs on without, and says so."""
    where = parse_page(text)
    if where is None:
        return None
    try:
        page = OperatorPage(config, recording, *where, clock)
    except OSError as error:
        print(f"truearc: no operator's page on {text} ({error.strerror or error}); --page takes another port",
              file=sys.stderr)
        return None
    print(f"operator's page: {page.url}", file=sys.stderr)
    return page


def with_page(recorder: Recorder, page: OperatorPage | None) -> Recorder:
    return recorder if page is None else ShowingRecorder(recorder, page)

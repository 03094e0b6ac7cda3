"""The operator page, and the `--page` option, which sets its address."""

import argparse

from truearc.errors import InputError

HOST = "127.0.0.1"
PORT = 5808                           # a competition's network lets 5800 to 5810 through; 5810 is taken
OFF = "off"


def add_page_argument(parser: argparse.ArgumentParser, default: str, note: str = "") -> None:
    parser.add_argument("--page", metavar="[HOST:]PORT", nargs="?", default=default, const=str(PORT),
                        help=f"the operator's page{note}; host 0.0.0.0 lets other machines look, 'off' serves none "
                             f"(default: {default}; without a value: {PORT})")


def parse_page(text: str) -> tuple[str, int] | None:
    """Return (host, port) of --page; None for off; InputError for anything but an address."""
    if text == OFF:
        return None
    host, _, port = text.rpartition(":")
    if not port.isdecimal() or int(port) > 65535:
        raise InputError(f"--page {text}: a port from 0 to 65535, HOST:PORT, or 'off'")
    return host.removeprefix("[").removesuffix("]") or HOST, int(port)

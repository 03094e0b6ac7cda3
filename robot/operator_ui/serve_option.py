"""The operator's page that `--page` asks for, opened."""

import sys

from truearc.hw.protocols import Clock
from truearc.robot.config.schema import Config
from truearc.robot.operator_ui.page_option import parse_page
from truearc.robot.operator_ui.server import OperatorPage, ShowingRecorder
from truearc.robot.runtime import Recorder


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

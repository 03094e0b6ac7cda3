"""axe-core in every page: no serious or critical violation by day and by night; no page asks another host."""

import json
from collections.abc import Callable, Iterator
from functools import cache
from importlib.resources import files
from pathlib import Path
from typing import Any
from unittest.mock import Mock

import cv2
import numpy as np
import pytest

from tests.robot.operator_ui.browser import BROWSER, Browser, Shower
from tests.robot.operator_ui.test_browser import CONFIG, GOOD, MANY
from tests.robot.operator_ui.test_what_if import GATE
from tests.sim.discover.made import stand_in
from tests.sim.systems.test_systems import frame, runs_of, spring
from tests.waiting import serving
from truearc.cli.common import load_camera
from truearc.cli.vision_tuner import Recorded, Tuner, TuneServer, find_pictures
from truearc.hw.real.clock import MonotonicClock
from truearc.robot.operator_ui.server import OperatorPage, PageServer
from truearc.robot.operator_ui.what_if import LAPTOP_RATE_PER_S, WhatIf
from truearc.robot.types import Sighting

pytest.importorskip("axe_core_python")
pytestmark = [pytest.mark.browser, pytest.mark.slow, pytest.mark.skipif(BROWSER is None, reason="needs chromium")]
AXE = (files("axe_core_python") / "axe.min.js").read_text(encoding="utf-8")
RUN = """axe.run().then(found => JSON.stringify(found.violations
    .filter(one => ["serious", "critical"].includes(one.impact))
    .map(one => [one.id, ...one.nodes.slice(0, 3).map(node => node.html.slice(0, 160) + node.failureSummary)])))"""
ASKED = "performance.getEntriesByType('resource').map(one => one.name)"
EXAMPLES = Path(__file__).parents[3] / "examples"


@pytest.fixture(scope="module")
def browser(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Browser]:
    browser = Browser(tmp_path_factory.mktemp("profile"))
    yield browser
    browser.close()


def check(browser: Browser, url: str, ready: str = "true", prepare: str = "") -> None:
    """The page at both widths and by both settings of the reader."""
    for scheme in ("light", "dark"):
        for width, height in ((1280, 900), (390, 844)):
            browser.size(width, height)
            browser._ask("Emulation.setEmulatedMedia", features=[{"name": "prefers-color-scheme", "value": scheme}])
            browser.open(url)
            browser.wait(f"document.readyState === 'complete' && {ready}")
            browser.evaluate(prepare)
            browser.evaluate(AXE)
            assert json.loads(browser.evaluate(RUN)) == [], (scheme, width)
            assert browser.evaluate("document.documentElement.scrollWidth") <= width
            own = url.split("/", 3)[2]
            assert [one for one in browser.evaluate(ASKED) if own not in one and not one.startswith("blob:")] == []


def offline(make: Callable[[Path], Any]) -> Callable[[Browser, Path], None]:
    def run(browser: Browser, folder: Path) -> None:
        page = folder / "index.html"
        made = make(page)
        if isinstance(made, str):
            page.write_text(made, encoding="utf-8")
        check(browser, page.as_uri(), prepare="document.querySelectorAll('details').forEach(one => one.open = true)")

    return run


@cache
def found() -> Any:
    import truearc as ta
    return ta.discover(ta.load_dataset(EXAMPLES / "spreadsheet"), seed=0)


def finding(page: Path) -> None:
    found().to_html(page, truth={"wheel_slip": 0.0165})


def demo(page: Path) -> None:
    from truearc.cli import demo_acts as acting
    from truearc.sim.report import NO_ORIGIN
    act = stand_in(acting.Act, shots=found().investigation.dataset, finding=found(),
                   volleys=(acting.Volley(1, 9, 12), acting.Volley(4, 8, 12)))
    acts = dict.fromkeys(("practice", "event", "control"), act)
    acting.save_page(page.parent, acts, acting.draw_effect(3), NO_ORIGIN)


def system(page: Path) -> None:
    import truearc as ta
    ta.discover(spring(), runs_of(frame(5, push=lambda x, v: -0.3 * float(np.sign(v)))), seed=0).to_html(page)


def flights(page: Path) -> str:
    """To accept or reject, one of each."""
    from truearc.sim.video.write import make_choice
    one = Mock(flights=(..., ...), line=lambda number: f"clip flight {number + 1}: 31 positions, residual 0.42 px")
    one.clip.name = "clip"
    for number in (1, 2):
        cv2.imwrite(str(page.parent / f"clip-00{number}.jpg"), np.full((90, 160, 3), 90, np.uint8))
    return make_choice([one], ["clip-002"])


def guide(page: Path) -> str:
    from truearc.sim.video.guide import make_guide
    return make_guide(0.15)


def season(page: Path) -> None:
    import truearc as ta
    ta.identifiability(ta.load_rig(EXAMPLES / "spreadsheet" / "rig.toml"), shots=40).to_html(page)


def gains(page: Path) -> str:
    from truearc.sim.report import draw_reliability, make_page, paragraph, picture, table
    p = np.random.default_rng(0).uniform(size=(200, 2))
    return make_page("gains", "Paste these gains. They hold.", [
        ("Gains", "<pre>ks_v = 1</pre>" + picture(draw_reliability(p, np.arange(200) % 3), "reliability", "A caption.")
         + table(("a", "b"), [("x", 1.0), ("y", None)]) + paragraph("A note.", dim=True))])


def test_the_check_finds_text_that_is_hard_to_read(browser: Browser, tmp_path: Path) -> None:
    page = tmp_path / "pale.html"
    page.write_text('<!doctype html><html lang="en"><title>t</title><p style="color: #bbb; background: #fff">pale',
                    encoding="utf-8")
    with pytest.raises(AssertionError, match="color-contrast"):
        check(browser, page.as_uri())


@pytest.mark.parametrize("make", [finding, demo, system, flights, guide, season, gains], ids=lambda make: make.__name__)
def test_reports_have_no_serious_violation(browser: Browser, make: Callable[[Path], Any], tmp_path: Path) -> None:
    offline(make)(browser, tmp_path)


def test_the_page_of_serve_has_no_serious_violation(browser: Browser) -> None:
    with serving(PageServer("127.0.0.1", 0, None, WhatIf(GATE, 0.3, 594.0, MonotonicClock(), LAPTOP_RATE_PER_S,
                                                       "gate.onnx"))) as server:
        check(browser, server.url, "typeof whatIf !== 'undefined' && whatIf.state().isSettled")


def test_the_tuner_s_page_has_no_serious_violation(browser: Browser, tmp_path: Path) -> None:
    image = np.zeros((480, 640, 3), np.uint8)
    cv2.rectangle(image, (250, 150), (400, 230), (80, 255, 80), 3)
    cv2.imwrite(str(tmp_path / "a.png"), image)
    tuner = Tuner(load_camera(None), Recorded(find_pictures([str(tmp_path)])), tmp_path / "tuned.toml")
    with serving(TuneServer(tuner, "127.0.0.1", 0)) as server:
        check(browser, server.url, "document.querySelectorAll('input[type=range]').length > 0")


@pytest.mark.parametrize("tick", [GOOD, MANY], ids=["fire", "hold"])
def test_the_operator_page_has_no_serious_violation(browser: Browser, tick: Any) -> None:
    page = OperatorPage(CONFIG, "monday", "127.0.0.1", 0, MonotonicClock())
    page.see(lambda: (Sighting(1, True, None, 3.0, corners_px=((9, 9), (40, 9), (40, 30), (9, 30))),
                      np.zeros((120, 160, 3), np.uint8)))
    shower = Shower(page)
    try:
        shower.tick = tick
        check(browser, page.url, "document.title !== 'STALE'", "document.getElementById('eye').open = true")
    finally:
        shower.close()
        page.close()

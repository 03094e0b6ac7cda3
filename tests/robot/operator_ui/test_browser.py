"""The page in a browser: FIRE, HOLD, and STALE as soon as the robot sends no more events."""


import cv2
import numpy as np
import pytest
from msgspec.structs import replace

from tests.robot.good_tick import CONFIG, NOW_NS, good_inputs, good_memory, seconds
from tests.robot.operator_ui.browser import BROWSER, Browser, Shower
from truearc.hw.fault_codes import CAN_ADAPTER_ERROR
from truearc.hw.real.clock import MonotonicClock
from truearc.robot.operator_ui.server import OperatorPage
from truearc.robot.reasons import BOX_SILENT, CAN_LOST, IMAGE_DARK
from truearc.robot.tick import step
from truearc.robot.types import Sighting

pytestmark = [pytest.mark.browser, pytest.mark.slow, pytest.mark.skipif(BROWSER is None, reason="needs chromium")]

GOOD = step(good_inputs(), good_memory(), CONFIG, None)
GONE = CAN_LOST(cause=CAN_ADAPTER_ERROR(bus="CAN slcan /dev/ttyACM0", detail="gone"))
LOST = step(replace(good_inputs(), faults=(GONE,), sighting=Sighting(NOW_NS, False, IMAGE_DARK())),
            replace(good_memory(), last_sighting=replace(GOOD.memory.last_sighting, t_ns=NOW_NS - seconds(2.1))),
            CONFIG, None)
MANY = step(replace(good_inputs(), faults=(GONE, BOX_SILENT()), sighting=Sighting(NOW_NS, False, IMAGE_DARK())),
            replace(LOST.memory, armed=False), CONFIG, None)
WORD = "document.getElementById('word').innerText"
STALE_OPACITY = "getComputedStyle(document.getElementById('stale')).opacity"
SIZES = ((1280, 800), (390, 844), (400, 200))


@pytest.fixture(scope="module")
def page():
    page = OperatorPage(CONFIG, "monday", "127.0.0.1", 0, MonotonicClock())
    yield page
    page.close()


@pytest.fixture(scope="module")
def shower(page):
    shower = Shower(page)
    yield shower
    shower.close()


@pytest.fixture(scope="module")
def browser(page, tmp_path_factory):
    browser = Browser(tmp_path_factory.mktemp("profile"))
    browser.size(1280, 800)
    browser.open(page.url)
    yield browser
    browser.close()


def test_fire_hold_and_stale(browser, shower):
    browser.wait("document.title === 'STALE'")                  # nothing has been shown yet
    shower.tick = GOOD
    browser.wait("document.title === 'FIRE'")
    assert browser.evaluate(WORD) == "FIRE" and browser.evaluate(STALE_OPACITY) == "0"
    assert browser.evaluate("document.querySelectorAll('#told li').length") == 0
    shower.tick = LOST
    browser.wait("document.title === 'HOLD'")
    assert browser.evaluate("document.body.classList.contains('fault')")
    messages = "[...document.querySelectorAll('#told li b')].map(one => one.innerText)"
    assert browser.evaluate(messages) == [
        "CAN adapter pulled out?", "Wheels, hood released: CAN lost: CAN slcan /dev/ttyACM0: gone",
        "Target out of sight for 2.1 s"]
    assert browser.evaluate("document.getElementById('lead').innerText") == "CAN adapter pulled out?"
    assert "5.00 ± 0.03 m" in browser.evaluate("document.getElementById('blocks').innerText")
    shower.tick = None
    browser.wait("document.title === 'STALE'")
    assert browser.evaluate(STALE_OPACITY) == "1" and "HOLD" in browser.evaluate(
        "document.getElementById('stale').innerText")


def test_fire_does_not_outlive_the_robot_s_word_by_more_than_half_a_second(browser, shower):
    """Timed by the page itself, from the last event to STALE."""
    shower.tick = GOOD
    browser.wait("document.title === 'FIRE'")
    browser.evaluate("""window.heard = 0; window.staleAt = 0;
        source.addEventListener("message", () => { heard = performance.now(); staleAt = 0; });
        new MutationObserver(() => { if (document.title === "STALE") staleAt ||= performance.now(); })
            .observe(document.querySelector("title"), {childList: true});""")
    browser.wait("heard > 0")
    shower.tick = None
    took_ms = browser.wait("document.title === 'STALE' && staleAt && staleAt - heard")
    assert 400 < took_ms < 1500                                  # 500, on a machine that may be busy


def test_stale_comes_even_when_the_page_s_script_hangs(browser, shower):
    """The green leaves the screen itself, and comes back with the script."""
    shower.tick = GOOD
    browser.wait("document.title === 'FIRE'")
    with browser.filmed():
        browser.wait_for_frame(is_green)
        browser.evaluate("setTimeout(() => { for (;;); }); 1")
        browser.wait_for_frame(lambda frame: not is_green(frame))
        browser.interrupt()
    browser.wait("document.title === 'FIRE'")


def is_green(png):
    blue, green, red = cv2.imdecode(np.frombuffer(png, np.uint8), cv2.IMREAD_COLOR)[40, 40].astype(int)
    return green > blue + 40 and green > red + 40


def test_news_that_was_long_on_its_way_is_no_news(browser, shower):
    shower.tick = None
    browser.wait("document.title === 'STALE'")
    view = """{seq: 1, t_robot_s: 1, state: "FIRE", tone: "fire", told: [], blocks: []}"""
    browser.evaluate(f"connect(); take({{t_sent_s: performance.now() / 1000, view: {view}}});")
    assert browser.evaluate("document.title") == "FIRE"
    browser.evaluate(f"take({{t_sent_s: performance.now() / 1000 - 0.7, view: {view}}});")
    assert browser.evaluate("document.title") == "STALE" and "old" in browser.evaluate(
        "document.getElementById('why').innerText")


def test_a_tab_that_slept_claims_nothing(browser, shower):
    shower.tick = GOOD
    browser.wait("document.title === 'FIRE'")
    assert browser.evaluate("document.onvisibilitychange(), document.title") == "STALE"
    browser.wait("document.title === 'FIRE'")


@pytest.mark.parametrize(("width", "height"), SIZES)
def test_it_fits_the_screen(browser, shower, width, height):
    """Nothing sticks out at the side, and the word can be read whole inside its tile."""
    browser.size(width, height)
    shower.tick = LOST
    browser.wait("document.title === 'HOLD'")
    assert browser.evaluate("document.documentElement.scrollWidth") <= width
    assert browser.evaluate("""(() => { const word = document.getElementById("word"), range = document.createRange();
        range.selectNodeContents(word);
        const text = range.getBoundingClientRect(), tile = document.getElementById("tile").getBoundingClientRect();
        return text.width > 60 && text.left >= tile.left && text.right <= tile.right
            && text.bottom <= innerHeight; })()""")
    first = "document.querySelector('#told li b').getBoundingClientRect()"
    assert browser.evaluate(f"{first}.bottom <= innerHeight && {first}.right <= innerWidth")


@pytest.mark.parametrize(("width", "height"), [(1920, 1080), (1280, 800), (390, 844)])
def test_reasons_are_readable_from_2_m(browser, shower, width, height):
    """Four reasons, the first larger than the others, which have 32 px or more; all in sight, where there is room with
    what to do."""
    browser.size(width, height)
    shower.tick = MANY
    browser.wait("document.title === 'HOLD'")
    browser.wait("document.querySelectorAll('#told li b').length === 4")
    first, *others = browser.evaluate("""[...document.querySelectorAll("#told li b")]
        .map(one => parseFloat(getComputedStyle(one).fontSize))""")
    last = "#told li span" if height > 1000 else "#told li b"
    bottom = browser.evaluate(f"[...document.querySelectorAll('{last}')].pop().getBoundingClientRect().bottom")
    assert first > max(others) and min(others) >= 32
    assert bottom <= browser.evaluate("document.getElementById('told').getBoundingClientRect().bottom")

"""The map and the sliders in a browser: they agree with the robot's gate, fit the screen, and say what is wrong."""

import json

import numpy as np
import pytest
from msgspec.structs import replace

from tests.robot.good_tick import CONFIG, good_inputs, good_memory
from tests.robot.operator_ui.browser import BROWSER, Browser, Shower
from tests.robot.operator_ui.test_what_if import GATE
from tests.waiting import serving
from truearc.hw.real.clock import MonotonicClock
from truearc.robot.operator_ui.server import OperatorPage, PageServer
from truearc.robot.operator_ui.what_if import LAPTOP_RATE_PER_S, WhatIf
from truearc.robot.tick import step
from truearc.robot.verdict import doubt_rating

pytestmark = [pytest.mark.browser, pytest.mark.slow, pytest.mark.skipif(BROWSER is None, reason="needs chromium")]

THRESHOLD, FREE_SPEED_RAD_S, CONFIGURATIONS = 0.3, 594.0, 300
# asks as a moved slider does, and waits until point and map are answered
SET = """async (row, plane) => { whatIf.set(row, plane);
    while (!whatIf.state().isSettled) await new Promise(done => setTimeout(done, 2)); return whatIf.state(); }"""
# pixels of the colour of the robot's dot: on the map and in the legend, or, without a robot, in the legend alone
PINK = """(chart => { const {data} = chart.getContext("2d").getImageData(0, 0, chart.width, chart.height);
    let count = 0; for (let k = 0; k < data.length; k += 4) count += data[k] > 240 && data[k + 1] === 95;
    return count; })(document.getElementById("chart"))"""
TEXT = "document.getElementById('{}').innerText"


@pytest.fixture(scope="module")
def server():
    what_if = WhatIf(GATE, THRESHOLD, FREE_SPEED_RAD_S, MonotonicClock(), LAPTOP_RATE_PER_S)
    with serving(PageServer("127.0.0.1", 0, None, what_if)) as server:
        yield server


@pytest.fixture(scope="module")
def browser(tmp_path_factory):
    browser = Browser(tmp_path_factory.mktemp("profile"))
    browser.size(1200, 800)
    yield browser
    browser.close()


@pytest.fixture
def laptop(browser, server):
    """The page of `truearc serve`, its map drawn."""
    browser.open(server.url)
    browser.wait("typeof whatIf !== 'undefined' && whatIf.state().isSettled")
    return browser


def set_sliders(browser, row, plane):
    return json.loads(browser.evaluate(f"({SET})({json.dumps(list(row))}, {plane}).then(JSON.stringify)"))


def agrees(said, row):
    rating = GATE.rate(*row)
    wanted = {"p_two": rating.p_two, "p_three": rating.p_three, "novelty": rating.novelty}
    assert said == pytest.approx(wanted, rel=0.0, abs=1e-6)
    return [reason.code for reason in doubt_rating(rating, THRESHOLD)]


def columns(answer, k):
    return {name: answer[name][k] for name in ("p_two", "p_three", "novelty")}


@pytest.mark.parametrize(("plane", "row"), [(1, (3.2, 0.48, 50.0)), (2, (3.2, 0.48, 50.0))])
def test_every_cell_of_the_map_agrees_with_the_gate(laptop, plane, row):
    state = set_sliders(laptop, row, plane)
    answered, (xs, ys) = state["map"], state["map"]["axes"]
    assert answered["third"] == row[3 - plane] and len(xs) * len(ys) == len(answered["verdict"]) > 2000
    inside = 0
    for k, (x, y) in enumerate((x, y) for x in xs for y in ys):
        asked = (x, y, row[2]) if plane == 1 else (x, row[1], y)
        codes = agrees(columns(answered, k), asked)
        assert answered["reasons"][k] == codes
        inside += "model_outside_domain" not in codes
    assert 100 < inside < len(xs) * len(ys)


def pixel(browser, x_share, y_share):
    """RGB of the map's pixel at a share of its width and height."""
    return browser.evaluate(f"""(() => {{ const chart = document.getElementById("chart"), pen = chart.getContext("2d");
        return [...pen.getImageData({x_share} * chart.width, {y_share} * chart.height, 1, 1).data]; }})()""")[:3]


def test_map_is_painted_as_the_gate_rates_and_unknown_is_hatched(laptop):
    """The middle of the likeliest cell is on the ramp's bright half; a far corner has the hatching's grey."""
    state = set_sliders(laptop, (7.0, 0.4, 50.0), 1)
    p = np.array(state["map"]["p_three"]).reshape(64, 48)
    known = np.array(["model_outside_domain" not in codes for codes in state["map"]["reasons"]]).reshape(64, 48)
    i, j = np.unravel_index(np.where(known, p, -1.0).argmax(), p.shape)
    width, height = laptop.evaluate("(c => [c.clientWidth, c.clientHeight])(document.getElementById('chart'))")
    across, up = 52 + (i + 0.5) / 64 * (width - 64), (height - 104) - (j + 0.5) / 48 * (height - 114)
    red, green, blue = pixel(laptop, across / width, up / height)
    assert p[i, j] > 0.5 and green > red + 40 and green > blue
    assert not known[0, -1]
    corner = pixel(laptop, 60 / width, 20 / height)
    assert max(corner) - min(corner) < 30 and max(corner) < 120


def test_numbers_stand_beside_the_sliders(laptop):
    set_sliders(laptop, (3.2, 0.5, 50.0), 1)
    sliders = laptop.evaluate(TEXT.format("sliders"))
    assert "3.20 m" in sliders and "0.500 = 2836 rpm" in sliders and "50.0°" in sliders
    rating = GATE.rate(3.2, 0.5, 50.0)
    assert f"{100 * rating.p_three:.1f} %" in laptop.evaluate(TEXT.format("numbers"))
    assert "would hold" in laptop.evaluate(TEXT.format("verdict"))
    assert "At hood 50.0°" in laptop.evaluate(TEXT.format("slice"))


def test_slider_and_map_are_inputs(laptop):
    """A slider that is moved and a tap on the map set what is asked."""
    set_sliders(laptop, (3.2, 0.5, 50.0), 1)
    laptop.evaluate("""(slider => { slider.value = 45.5; slider.dispatchEvent(new Event("input")); })(
        document.querySelectorAll("#sliders input[type=range]")[2])""")
    laptop.wait("whatIf.state().answer.at[2] === 45.5 && whatIf.state().isSettled")
    laptop.evaluate("""(chart => { const {left, top} = chart.getBoundingClientRect();
        chart.dispatchEvent(new PointerEvent("pointerdown", {clientX: left + 52, clientY: top + 10, buttons: 1})); })(
        document.getElementById("chart"))""")
    at = laptop.wait("whatIf.state().answer.at[0] < 2 && whatIf.state().answer.at")
    (low, high), (_, top) = (np.array(GATE.domain[k]) for k in (0, 1))
    assert at[0] == pytest.approx(low - 0.1 * (high - low), abs=0.02)
    assert at[1] == pytest.approx(top + 0.1 * (top - GATE.domain[1][0]), abs=0.01) and at[2] == 45.5


@pytest.mark.parametrize(("width", "height"), [(1200, 800), (360, 740)])
def test_it_fits_the_screen(laptop, width, height):
    laptop.size(width, height)
    laptop.wait(f"document.getElementById('chart').clientWidth > {0.7 * width if width < 700 else 400}")
    assert laptop.evaluate("document.documentElement.scrollWidth") <= width
    sizes = laptop.evaluate("""[...document.querySelectorAll("#ask :is(label, p, dd, button, b)")]
        .map(one => parseFloat(getComputedStyle(one).fontSize))""")
    assert len(sizes) > 8 and min(sizes) >= 13
    laptop.size(1200, 800)


def test_refusal_is_shown_and_dims_the_earlier_answer(laptop):
    laptop.evaluate("whatIf.set([25, .5, 40], 1); 1")
    laptop.wait("document.getElementById('trouble').innerText.includes('distance_m: got 25')")
    laptop.wait("getComputedStyle(document.getElementById('answer')).opacity === '0.35'")
    laptop.evaluate("whatIf.set([3, .5, 40], 1); 1")
    laptop.wait("document.getElementById('trouble').innerText === ''")


def test_robots_point_is_followed_until_a_slider_is_moved(browser):
    """And the part asks nothing while it is closed, which it is at first."""
    asked = []
    what_if = WhatIf(GATE, THRESHOLD, FREE_SPEED_RAD_S, MonotonicClock())
    answer = what_if.answer
    what_if.answer = lambda body: (asked.append(body), answer(body))[1]
    page = OperatorPage(CONFIG, "monday", "127.0.0.1", 0, MonotonicClock(), what_if)
    shower = Shower(page)
    try:
        shower.tick = step(good_inputs(), good_memory(), CONFIG, None)
        belief = shower.tick.estimate
        browser.open(page.url)
        browser.wait("document.title === 'FIRE'")
        assert not asked
        browser.evaluate("document.getElementById('what-if').open = true; 1")
        robot = browser.wait("whatIf.state().isSettled && whatIf.state().robot")
        assert robot == [belief.distance_m, belief.motor_ratio, belief.hood_deg]
        assert robot == browser.evaluate("whatIf.state().answer.at")
        set_sliders(browser, (3.2, 0.5, 50.0), 1)
        assert browser.evaluate("!whatIf.state().follow && whatIf.state().robot[0]") == belief.distance_m
        both = browser.evaluate(PINK)
        assert both > 100
        shower.tick = replace(shower.tick, estimate=replace(belief, distance_m=2.0))
        browser.wait("whatIf.state().robot[0] === 2 && whatIf.state().at[0] === 3.2")
        assert browser.evaluate("document.title") == "FIRE"          # what is asked is not what the robot does
        shower.tick = None
        browser.wait("document.title === 'STALE' && whatIf.state().robot === null")
        browser.wait(f"{PINK} < {0.6 * both}")
    finally:
        shower.close()
        page.close()

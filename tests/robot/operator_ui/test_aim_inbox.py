"""Aim files over HTTP and on the page: taken from who has the token, accepted by a click, everything else refused."""

import json

import pytest
from msgspec.structs import replace

from tests.robot.aim_files import sealed
from tests.robot.good_tick import CONFIG, good_inputs, good_memory
from tests.robot.operator_ui.browser import BROWSER, Browser, Shower
from tests.waiting import ask
from truearc.hw.real.clock import MonotonicClock
from truearc.robot.operator_ui.aim_inbox import MAX_AIM_BYTES, AimInbox, AimOrders
from truearc.robot.operator_ui.server import OperatorPage
from truearc.robot.tick import step


@pytest.fixture
def inbox(tmp_path):
    return tmp_path / "in"


@pytest.fixture
def page(inbox):
    page = OperatorPage(CONFIG, "monday", "127.0.0.1", 0, MonotonicClock(), orders=AimOrders(inbox, CONFIG))
    yield page
    page.close()


def token_of(inbox):
    return (inbox / "token").read_text(encoding="ascii").strip()


def send(page, method, path, body, **headers):
    """(status, what is said)."""
    headers = {name.replace("_", "-"): value for name, value in headers.items()}
    status, _, said = ask(page._server.server_port, path, method, body, {"Content-Type": "application/json", **headers})
    return status, json.loads(said)


def test_a_file_is_sent_offered_and_accepted(page, inbox, tmp_path):
    bearer = {"Authorization": f"Bearer {token_of(inbox)}"}
    assert send(page, "PUT", "/aim", sealed(), **bearer)[0] == 201
    box = AimInbox(inbox, CONFIG, tmp_path, {})
    box.look()
    accept = json.dumps({"sha256": box.offer.sha256}).encode()
    assert send(page, "POST", "/accept", accept, **bearer)[0] == 202
    box.look()
    assert box.accepted == box.offer.sha256


@pytest.mark.parametrize(("method", "path", "body", "headers", "status"), [
    *((method, path, body, {"Authorization": token} if token else {}, 401)
      for method, path, body in (("PUT", "/aim", sealed()), ("POST", "/accept", b'{"sha256":"a"}'))
      for token in ("", "Bearer ", "Bearer x", "Basic abc", "Bearer \xe4")),
    ("PUT", "/aim", b" " * (MAX_AIM_BYTES + 1), {}, 413), ("POST", "/accept", b" " * 4097, {}, 413),
    ("POST", "/aim", b"{}", {}, 405), ("PUT", "/accept", b"{}", {}, 405), ("DELETE", "/aim", b"", {}, 405),
    ("PUT", "/aim", b"{}", {"Content_Type": "text/plain"}, 415),
    ("PUT", "/aim", sealed(), {"Origin": "http://elsewhere.example"}, 403),
    ("PUT", "/aim", sealed(), {"Host": "elsewhere.example"}, 403)])
def test_strangers_and_what_is_out_of_form_are_refused(page, inbox, method, path, body, headers, status):
    assert send(page, method, path, body, **headers)[0] == status
    assert [one.name for one in inbox.iterdir()] == ["token"]


def test_a_page_without_an_inbox_takes_nothing():
    page = OperatorPage(CONFIG, "monday", "127.0.0.1", 0, MonotonicClock())
    try:
        status, said = send(page, "PUT", "/aim", sealed())
        assert status == 404 and "--aim-inbox" in said["error"]
    finally:
        page.close()


@pytest.mark.browser
@pytest.mark.slow
@pytest.mark.skipif(BROWSER is None, reason="needs chromium")
def test_the_driver_accepts_on_the_page_and_only_while_disarmed(page, inbox, tmp_path):
    send(page, "PUT", "/aim", sealed(), Authorization=f"Bearer {token_of(inbox)}")
    box = AimInbox(inbox, CONFIG, tmp_path, {})
    box.look()
    armed = step(replace(good_inputs(), aim_offer=box.offer), good_memory(), CONFIG, None)
    disarmed = replace(armed, memory=replace(armed.memory, armed=False))
    browser, shower = Browser(tmp_path / "profile"), Shower(page)
    button = "document.querySelector('#offer button')"
    try:
        browser.size(390, 800)
        browser.open(page.url)
        shower.tick = replace(armed, inputs=replace(armed.inputs, aim_offer=box.offer))
        browser.wait("document.getElementById('offer').innerText.includes('New aim: wind')")
        assert browser.evaluate(f"{button}.disabled")
        shower.tick = disarmed
        browser.wait(f"!{button}.disabled")
        browser.evaluate("window.prompt = () => 'wrong'; 1")
        browser.evaluate(f"{button}.click(); 1")
        browser.wait("document.getElementById('offer').innerText.includes('token')")
        assert not (inbox / "accept").exists()
        browser.evaluate(f"window.prompt = () => {json.dumps(token_of(inbox))}; 1")
        browser.evaluate(f"{button}.click(); 1")
        browser.wait("document.getElementById('offer').innerText.includes('disarmed')")
        assert (inbox / "accept").read_text(encoding="ascii") == box.offer.sha256
        shower.tick = replace(disarmed, memory=replace(disarmed.memory, aim_sha256=box.offer.sha256))
        browser.wait("document.getElementById('offer').hidden")
    finally:
        shower.close()
        browser.close()

"""The page over HTTP: what it gives to whom, and that no browser can hold up the robot."""

import json
import socket
import sys
import time
from contextlib import ExitStack
from http.client import HTTPConnection

import cv2
import numpy as np
import pytest

import truearc.robot.operator_ui.server
from tests import waiting
from tests.robot.good_tick import CONFIG, good_inputs, good_memory
from tests.robot.operator_ui.browser import Shower
from truearc.hw.real.clock import MonotonicClock
from truearc.robot.operator_ui.aim_inbox import AimOrders
from truearc.robot.operator_ui.server import LOOKING, MAX_OF_ADDRESS, PERIOD_S, OperatorPage
from truearc.robot.tick import step
from truearc.robot.types import Memory, Sighting

GOOD = step(good_inputs(), good_memory(), CONFIG, None)
IDLE = step(good_inputs(), Memory(), CONFIG, None)


@pytest.fixture
def page():
    page = OperatorPage(CONFIG, "monday", "127.0.0.1", 0, MonotonicClock())
    yield page
    page.close()


@pytest.fixture
def shown(page):
    """The page, shown the same tick again and again by a thread."""
    shower = Shower(page)
    shower.tick = GOOD
    yield page
    shower.close()


def port(page):
    return int(page.url.rstrip("/").rpartition(":")[2])


def ask(page, path="/", method="GET", **headers):
    """(status, headers, body)"""
    return waiting.ask(port(page), path, method, None, headers, page._server.server_name)


class Events:
    """One browser's stream."""

    def __init__(self, page):
        self.line = HTTPConnection("127.0.0.1", port(page), timeout=20)
        self.line.request("GET", "/events")
        self.answer = self.line.getresponse()

    def next(self):
        while True:
            text = self.answer.readline()
            assert text, "the stream ended"
            if text.startswith(b"data: "):
                return json.loads(text[6:])

    def close(self):
        self.answer.close()
        self.line.close()


def test_the_page_loads_nothing_from_elsewhere_and_takes_no_orders(page, capfd):
    status, headers, body = ask(page)
    text = body.decode()
    assert status == 200 and headers["Content-Type"].startswith("text/html")
    assert "http:" not in text and "https:" not in text and "src=" not in text and "@import" not in text
    assert "default-src 'none'" in headers["Content-Security-Policy"] and "Access-Control-Allow-Origin" not in headers
    assert ask(page, "/else")[0] == 404
    for method in ("POST", "PUT", "DELETE", "OPTIONS"):
        assert ask(page, "/", method)[0] == 405
    with pytest.raises(OSError):
        OperatorPage(CONFIG, "monday", "127.0.0.1", port(page), MonotonicClock())
    assert ask(page, Host="[")[0] == ask(page, Origin="http://[")[0] == 403
    assert ask(page, "/[")[0] == 404 and ask(page, "/?token=%ff[")[0] == 200
    for method, status in (("GET", b"404"), ("POST", b"405")):
        with socket.create_connection(("127.0.0.1", port(page)), timeout=10) as line:
            line.sendall(method.encode() + b" http://[ HTTP/1.0\r\nHost: localhost\r\n\r\n")
            assert line.recv(12).endswith(status)
    assert capfd.readouterr().err == ""


@pytest.mark.parametrize(("host", "ours", "others"), [
    ("0.0.0.0", ["localhost", "10.1.2.3", "[fe80::1]"], ["robot.example", "localhost.example", "10.1.2.3.example"]),
    ("127.0.0.1", ["localhost:9000", "127.0.0.1"], ["robot.example"]),
    ("::1", ["[::1]", "localhost"], ["ip6.example"]),
    ("127.1", ["127.1", "127.0.0.1"], ["127.2"])])              # a name for --page that can be looked up everywhere
def test_get_is_answered_under_own_names_alone(host, ours, others):
    """As a POST is: a site whose name was made to point here learns nothing (DNS rebinding)."""
    page = OperatorPage(CONFIG, "monday", host, 0, MonotonicClock())
    machine = socket.gethostname()
    try:
        for name in (*ours, machine, machine.upper(), f"{machine.partition('.')[0]}.local"):
            whole = name if ":" in name.rpartition("]")[2] else f"{name}:{port(page)}"
            assert ask(page, Host=whole, Origin=f"http://{whole}")[0] == 200, name
            assert ask(page, Host=whole, Origin="http://robot.example")[0] == 403
        for path in ("/", "/events", "/gate"):
            assert {ask(page, path, Host=f"{name}:{port(page)}")[0] for name in others} == {403}
    finally:
        page.close()


def test_events_carry_the_newest_tick_twenty_times_a_second_at_most(shown):
    events = Events(shown)
    first, second = events.next(), events.next()
    assert events.answer.headers["Content-Type"] == "text/event-stream"
    assert second["view"]["seq"] > first["view"]["seq"] > 0 and second["t_sent_s"] > first["t_sent_s"]
    assert first["view"]["state"] == "FIRE" and first["view"]["t_robot_s"] == GOOD.inputs.t_ns * 1e-9
    events.close()
    events, began = Events(shown), time.monotonic()
    for _ in range(11):
        events.next()
    assert time.monotonic() - began > 10 * PERIOD_S * 0.9
    events.close()


def test_what_is_old_when_a_browser_comes_is_not_told(page):
    page.show(GOOD)
    events = Events(page)
    time.sleep(4 * PERIOD_S)
    page.show(IDLE)
    assert events.next()["view"]["state"] == "HOLD"
    events.close()


def test_camera_pictures_show_the_detection_five_times_a_second_at_most(page, monkeypatch):
    assert ask(page, "/picture")[0] == 404                  # no camera
    now_ns, asked = [0], []
    monkeypatch.setattr(page, "_clock", type("Set", (), {"now_ns": lambda self: now_ns[0]})())
    sighting = Sighting(1, True, None, 3.0, corners_px=((90.0, 70.0), (40.0, 70.0), (40.0, 30.0), (90.0, 30.0)))
    page.see(lambda: asked.append(1) or (sighting, np.zeros((120, 160, 3), np.uint8)))
    for number in range(10):
        now_ns[0] = number * 100_000_000
        status, headers, body = ask(page, "/picture")
        assert status == 200 and headers["Content-Type"] == "image/jpeg"
    assert len(asked) == 5
    drawn = cv2.imdecode(np.frombuffer(body, np.uint8), cv2.IMREAD_COLOR)
    assert drawn[50, 40, 1] > 100 and drawn[50, 90, 1] > 100 and drawn[50, 65].max() < 60      # the outline, not inside
    page.see(lambda: None)                                  # overwritten meanwhile: the last one stays
    now_ns[0] += 10**9
    assert ask(page, "/picture")[2] == body


def test_nobody_who_looks_and_does_not_listen_holds_up_who_shows(shown, monkeypatch):
    """A browser that never reads is dropped, and others are served meanwhile."""
    monkeypatch.setattr(truearc.robot.operator_ui.server, "PATIENCE_S", 0.3)
    deaf = socket.socket()
    deaf.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 2048)
    deaf.connect(("127.0.0.1", port(shown)))
    deaf.sendall(f"GET /events HTTP/1.0\r\nHost: 127.0.0.1:{port(shown)}\r\n\r\n".encode())
    events, until = Events(shown), time.monotonic() + 60
    while not has_hung_up(deaf):
        assert time.monotonic() < until
        events.next()
    deaf.close()
    events.close()


def has_hung_up(deaf):
    """Whether the server has hung up, found out without reading: behind unread data it does not show."""
    try:
        deaf.sendall(b"x")
    except OSError:
        return True
    return False


def test_only_so_many_may_look_and_one_that_goes_makes_room(shown):
    with ExitStack() as leaving:
        all_of_them = [Events(shown) for _ in range(LOOKING.of_address)]
        for events in all_of_them:
            leaving.callback(events.close)
            events.next()
        assert ask(shown, "/events")[0] == 503 and ask(shown)[0] == 200
        all_of_them[0].close()
        until = time.monotonic() + 20
        while (late := Events(shown)).answer.status == 503:
            late.close()
            assert time.monotonic() < until
            time.sleep(0.05)
        leaving.callback(late.close)
        assert late.next()["view"]["state"] == "FIRE"


def stream(page, address, token=""):
    """The answer to one browser at that address."""
    line = HTTPConnection("127.0.0.1", port(page), timeout=20, source_address=(address, 0))
    line.request("GET", f"/events?token={token}")
    return line.getresponse()


@pytest.mark.skipif(sys.platform == "darwin", reason="has only one loopback address")
@pytest.mark.parametrize("has_inbox", [True, False])
def test_the_last_place_is_for_who_has_the_token(tmp_path, has_inbox):
    """Whatever addresses the others have."""
    orders = AimOrders(tmp_path, CONFIG) if has_inbox else None
    page = OperatorPage(CONFIG, "monday", "127.0.0.1", 0, MonotonicClock(), orders=orders)
    token = (tmp_path / "token").read_text().strip() if has_inbox else page.token
    others = [stream(page, f"127.0.0.{10 + k}") for k in range(LOOKING.most - 1)]
    refused, late = stream(page, "127.0.0.99"), stream(page, "127.0.0.99", token)
    page.close()
    for answer in (*others, refused, late):
        answer.close()
    assert {answer.status for answer in others} == {200} and (refused.status, late.status) == (503, 200)


def test_who_has_the_page_s_own_token_has_a_place_beside_others_of_its_address(page):
    others = [stream(page, "127.0.0.1") for _ in range(LOOKING.most)]
    late = stream(page, "127.0.0.1", page.token)
    for answer in (*others, late):
        answer.close()
    assert [answer.status for answer in others].count(200) == LOOKING.of_address and late.status == 200


def test_one_connection_too_many_ends_the_oldest(page):
    with ExitStack() as leaving:
        lines = [leaving.enter_context(socket.create_connection(("127.0.0.1", port(page)), timeout=10))
                 for _ in range(MAX_OF_ADDRESS)]
        assert ask(page)[0] == 200
        assert lines[0].recv(1) == b""
        lines[-1].settimeout(0.2)
        with pytest.raises(TimeoutError):
            lines[-1].recv(1)


@pytest.mark.parametrize("sent", ["GET / HTTP/1.0\r\nX: ",
                                  "POST /predict HTTP/1.0\r\nHost: 127.0.0.1\r\nContent-Length: 999\r\n\r\n"])
def test_the_whole_request_has_one_time_limit(page, monkeypatch, sent):
    """However often a byte of it comes."""
    monkeypatch.setattr(truearc.robot.operator_ui.server, "REQUEST_NS", 600_000_000)
    with socket.create_connection(("127.0.0.1", port(page)), timeout=0.05) as line:
        line.sendall(sent.encode())
        began = time.monotonic()
        while not has_hung_up(line):
            assert time.monotonic() < began + 10
            time.sleep(0.05)
        assert time.monotonic() > began + 0.5


def test_closing_ends_every_stream():
    page = OperatorPage(CONFIG, "", "127.0.0.1", 0, MonotonicClock())
    events = Events(page)
    page.show(GOOD)
    assert events.next()["view"]["seq"] == 1
    page.close()
    assert b"data" not in events.answer.read()
    events.close()

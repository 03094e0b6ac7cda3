"""The page over HTTP: what it gives to whom, and that no browser can hold up the robot."""

import json
import socket
import threading
import time
from contextlib import ExitStack
from http.client import HTTPConnection

import pytest
from msgspec.structs import replace

import truearc.robot.operator_ui.serving
from tests.robot.good_tick import CONFIG, good_inputs, good_memory
from truearc.hw.real.clock import MonotonicClock
from truearc.robot.operator_ui.screens import ShowingRecorder
from truearc.robot.operator_ui.server import MOST_BROWSERS, PERIOD_S, OperatorPage
from truearc.robot.tick import step
from truearc.robot.types import Memory

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
    over = threading.Event()

    def show():
        while not over.wait(0.005):
            page.show(GOOD)

    thread = threading.Thread(target=show)
    thread.start()
    yield page
    over.set()
    thread.join()


def port(page):
    return int(page.url.rstrip("/").rpartition(":")[2])


def ask(page, path="/", method="GET", **headers):
    """(status, headers, body)"""
    line = HTTPConnection("127.0.0.1", port(page), timeout=20)
    line.request(method, path, None, headers)
    answer = line.getresponse()
    result = answer.status, answer.headers, answer.read()
    line.close()
    return result


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


def test_the_page_loads_nothing_from_elsewhere_and_takes_no_orders(page):
    status, headers, body = ask(page)
    text = body.decode()
    assert status == 200 and headers["Content-Type"].startswith("text/html")
    assert "http:" not in text and "https:" not in text and "src=" not in text and "@import" not in text
    assert "default-src 'none'" in headers["Content-Security-Policy"] and "Access-Control-Allow-Origin" not in headers
    assert ask(page, "/else")[0] == 404
    for method in ("POST", "PUT", "DELETE", "OPTIONS"):
        assert ask(page, "/", method)[0] == 405


@pytest.mark.parametrize("headers", [{"Host": "elsewhere.example"}, {"Host": "elsewhere.example:5808"}, {"Host": ""},
                                     {"Origin": "http://elsewhere.example"}])
@pytest.mark.parametrize("path", ["/", "/events"])
def test_other_sites_learn_nothing(page, headers, path):
    status, _, body = ask(page, path, **headers)
    assert status == 403 and page.url.encode() in body


def test_any_name_will_do_where_everybody_may_look():
    page = OperatorPage(CONFIG, "monday", "0.0.0.0", 0, MonotonicClock())
    try:
        assert ask(page, Host="robot.local:5808")[0] == 200 and "localhost" in page.url
    finally:
        page.close()


def test_a_port_that_is_taken_is_an_error(page):
    with pytest.raises(OSError):
        OperatorPage(CONFIG, "monday", "127.0.0.1", port(page), MonotonicClock())


def test_events_carry_the_newest_tick_with_its_number_and_time(shown):
    events = Events(shown)
    first, second = events.next(), events.next()
    assert events.answer.headers["Content-Type"] == "text/event-stream"
    assert second["view"]["seq"] > first["view"]["seq"] > 0 and second["t_sent_s"] > first["t_sent_s"]
    assert first["view"]["state"] == "FIRE" and first["view"]["t_robot_s"] == GOOD.inputs.t_ns * 1e-9
    events.close()


def test_twenty_a_second_at_most(shown):
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


def test_nobody_who_looks_and_does_not_listen_holds_up_who_shows(shown, monkeypatch):
    """A browser that never reads is dropped, and others are served meanwhile."""
    monkeypatch.setattr(truearc.robot.operator_ui.serving.LocalHandler, "timeout", 0.3)
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
        all_of_them = [Events(shown) for _ in range(MOST_BROWSERS)]
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


def test_more_connections_than_there_is_room_for_are_hung_up_on(page, monkeypatch):
    with ExitStack() as leaving:
        lines = []
        for _ in range(truearc.robot.operator_ui.serving.MOST_CONNECTIONS):
            lines.append(leaving.enter_context(socket.create_connection(("127.0.0.1", port(page)))))
        time.sleep(0.2)
        one_more = leaving.enter_context(socket.create_connection(("127.0.0.1", port(page)), timeout=10))
        assert one_more.recv(1) == b""


def test_showing_waits_for_nobody_even_with_browsers_looking(page):
    """Not a figure, an order of magnitude: a tick has 5000 us."""
    streams = [Events(page) for _ in range(4)]
    took = []
    for _ in range(2000):
        before = time.perf_counter()
        page.show(GOOD)
        took.append(time.perf_counter() - before)
    assert sorted(took)[len(took) // 2] < 100e-6
    for events in streams:
        events.close()


def test_closing_ends_every_stream():
    page = OperatorPage(CONFIG, "", "127.0.0.1", 0, MonotonicClock())
    events = Events(page)
    page.show(GOOD)
    assert events.next()["view"]["seq"] == 1
    page.close()
    assert b"data" not in events.answer.read()
    events.close()


class Kept:
    def __init__(self):
        self.kept = []

    def record(self, tick, sent):
        self.kept.append((tick, sent))

    def keep_picture(self, picture):
        self.kept.append(picture)


def test_a_recorder_records_and_shows(page):
    recorder = Kept()
    showing = ShowingRecorder(recorder, page)
    showing.record(replace(GOOD), None)
    showing.keep_picture("picture")
    assert recorder.kept == [(GOOD, None), "picture"] and page.newest()[0] == 1

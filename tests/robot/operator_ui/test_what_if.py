"""Questions to the gate, alone and as `POST /predict`: whom it answers, what it refuses and why, and how many."""

import gzip
import itertools
import json
import math
import os
import socket
import subprocess
import sys
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

import truearc.robot.operator_ui.server
import truearc.robot.operator_ui.what_if
from tests import waiting
from tests.robot.good_tick import CONFIG
from tests.waiting import SetClock, serving
from truearc.cli.gate import NICE, make_command
from truearc.hw.real.clock import MonotonicClock
from truearc.robot.gate import FEATURES, NO_RATING, load_gate
from truearc.robot.operator_ui import what_if as asking
from truearc.robot.operator_ui.server import DISCARD_BYTES, OperatorPage, PageServer, open_page
from truearc.robot.operator_ui.what_if import BURST, MAX_BODY_BYTES, QUESTION_COST, WhatIf, WhatIfProcess
from truearc.robot.verdict import doubt_rating

GOLDEN = Path(__file__).parents[2] / "golden" / "reference" / "export-physics" / "gate.onnx"
GATE = load_gate(GOLDEN)
GOOD = {"distance_m": 3.2, "motor_ratio": 0.5, "hood_deg": 50.0}
within = st.tuples(*(st.floats(feature.low, feature.high) for feature in FEATURES))
not_numbers = st.one_of(st.none(), st.booleans(), st.text(), st.dictionaries(st.text(), st.integers()), st.just([]),
                        st.lists(st.booleans(), min_size=1), st.just([[1.0]]), st.just(math.nan), st.just(math.inf),
                        st.just(-1e-9), st.floats(min_value=90.1), st.integers(min_value=10**300),
                        st.just([0.5, "0.5"]))


def what_if(threshold=0.3, gate=GATE):
    return asking.WhatIf(gate, threshold, 594.0, SetClock())


def answered(asked, body):
    """What is answered with status 200."""
    answer = asked.answer(body)
    assert answer.status == 200 and answer.retry_s == 0, answer
    return json.loads(gzip.decompress(answer.text) if answer.is_compressed else answer.text)


def refused(body):
    with pytest.raises(asking.QuestionError) as raised:
        asking.parse_question(body if isinstance(body, bytes) else json.dumps(body).encode())
    return raised.value


@given(within)
def test_question_has_the_numbers_that_were_sent(row):
    question = asking.parse_question(json.dumps(dict(zip(asking.NAMES, row, strict=True))).encode())
    assert question.is_single and [value for value, in question.values] == list(row)


@given(st.binary(max_size=200) | st.text(max_size=200).map(str.encode))
def test_any_bytes_are_a_question_or_refused_with_400(body):
    try:
        asking.parse_question(body)
    except asking.QuestionError as error:
        assert error.status == 400 and str(error)


@given(st.sampled_from(asking.NAMES), not_numbers)
def test_value_that_is_no_number_in_range_is_refused_by_its_key(key, value):
    error = refused({**GOOD, key: value})
    assert error.status == 400 and error.key == key and key in str(error)


@pytest.mark.parametrize(("body", "words"), [
    (b"", "not JSON"), (b"\xff", "not JSON"), (b"[" * 4000, "not JSON"), (b"[1,2,3]", "expected an object"),
    (b"null", "expected an object"), (b'{"distance_m":3,"hood_deg":40}', "motor_ratio"),
    (json.dumps({**GOOD, "extra": 1}).encode(), "extra"),
    (b'{"distance_m":1,"distance_m":2,"motor_ratio":0.5,"hood_deg":40}', "distance_m: given twice"),
    (b'{"distance_m":NaN,"motor_ratio":0.5,"hood_deg":40}', "distance_m: got NaN; expected a number from 0 to 20"),
    (b'{"distance_m":1e999,"motor_ratio":0.5,"hood_deg":40}', "distance_m: got Infinity")])
def test_malformed_question_is_refused_in_words(body, words):
    assert words in str(refused(body))


def test_too_many_combinations_are_refused():
    side = [0.5] * 64
    most = json.dumps({**GOOD, "distance_m": side, "motor_ratio": side}).encode()
    assert asking.parse_question(most).rows == asking.MAX_CONFIGURATIONS
    assert "expected at most 4096" in str(refused({**GOOD, "distance_m": [*side, 0.5], "motor_ratio": side}))


@given(st.lists(st.sampled_from([1.8, 3.2, 6.0, 15.0]), min_size=1), st.lists(st.floats(0, 1), min_size=1, max_size=3),
       st.floats(0.0, 1.0))
def test_lists_are_answered_in_order_as_the_gate_does(distances, ratios, threshold):
    said = answered(what_if(threshold), json.dumps({"distance_m": distances[:4], "motor_ratio": ratios,
                                                 "hood_deg": 50.0}).encode())
    for k, row in enumerate(itertools.product(distances[:4], ratios, [50.0])):
        rating, numbers = GATE.rate(*row), (said["p_two"][k], said["p_three"][k], said["novelty"][k])
        assert numbers == (rating.p_two, rating.p_three, rating.novelty)
        assert said["reasons"][k] == [reason.code for reason in doubt_rating(rating, threshold)]
        assert said["verdict"][k] == ("hold" if said["reasons"][k] else "fire")


def test_single_question_has_single_answers_and_facts_state_limits():
    said = answered(what_if(0.004), json.dumps(GOOD).encode())
    rating = GATE.rate(*GOOD.values())
    assert said == {"p_two": rating.p_two, "p_three": rating.p_three, "novelty": rating.novelty, "verdict": "fire",
                    "reasons": []}
    assert answered(what_if(1.0), json.dumps(GOOD).encode())["reasons"] == ["model_below_threshold"]
    far = answered(what_if(0.0), json.dumps({**GOOD, "distance_m": 20}).encode())
    assert far["verdict"] == "hold" and far["reasons"] == ["model_outside_domain"]
    facts = json.loads(what_if().facts().text)
    assert facts["hit_or_miss"] is False
    assert facts["sha256"] == GATE.sha256 and facts["threshold"] == 0.3 and facts["free_speed_rad_s"] == 594.0
    assert [(one["name"], one["domain"]) for one in facts["features"]] == [
        (name, list(domain)) for name, domain in zip(asking.NAMES, GATE.domain, strict=True)]


def test_gate_that_fails_or_has_no_number_holds():
    class Broken:
        def rate(self, *row):
            raise RuntimeError("onnxruntime")

    class Silent:
        def rate(self, *row):
            return NO_RATING

    for gate, code in ((Broken(), "model_failed"), (Silent(), "model_outside_domain")):
        said = answered(what_if(gate=gate), json.dumps(GOOD).encode())
        assert said == {"p_two": None, "p_three": None, "novelty": None, "verdict": "hold", "reasons": [code]}


def test_budget_is_spent_by_configurations_and_malformed_questions():
    asked, body, side = what_if(), json.dumps(GOOD).encode(), [0.5] * 64
    most = json.dumps({**GOOD, "distance_m": side, "motor_ratio": side}).encode()
    for _ in range(asking.BURST // (asking.QUESTION_COST + 1)):
        answered(asked, body)
    refusal = asked.answer(body)
    assert refusal.status == 429 and refusal.retry_s == 1 and b"too many" in refusal.text
    asked._clock.t_ns += 500_000_000
    refusal = asked.answer(most)
    assert refusal.status == 429 and refusal.retry_s == 2
    asked._clock.t_ns += 1_000_000_000 * (asking.MAX_CONFIGURATIONS + asking.QUESTION_COST) // asking.RATE_PER_S + 1
    assert len(answered(asked, most)["verdict"]) == asking.MAX_CONFIGURATIONS
    asked = what_if()
    statuses = [asked.answer(b"{").status for _ in range(asking.BURST // asking.QUESTION_COST + 1)]
    assert set(statuses[:-1]) == {400} and statuses[-1] == 429


JSON = {"Content-Type": "application/json"}


@pytest.fixture(params=["127.0.0.1"])
def server(request):
    what_if = WhatIf(GATE, CONFIG.gate.threshold, None, MonotonicClock())
    with serving(PageServer(request.param, 0, None, what_if)) as server:
        yield server


def ask(server, body, path="/predict", method="POST", headers=JSON):
    """(status, headers, JSON)"""
    status, answered, said = waiting.ask(server.server_port, path, method, body, headers)
    return status, answered, json.loads(said)


def test_answer_is_the_gates_and_compressed_where_it_is_long(server):
    status, headers, said = ask(server, json.dumps(GOOD))
    rating = GATE.rate(*GOOD.values())
    assert status == 200 and headers["Content-Type"] == "application/json" and headers["Cache-Control"] == "no-store"
    assert (said["p_two"], said["p_three"], said["novelty"]) == (rating.p_two, rating.p_three, rating.novelty)
    assert said["verdict"] == "hold" and said["reasons"] == ["model_below_threshold"]
    assert ask(server, json.dumps(GOOD), headers={"Content-Type": "application/json; charset=utf-8"})[0] == 200
    assert ask(server, json.dumps(GOOD).ljust(MAX_BODY_BYTES))[0] == 200
    asked = json.dumps({**GOOD, "distance_m": [2.0 + 0.01 * k for k in range(200)]})
    plain = ask(server, asked)[2]
    packed = JSON | {"Accept-Encoding": "gzip, deflate"}
    _, headers, body = waiting.ask(server.server_port, "/predict", "POST", asked, packed)
    assert headers["Content-Encoding"] == "gzip" and json.loads(gzip.decompress(body)) == plain
    assert len(body) < 0.6 * len(json.dumps(plain))


ASKED = json.dumps(GOOD)


@pytest.mark.parametrize(("method", "path", "body", "headers", "status", "words"), [
    ("POST", "/predict", "{", JSON, 400, "not JSON"), ("POST", "/predict", '{"\\ud800": 1}', JSON, 400, "\\ud800"),
    *(("POST", "/predict", ASKED.ljust(size), JSON, 413, str(MAX_BODY_BYTES)) for size in (
        MAX_BODY_BYTES + 1, DISCARD_BYTES - 1)),
    *((method, "/predict", None, JSON, 405, method) for method in ("GET", "PUT", "DELETE", "PATCH", "OPTIONS")),
    *(("POST", path, ASKED, JSON, 405, "") for path in ("/", "/gate", "/events", "/else")),
    *(("POST", "/predict", ASKED, {} if kind is None else {"Content-Type": kind}, 415, '"Content-Type"') for kind in (
        "text/plain", "application/x-www-form-urlencoded", "multipart/form-data", "", None)),
    *(("POST", "/predict", ASKED, JSON | {name: there}, 403, "another site") for name, there in (
        ("Host", "elsewhere.example"), ("Host", "elsewhere.example:5808"), ("Host", ""),
        ("Origin", "http://elsewhere.example"), ("Origin", "null")))])
@pytest.mark.parametrize("server", ["127.0.0.1", "0.0.0.0"], indirect=True)
def test_what_is_refused_has_its_status_and_says_why(server, method, path, body, headers, status, words):
    """On every address, too, where the page itself answers to any name."""
    found, answered, said = ask(server, body, path, method, headers)
    assert found == status and words in json.dumps(said) and "Access-Control-Allow-Origin" not in answered
    assert answered["Allow"] == (None if status != 405 else "POST" if path == "/predict" else "GET")


def test_too_many_questions_are_429_and_say_when_to_ask_again(server):
    for _ in range(BURST // QUESTION_COST + 200):
        status, headers, said = ask(server, json.dumps(GOOD))
        if status == 429:
            break
    assert status == 429 and headers["Retry-After"] == "1" and "too many" in said["error"]


def raw(server, text):
    """The first line of the answer to a request as it stands, and the connection's end."""
    here = f"Host: 127.0.0.1:{server.server_port}\r\nContent-Type: application/json"
    with socket.create_connection(("127.0.0.1", server.server_port), timeout=20) as line:
        line.sendall(text.replace("HERE", here).encode())
        return line.makefile("rb").readline().decode()


@pytest.mark.parametrize(("length", "status"), [
    ("", 411), ("Content-Length: x\r\n", 400), ("Content-Length: -1\r\n", 400),
    ("Content-Length: 9999999999\r\n", 400), ("Transfer-Encoding: chunked\r\n", 411)])
def test_length_must_be_stated(server, length, status):
    assert f" {status} " in raw(server, f"POST /predict HTTP/1.0\r\nHERE\r\n{length}\r\n{{}}")


def test_page_without_a_gate_says_so():
    page = OperatorPage(CONFIG, "", "127.0.0.1", 0, MonotonicClock())
    server = page._server
    try:
        assert ask(server, None, "/gate", "GET", {})[2] == {}
        status, _, said = ask(server, json.dumps(GOOD))
        assert status == 404 and "no gate" in said["error"]
    finally:
        page.close()


@pytest.fixture
def page(tmp_path):
    """The robot's page, whose gate is a file that is yet to come."""
    page = open_page("0", CONFIG, "monday", MonotonicClock(), make_command(tmp_path / "gate.onnx", CONFIG))
    yield page
    page.close()


def test_another_process_answers_as_the_configuration_states(page, tmp_path):
    (tmp_path / "gate.onnx").write_bytes(GOLDEN.read_bytes())
    facts = ask(page._server, None, "/gate", "GET", {})[2]
    assert facts["sha256"] == GATE.sha256 and facts["threshold"] == CONFIG.gate.threshold
    assert facts["free_speed_rad_s"] == CONFIG.rig.launcher.free_speed_rad_s
    status, _, said = ask(page._server, json.dumps({**GOOD, "distance_m": [3.2, 15.0]}))
    assert status == 200 and said["p_three"] == [GATE.rate(one, 0.5, 50.0).p_three for one in (3.2, 15.0)]
    assert ask(page._server, "{")[0] == 400 and ask(page._server, "")[0] == 400
    assert ask(page._server, json.dumps(GOOD))[2]["p_two"] == GATE.rate(*GOOD.values()).p_two


def test_process_that_ends_or_cannot_begin_is_503_and_starts_again(page, tmp_path, capfd):
    status, _, said = ask(page._server, json.dumps(GOOD))
    assert status == 503 and "does not answer" in said["error"] and "gate.onnx" in capfd.readouterr().err
    (tmp_path / "gate.onnx").write_bytes(GOLDEN.read_bytes())
    assert ask(page._server, json.dumps(GOOD))[0] == 200
    process = page._server.what_if._process
    process.kill()
    process.wait()
    assert ask(page._server, json.dumps(GOOD))[0] == 503
    assert ask(page._server, json.dumps(GOOD))[0] == 200


def test_process_that_hangs_is_given_up(monkeypatch):
    monkeypatch.setattr(truearc.robot.operator_ui.what_if, "PATIENCE_S", 0.5)
    what_if = WhatIfProcess((sys.executable, "-c", "import time; time.sleep(60)"))
    answer = what_if.answer(b"{}")
    assert answer.status == 503 and b"in time" in answer.text and what_if._process is None


def test_process_gives_way_and_ends_with_the_page(tmp_path):
    (tmp_path / "gate.onnx").write_bytes(GOLDEN.read_bytes())
    page = open_page("0", CONFIG, "monday", MonotonicClock(), make_command(tmp_path / "gate.onnx", CONFIG))
    assert ask(page._server, json.dumps(GOOD))[0] == 200
    process = page._server.what_if._process
    assert os.getpriority(os.PRIO_PROCESS, process.pid) == min(os.getpriority(os.PRIO_PROCESS, 0) + NICE, 19)
    page.close()
    assert process.returncode is not None
    orphan = subprocess.Popen(make_command(tmp_path / "gate.onnx", CONFIG), stdin=subprocess.PIPE)
    orphan.stdin.close()                          # as when the process behind it was killed
    assert orphan.wait(20.0) == 0

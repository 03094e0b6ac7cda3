"""Questions to the gate: which are refused and with what key, what is answered, and how many."""

import gzip
import itertools
import json
import math
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from truearc.robot.gate import FEATURES, NO_RATING, load_gate
from truearc.robot.operator_ui import what_if as asking
from truearc.robot.verdict import doubt_rating

GOLDEN = Path(__file__).parents[2] / "golden" / "reference" / "export-physics" / "gate.onnx"
GATE = load_gate(GOLDEN)
GOOD = {"distance_m": 3.2, "motor_ratio": 0.5, "hood_deg": 50.0}
within = st.tuples(*(st.floats(feature.low, feature.high) for feature in FEATURES))
not_numbers = st.one_of(st.none(), st.booleans(), st.text(), st.dictionaries(st.text(), st.integers()), st.just([]),
                        st.lists(st.booleans(), min_size=1), st.just([[1.0]]), st.just(math.nan), st.just(math.inf),
                        st.just(-1e-9), st.floats(min_value=90.1), st.integers(min_value=10**300),
                        st.just([0.5, "0.5"]))


class Stopped:
    """A clock that stands still until it is moved."""

    t_ns = 0

    def now_ns(self):
        return self.t_ns

    def sleep_until_ns(self, t_ns):
        raise AssertionError


def what_if(threshold=0.3, gate=GATE):
    return asking.WhatIf(gate, threshold, 594.0, Stopped())


def ask(asked, body):
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
    (b"null", "expected an object"),
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
    said = ask(what_if(threshold), json.dumps({"distance_m": distances[:4], "motor_ratio": ratios,
                                                 "hood_deg": 50.0}).encode())
    for k, row in enumerate(itertools.product(distances[:4], ratios, [50.0])):
        rating, numbers = GATE.rate(*row), (said["p_two"][k], said["p_three"][k], said["novelty"][k])
        assert numbers == (rating.p_two, rating.p_three, rating.novelty)
        assert said["reasons"][k] == [reason.code for reason in doubt_rating(rating, threshold)]
        assert said["verdict"][k] == ("hold" if said["reasons"][k] else "fire")


def test_single_question_has_single_answers_and_facts_state_limits():
    said = ask(what_if(0.004), json.dumps(GOOD).encode())
    rating = GATE.rate(*GOOD.values())
    assert said == {"p_two": rating.p_two, "p_three": rating.p_three, "novelty": rating.novelty, "verdict": "fire",
                    "reasons": []}
    assert ask(what_if(1.0), json.dumps(GOOD).encode())["reasons"] == ["model_below_threshold"]
    far = ask(what_if(0.0), json.dumps({**GOOD, "distance_m": 20}).encode())
    assert far["verdict"] == "hold" and far["reasons"] == ["model_outside_domain"]
    facts = json.loads(what_if().facts().text)
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
        said = ask(what_if(gate=gate), json.dumps(GOOD).encode())
        assert said == {"p_two": None, "p_three": None, "novelty": None, "verdict": "hold", "reasons": [code]}


def test_budget_is_spent_by_configurations_and_fills_with_time():
    asked, body, side = what_if(), json.dumps(GOOD).encode(), [0.5] * 64
    most = json.dumps({**GOOD, "distance_m": side, "motor_ratio": side}).encode()
    for _ in range(asking.BURST // (asking.QUESTION_COST + 1)):
        ask(asked, body)
    refusal = asked.answer(body)
    assert refusal.status == 429 and refusal.retry_s == 1 and b"too many" in refusal.text
    asked._clock.t_ns += 500_000_000
    refusal = asked.answer(most)
    assert refusal.status == 429 and refusal.retry_s == 2
    asked._clock.t_ns += 1_000_000_000 * (asking.MAX_CONFIGURATIONS + asking.QUESTION_COST) // asking.RATE_PER_S + 1
    assert len(ask(asked, most)["verdict"]) == asking.MAX_CONFIGURATIONS


def test_malformed_questions_cost_too():
    asked = what_if()
    statuses = [asked.answer(b"{").status for _ in range(asking.BURST // asking.QUESTION_COST + 1)]
    assert set(statuses[:-1]) == {400} and statuses[-1] == 429

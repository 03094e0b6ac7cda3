"""What-if queries to the gate about arbitrary configurations: their parsing, rate limits and answers.

Answers are computed as in the tick: they consist of Gate.rate for one configuration at a time, and the reasons why the
verdict would be HOLD. Queries and answers never reach the tick.

WhatIfProcess answers in a process of its own, so that neither the tick nor the recorder waits for the model. The
process's standard input is one end of a connection, over which it receives the text of a query, or None to request the
gate's facts (hash, limits, feature ranges), and sends an answer. The first query starts the process. It ends when the
connection closes, even if its parent has crashed.
"""

import contextlib
import gzip
import itertools
import json
import math
import subprocess
import threading
from multiprocessing.connection import Connection, Pipe
from typing import Any, NamedTuple, Protocol

from truearc.hw.protocols import NS_PER_S, Clock
from truearc.robot import reasons as because
from truearc.robot.gate import FEATURES, NO_RATING, NOVELTY_LIMIT, Gate
from truearc.robot.verdict import doubt_rating

MAX_BODY_BYTES = 4096
MAX_CONFIGURATIONS = 4096             # of one question
RATE_PER_S, LAPTOP_RATE_PER_S = 2048, 16384       # configurations of all questions together, beside a robot or alone
QUESTION_COST = 40                    # a question costs as many configurations besides: reading and answering it
BURST = 2 * RATE_PER_S + QUESTION_COST            # after a pause: the largest question
SMALL_BYTES = 4096                    # an answer that is longer is compressed
NAMES = tuple(feature.name for feature in FEATURES)
EXPECTED = f"expected {', '.join(NAMES)}"
GZIP = b"\x1f\x8b"                    # its first bytes; JSON never begins so
SHOWN = 40                            # characters of a request that a message repeats
PATIENCE_S = 30.0                     # with an answer: its start included, on a small computer that is busy


class QuestionError(Exception):
    """A refused query: HTTP status, the `key` at fault ("" for the whole query), and when to retry."""

    def __init__(self, status: int, why: str, key: str = "", retry_s: int = 0) -> None:
        super().__init__(f"{key}: {why}" if key else why)
        self.status, self.key, self.retry_s = status, key, retry_s


class Answer(NamedTuple):
    """The response: HTTP status, JSON (gzipped if it is long), and after how many seconds to retry."""

    status: int
    text: bytes
    retry_s: int = 0

    @property
    def is_compressed(self) -> bool:
        return self.text.startswith(GZIP)


def make_answer(said: dict[str, Any], status: int = 200) -> Answer:
    """Return an answer, gzipped if it is long."""
    text = json.dumps(said, allow_nan=False, separators=(",", ":")).encode()
    return Answer(status, gzip.compress(text, 1, mtime=0) if len(text) > SMALL_BYTES else text)


def make_refusal(error: QuestionError) -> Answer:
    """Return a response with `error` and `key` as JSON."""
    return Answer(error.status, json.dumps({"error": str(error), "key": error.key}).encode(), error.retry_s)


class Answerer(Protocol):
    """Answers queries: a gate in this process (WhatIf) or in another (WhatIfProcess). Called by several threads."""

    def facts(self) -> Answer:
        """Return the facts that a page needs: the gate's hash, limits, and the range and domain of each feature."""

    def answer(self, body: bytes) -> Answer:
        """Return p_two, p_three, novelty, verdict ("fire" or "hold") and codes of reasons.

        Each is a list over the configurations, unless the query contained only single numbers. null: the model gives no
        number. A refusal is 400 as parse_question states, or 429 after too many queries.
        """


class Question(NamedTuple):
    """Values of each feature, in the contract's order; the query means all combinations, the last varying fastest."""

    values: tuple[tuple[float, ...], ...]
    is_single: bool                               # three numbers, no lists: the answer has numbers, no lists, either

    @property
    def rows(self) -> int:
        return math.prod(map(len, self.values))


def parse_question(body: bytes) -> Question:
    """Read {"distance_m": ..., "motor_ratio": ..., "hood_deg": ...}, each a number or a list of numbers.

    Raises:
        QuestionError: 400; not JSON, a key missing, unknown or twice, a value that is not a number within the
            contract's range, or too many combinations.
    """
    try:
        said = json.loads(body.decode(), object_pairs_hook=_without_repeats)
    except (ValueError, RecursionError) as error:
        raise QuestionError(400, f"not JSON: {getattr(error, 'msg', 'cannot be read')}") from error
    if not isinstance(said, dict):
        raise QuestionError(400, f"got {_shown(said)}; expected an object with {', '.join(NAMES)}")
    for key in said:
        if key not in NAMES:
            raise QuestionError(400, f"unknown key; {EXPECTED}", str(key)[:SHOWN])
    values = tuple(_numbers(said, feature.name, feature.low, feature.high) for feature in FEATURES)
    question = Question(values, not any(isinstance(one, list) for one in said.values()))
    if question.rows > MAX_CONFIGURATIONS:
        raise QuestionError(400, f"{question.rows} configurations; expected at most {MAX_CONFIGURATIONS}")
    return question


def _without_repeats(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    said = dict(pairs)
    if len(said) < len(pairs):
        keys = [key for key, _ in pairs]
        raise QuestionError(400, "given twice", next(key for key in keys if keys.count(key) > 1)[:SHOWN])
    return said


def _numbers(said: dict[str, Any], name: str, low: float, high: float) -> tuple[float, ...]:
    if name not in said:
        raise QuestionError(400, f"missing; {EXPECTED}", name)
    values = said[name] if isinstance(said[name], list) else [said[name]]
    if not values:
        raise QuestionError(400, "an empty list; expected at least one number", name)
    for value in values:              # a bool is not a number here, and NaN is in no range
        if type(value) not in (int, float) or not low <= value <= high:
            raise QuestionError(400, f"got {_shown(value)}; expected a number from {low:g} to {high:g}", name)
    return tuple(map(float, values))


def _shown(value: object) -> str:
    return json.dumps(value)[:SHOWN]


class WhatIf:
    """Answers queries with one gate, one at a time, at most `rate_per_s` configurations per second.

    threshold: minimum p_three. free_speed_rad_s: of the motors, None if unknown. name:
    of the gate, as the page says it.
    """

    def __init__(self, gate: Gate, threshold: float, free_speed_rad_s: float | None, clock: Clock,
                 rate_per_s: int = RATE_PER_S, name: str = "") -> None:
        self._name = name
        self._gate, self._threshold, self._clock, self._rate_per_s = gate, threshold, clock, rate_per_s
        self._free_speed_rad_s = free_speed_rad_s
        self._lock = threading.Lock()
        self._budget, self._t_ns = float(BURST), clock.now_ns()

    def facts(self) -> Answer:
        return make_answer({
            "sha256": self._gate.sha256, "name": self._name, "threshold": self._threshold,
            "novelty_limit": NOVELTY_LIMIT, "free_speed_rad_s": self._free_speed_rad_s, "rate_per_s": self._rate_per_s,
            "hit_or_miss": self._gate.hit_or_miss,
            "features": [{"name": feature.name, "low": feature.low, "high": feature.high, "domain": domain}
                         for feature, domain in zip(FEATURES, self._gate.domain, strict=True)]})

    def answer(self, body: bytes) -> Answer:
        with self._lock:
            try:
                self._pay(QUESTION_COST)
                question = parse_question(body)
                self._pay(question.rows)
            except QuestionError as error:
                return make_refusal(error)
            rows = [self._judge(*row) for row in itertools.product(*question.values)]
        names = ("p_two", "p_three", "novelty", "verdict", "reasons")
        columns = rows[0] if question.is_single else zip(*rows, strict=True)
        return make_answer(dict(zip(names, columns, strict=True)))

    def _judge(self, distance_m: float, motor_ratio: float,
               hood_deg: float) -> tuple[float | None, float | None, float | None, str, list[str]]:
        rating, reasons = NO_RATING, [because.MODEL_FAILED(error="")]
        try:
            rating = self._gate.rate(distance_m, motor_ratio, hood_deg)
            reasons = doubt_rating(rating, self._threshold)
        except Exception:             # as in the tick, anything that onnxruntime raises is a HOLD
            rating = NO_RATING
        return (rating.p_two, rating.p_three, rating.novelty, "hold" if reasons else "fire",
                [reason.code for reason in reasons])

    def _pay(self, count: int) -> None:
        """Take configurations from the budget, which fills with time; QuestionError 429 where that is too few."""
        now_ns = self._clock.now_ns()
        self._budget = min(BURST, self._budget + self._rate_per_s * (now_ns - self._t_ns) / NS_PER_S)
        self._t_ns = now_ns
        if count > self._budget:
            raise QuestionError(429, "too many questions", retry_s=math.ceil((count - self._budget) / self._rate_per_s))
        self._budget -= count


class WhatIfProcess:
    """An Answerer in its own process, started by `command`, which calls serve_questions."""

    def __init__(self, command: tuple[str, ...]) -> None:
        self._command = command
        self._lock = threading.Lock()
        self._process: subprocess.Popen[bytes] | None = None
        self._line: Connection[bytes | None, Answer]

    def facts(self) -> Answer:
        return self._ask(None)

    def answer(self, body: bytes) -> Answer:
        return self._ask(body)

    def close(self) -> None:
        """End the process."""
        with self._lock:
            self._end()

    def _ask(self, question: bytes | None) -> Answer:
        """The answer; 503 where the process ends or does not answer in time. The next question starts another."""
        with self._lock:
            try:
                if self._process is None:
                    self._line, theirs = Pipe()
                    with theirs:
                        self._process = subprocess.Popen(self._command, stdin=theirs.fileno())
                self._line.send(question)
                if not self._line.poll(PATIENCE_S):
                    raise OSError("no answer in time")
                return Answer(*self._line.recv())
            except (OSError, EOFError) as error:
                self._end()
                why = "it has ended" if isinstance(error, EOFError) else error
                return make_refusal(QuestionError(503, f"the gate's process does not answer ({why})"))

    def _end(self) -> None:
        if self._process is not None:
            self._line.close()
            self._process.kill()
            self._process.wait()
            self._process = None


def serve_questions(answerer: Answerer, line: "Connection[Answer, bytes | None]") -> None:
    """Answer queries until there are no more."""
    with contextlib.suppress(EOFError):
        while True:
            question = line.recv()
            line.send(answerer.facts() if question is None else answerer.answer(question))

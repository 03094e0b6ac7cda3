"""Questions to the gate, answered in a process of its own: neither the tick nor the recorder waits for the model.

Frames on its standard input and output: a kind and a length, then a question; a status, seconds to wait and a length,
then an answer. It is started with the first question and ends when its input does, however this process ended.
"""

import select
import subprocess
import threading
from struct import Struct
from typing import IO

from truearc.robot.operator_ui.what_if import Answer, Answerer, QuestionError, make_refusal

ASKED_HEAD, ANSWER_HEAD = Struct(">BI"), Struct(">HHI")
FACTS, QUESTION = 0, 1
PATIENCE_S = 30.0                     # with an answer: its start included, on a small computer that is busy


class WhatIfProcess:
    """An Answerer in a process of its own, which `command` starts: one that calls serve_frames."""

    def __init__(self, command: tuple[str, ...]) -> None:
        self._command = command
        self._lock = threading.Lock()
        self._process: subprocess.Popen[bytes] | None = None

    def facts(self) -> Answer:
        return self._ask(FACTS, b"")

    def answer(self, body: bytes) -> Answer:
        return self._ask(QUESTION, body)

    def close(self) -> None:
        """End the process."""
        with self._lock:
            self._end()

    def _ask(self, kind: int, body: bytes) -> Answer:
        """The answer; 503 where the process ends or does not answer in time. The next question starts another."""
        with self._lock:
            try:
                if self._process is None:
                    self._process = subprocess.Popen(self._command, stdin=subprocess.PIPE, stdout=subprocess.PIPE,
                                                     bufsize=0)
                sent, back = self._process.stdin, self._process.stdout
                assert sent is not None and back is not None
                sent.write(ASKED_HEAD.pack(kind, len(body)) + body)
                status, retry_s, length = ANSWER_HEAD.unpack(_read_in_time(back, ANSWER_HEAD.size))
                return Answer(status, _read_in_time(back, length), retry_s)
            except OSError as error:
                self._end()
                return make_refusal(QuestionError(503, f"the gate's process does not answer ({error})"))

    def _end(self) -> None:
        if self._process is not None:
            self._process.kill()
            with self._process:
                self._process = None


def serve_frames(answerer: Answerer, asked: IO[bytes], answers: IO[bytes]) -> None:
    """Answer questions until there are no more."""
    while len(head := asked.read(ASKED_HEAD.size)) == ASKED_HEAD.size:
        kind, length = ASKED_HEAD.unpack(head)
        body = asked.read(length)
        status, text, retry_s = answerer.facts() if kind == FACTS else answerer.answer(body)
        answers.write(ANSWER_HEAD.pack(status, retry_s, len(text)) + text)
        answers.flush()


def _read_in_time(back: IO[bytes], length: int) -> bytes:
    """This number of bytes; OSError where they do not come."""
    got = bytearray()
    while len(got) < length:
        if not select.select([back], [], [], PATIENCE_S)[0]:
            raise OSError("no answer in time")
        part = back.read(length - len(got))
        if not part:
            raise OSError("it has ended")
        got += part
    return bytes(got)

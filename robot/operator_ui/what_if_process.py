"""Questions to the gate, answered in a process of its own: neither the tick nor the recorder waits for the model.

The process has one end of a connection as its standard input: a question's text, or None for the facts, and an answer
in turn. It is started with the first question and ends when the connection does, however this process ended.
"""

import contextlib
import subprocess
import threading
from multiprocessing.connection import Connection, Pipe

from truearc.robot.operator_ui.what_if import Answer, Answerer, QuestionError, make_refusal

PATIENCE_S = 30.0                     # with an answer: its start included, on a small computer that is busy


class WhatIfProcess:
    """An Answerer in a process of its own, which `command` starts: one that calls serve_questions."""

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
    """Answer questions until there are no more."""
    with contextlib.suppress(EOFError):
        while True:
            question = line.recv()
            line.send(answerer.facts() if question is None else answerer.answer(question))

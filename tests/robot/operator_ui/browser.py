"""A headless browser, spoken to over its own pipe: what a page shows at a size of screen, and what is painted."""

import base64
import json
import os
import select
import shutil
import subprocess
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

BROWSER = shutil.which("chromium") or shutil.which("chromium-browser")
COMMAND = ("--headless", "--no-sandbox", "--disable-gpu", "--remote-debugging-pipe", "--no-first-run",
           "--disable-background-networking")


class Browser:
    """One tab. Speaks the browser's debugging protocol: JSON, each message ended by a zero byte."""

    def __init__(self, profile: Path) -> None:
        theirs_in, self._out = os.pipe()
        self._in, theirs_out = os.pipe()

        def place() -> None:              # the browser reads from 3 and writes to 4
            spare_in, spare_out = os.dup(theirs_in), os.dup(theirs_out)
            os.dup2(spare_in, 3)
            os.dup2(spare_out, 4)

        self._process = subprocess.Popen([BROWSER, *COMMAND, f"--user-data-dir={profile}", "about:blank"],
                                         preexec_fn=place, pass_fds=(3, 4), stdout=subprocess.DEVNULL,
                                         stderr=subprocess.DEVNULL)
        os.close(theirs_in)
        os.close(theirs_out)
        self._number, self._pending, self._session = 0, b"", None
        self._frames: list[bytes] = []
        target = self._ask("Target.createTarget", url="about:blank")["targetId"]
        self._session = self._ask("Target.attachToTarget", targetId=target, flatten=True)["sessionId"]
        self._ask("Page.enable")

    def size(self, width: int, height: int, mobile: bool = False) -> None:
        self._ask("Emulation.setDeviceMetricsOverride", width=width, height=height, deviceScaleFactor=1, mobile=mobile)

    def open(self, url: str) -> None:
        self._ask("Page.navigate", url=url)

    def evaluate(self, script: str):
        return self._ask("Runtime.evaluate", expression=script, returnByValue=True, awaitPromise=True)["result"].get(
            "value")

    def wait(self, script: str, seconds: float = 20.0):
        """The first true value of the script; AssertionError with the page's words when there is none in time."""
        until = time.monotonic() + seconds
        while not (value := self.evaluate(script)):
            assert time.monotonic() < until, f"{script}: {self.evaluate('document.body.innerText')}"
            time.sleep(0.02)
        return value

    @contextmanager
    def filmed(self) -> Iterator[None]:
        """Meanwhile, what comes onto the screen is kept for `wait_for_frame`."""
        self._ask("Page.startScreencast", format="png")
        yield
        self._ask("Page.stopScreencast")

    def wait_for_frame(self, wanted: Callable[[bytes], bool], seconds: float = 60.0) -> None:
        """Until a PNG of the screen is wanted; AssertionError when none is in time. Asks nothing of the page itself."""
        until = time.monotonic() + seconds
        while not any(wanted(self._frames.pop(0)) for _ in range(len(self._frames))):
            left = until - time.monotonic()
            assert left > 0 and (b"\0" in self._pending or select.select([self._in], [], [], left)[0]), "no such frame"
            self._read()

    def interrupt(self) -> None:
        """Ends the page's script that runs now, and only that."""
        self._ask("Runtime.terminateExecution")

    def close(self) -> None:
        self._process.terminate()
        try:
            self._process.wait(10.0)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()
        os.close(self._in)
        os.close(self._out)

    def _send(self, method: str, **params) -> int:
        self._number += 1
        message = {"id": self._number, "method": method, "params": params}
        if self._session is not None:
            message["sessionId"] = self._session
        os.write(self._out, json.dumps(message).encode() + b"\0")
        return self._number

    def _ask(self, method: str, **params):
        number = self._send(method, **params)
        while (answer := self._read()).get("id") != number:
            pass
        assert "error" not in answer, answer
        return answer["result"]

    def _read(self) -> dict:
        while b"\0" not in self._pending:
            part = os.read(self._in, 1 << 16)
            assert part, "the browser has gone"
            self._pending += part
        text, _, self._pending = self._pending.partition(b"\0")
        message = json.loads(text)
        if message.get("method") == "Page.screencastFrame":
            self._frames.append(base64.b64decode(message["params"]["data"]))
            self._send("Page.screencastFrameAck", sessionId=message["params"]["sessionId"])    # or no more would come
        return message


class Shower:
    """Shows a page the same tick a hundred times a second; None: nothing."""

    def __init__(self, page):
        self.tick, self._page, self._over = None, page, threading.Event()
        self._thread = threading.Thread(target=self._show)
        self._thread.start()

    def _show(self):
        while not self._over.wait(0.01):
            if self.tick is not None:
                self._page.show(self.tick)

    def close(self):
        self._over.set()
        self._thread.join()

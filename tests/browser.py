"""Headless Chromium over its debugging pipe: what a page logs, requests and looks like."""

from __future__ import annotations

import base64
import json
import os
import shutil
import subprocess
import sys
from contextlib import contextmanager
from itertools import count
from typing import TYPE_CHECKING, Any

import pytest

if TYPE_CHECKING:
    from collections.abc import Iterator
    from io import BufferedReader, BufferedWriter
    from pathlib import Path

NAMES = ("chromium", "chromium-browser", "google-chrome", "chrome")

FLAGS = (
    *("--headless", "--no-sandbox", "--disable-gpu", "--disable-quic", "--no-first-run"),
    *("--disable-background-networking", "--disable-component-update", "--disable-sync"),
    *("--hide-scrollbars", "--remote-debugging-pipe", "about:blank"),
)

MOVE = """
import os, sys
commands, answers, *words = sys.argv[1:]
os.dup2(int(commands), 3), os.dup2(int(answers), 4)
os.execv(words[0], words)
"""
"""Puts the pipes where the browser looks for them: commands at descriptor 3, answers at 4."""


def executable() -> str:
    """Return the path of a Chromium."""
    found = next(filter(None, map(shutil.which, NAMES)), None)
    if found is None:
        pytest.fail(f"no browser: none of {', '.join(NAMES)} is installed")
    return found


class Browser:
    """A page of a browser; messages are those of the Chrome DevTools Protocol."""

    def __init__(self, commands: BufferedWriter, answers: BufferedReader) -> None:
        self._out, self._in = commands, answers
        self._number, self.events = count(1), []
        target = self.call("Target.createTarget", url="about:blank", session=None)["targetId"]
        attached = self.call("Target.attachToTarget", targetId=target, flatten=True, session=None)
        self._session = attached["sessionId"]
        for domain in ("Page", "Network", "Runtime", "Log"):
            self.call(f"{domain}.enable")

    def _read(self) -> dict[str, Any]:
        text = bytearray()
        while not text.endswith(b"\0"):
            ready = self._in.peek()
            if not ready:
                pytest.fail("the browser ended")
            text += self._in.read(ready.find(b"\0") + 1 or len(ready))
        return json.loads(text[:-1])

    def call(self, method: str, session: str | None = "", **params: object) -> dict[str, Any]:
        number = next(self._number)
        message = {"id": number, "method": method, "params": params}
        if session is not None:
            message["sessionId"] = self._session
        self._out.write(json.dumps(message).encode() + b"\0")
        self._out.flush()
        while True:
            answer = self._read()
            if answer.get("id") == number:
                if "error" in answer:
                    pytest.fail(f"{method}: {answer['error']}")
                return answer["result"]
            self.events.append(answer)

    def open(self, file: Path, width: int, height: int = 900, *, dark: bool = False) -> None:
        """Load a file at a width [CSS pixels] in a colour scheme, and wait until it is drawn."""
        size = {"width": width, "height": height, "deviceScaleFactor": 1, "mobile": width < 600}
        self.call("Emulation.setDeviceMetricsOverride", **size)
        scheme = {"name": "prefers-color-scheme", "value": "dark" if dark else "light"}
        self.call("Emulation.setEmulatedMedia", features=[scheme])
        self.events.clear()
        self.call("Page.navigate", url=file.resolve().as_uri())
        self.run(
            "new Promise(r => { if (document.readyState === 'complete') r(); else onload = r })"
        )
        self.settle()

    def settle(self) -> None:
        """Wait for two frames, by whose end what was changed is drawn."""
        self.run("new Promise(r => requestAnimationFrame(() => requestAnimationFrame(r)))")

    def run(self, expression: str) -> Any:
        """Return the value of a JavaScript expression in the page."""
        given = {"expression": expression, "awaitPromise": True, "returnByValue": True}
        found = self.call("Runtime.evaluate", **given)
        if "exceptionDetails" in found:
            pytest.fail(f"{expression}: {found['exceptionDetails']}")
        return found["result"].get("value")

    def mouse(self, kind: str, x: float, y: float, *, pressed: bool = False) -> None:
        button = (
            {"button": "left", "buttons": int(pressed), "clickCount": 1}
            if kind != "mouseMoved" or pressed
            else {}
        )
        self.call("Input.dispatchMouseEvent", type=kind, x=x, y=y, **button)

    def complaints(self) -> list[str]:
        """Return what the page logged as an error or a warning, and exceptions."""
        found = []
        for event in self.events:
            params = event.get("params", {})
            if event["method"] == "Runtime.exceptionThrown":
                found.append(str(params["exceptionDetails"]))
            elif event["method"] == "Runtime.consoleAPICalled":
                found.append(str(params["args"]))
            elif event["method"] == "Log.entryAdded":
                found.append(params["entry"]["text"])
        return found

    def requests(self) -> list[str]:
        """Return the addresses that were asked for, without the page's own and data in it."""
        sent = [
            e["params"]["request"]["url"]
            for e in self.events
            if e["method"] == "Network.requestWillBeSent"
        ]
        return [url for url in sent if not url.startswith(("file:", "data:"))]

    def picture(self, path: Path, *, whole: bool = True) -> None:
        """Write a PNG of the page."""
        found = self.call("Page.captureScreenshot", captureBeyondViewport=whole)
        path.write_bytes(base64.b64decode(found["data"]))


@contextmanager
def chromium(profile: Path) -> Iterator[Browser]:
    """Run a headless Chromium with an empty profile."""
    to_browser, commands = os.pipe()
    answers, from_browser = os.pipe()
    words = [executable(), *FLAGS, f"--user-data-dir={profile}"]
    process = subprocess.Popen(
        [sys.executable, "-c", MOVE, str(to_browser), str(from_browser), *words],
        pass_fds=(to_browser, from_browser),
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
    )
    os.close(to_browser)
    os.close(from_browser)
    with process, os.fdopen(commands, "wb") as to, os.fdopen(answers, "rb") as of:
        try:
            yield Browser(to, of)
        finally:
            process.terminate()

"""A headless Chromium, spoken to over pipes in its DevTools protocol: no driver, no port."""

from __future__ import annotations

import json
import os
import select
import shutil
import subprocess
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest

NAMES = ("chromium", "chromium-browser", "google-chrome-stable", "google-chrome", "chrome")
PATIENCE = 60.0  # seconds; the machine may be busy
# What a page of our own never needs, and what a container lacks.
FLAGS = (
    *("--headless=new", "--no-sandbox", "--disable-gpu", "--disable-dev-shm-usage"),
    *("--no-first-run", "--disable-background-networking", "--disable-component-update"),
    *("--disable-extensions", "--mute-audio", "--window-size=1280,900"),
    "--remote-debugging-pipe",
)


class Browser:
    """One page of a browser that runs; every wait has an end."""

    def __init__(self, process: subprocess.Popen[bytes], write: int, read: int) -> None:
        self.process, self._write, self._read = process, write, read
        self._buffer = b""
        self._number = 0
        self._session = ""
        self._answers: dict[int, dict[str, Any]] = {}
        self.events: list[dict[str, Any]] = []
        target = self.call("Target.createTarget", url="about:blank")["targetId"]
        attached = self.call("Target.attachToTarget", targetId=target, flatten=True)
        self._session = attached["sessionId"]
        for domain in ("Page", "Runtime", "Network"):
            self.call(f"{domain}.enable")
        self.call("Page.setLifecycleEventsEnabled", enabled=True)

    def call(self, method: str, **params: Any) -> Any:
        """Ask for something and wait for the answer."""
        return self._answer(self._send(method, **params), method)

    def asked(self, method: str, **params: Any) -> str:
        """Ask for something that makes the page ask back; says yes, and tells the kind."""
        seen, number = len(self.events), self._send(method, **params)
        kind: str = self._event("Page.javascriptDialogOpening", seen)["type"]
        self.call("Page.handleJavaScriptDialog", accept=True)
        self._answer(number, method)
        return kind

    def open(self, path: Path) -> None:
        """Open a file and wait until it is loaded."""
        self._loaded(lambda: self.call("Page.navigate", url=path.resolve().as_uri()))

    def reload(self) -> None:
        """As a person does."""
        self._loaded(lambda: self.call("Page.reload"))

    def script(self, expression: str) -> Any:
        """What the page makes of it."""
        answer = self.call(
            "Runtime.evaluate", expression=expression, returnByValue=True, awaitPromise=True
        )
        assert "exceptionDetails" not in answer, answer["exceptionDetails"]
        return answer["result"].get("value")

    def until(self, expression: str) -> None:
        """Wait until it is true on the page."""
        end = time.monotonic() + PATIENCE
        while not self.script(expression):
            assert time.monotonic() < end, f"never true: {expression}"
            time.sleep(0.01)

    def press(self, key: str) -> None:
        """A key, down and up."""
        text = {"text": key} if len(key) == 1 else {"text": "\r"} if key == "Enter" else {}
        self.call("Input.dispatchKeyEvent", type="keyDown", key=key, code=key, **text)
        self.call("Input.dispatchKeyEvent", type="keyUp", key=key, code=key)

    def click(self, selector: str) -> None:
        """The middle of an element, with the mouse, scrolled to if need be."""
        box = self.script(
            f"(e => (e.scrollIntoView({{block: 'nearest'}}), e.getBoundingClientRect().toJSON()))"
            f"(document.querySelector({json.dumps(selector)}))"
        )
        middle = {"x": box["x"] + box["width"] / 2, "y": box["y"] + box["height"] / 2}
        where = {**middle, "button": "left", "clickCount": 1}
        self.call("Input.dispatchMouseEvent", type="mousePressed", **where)
        self.call("Input.dispatchMouseEvent", type="mouseReleased", **where)

    def downloads_to(self, folder: Path) -> None:
        """Where files are saved."""
        self.call(
            "Browser.setDownloadBehavior",
            behavior="allow",
            downloadPath=str(folder),
            eventsEnabled=True,
        )

    def requests(self) -> list[str]:
        """The addresses that were asked for since the start, without embedded data."""
        sent = [event for event in self.events if event["method"] == "Network.requestWillBeSent"]
        urls = [event["params"]["request"]["url"] for event in sent]
        return [url for url in urls if not url.startswith("data:")]

    def errors(self) -> list[dict[str, Any]]:
        """What went wrong in scripts, and what the page's policy stopped."""
        return [event for event in self.events if event["method"] == "Runtime.exceptionThrown"]

    def _loaded(self, begin: Callable[[], Any]) -> None:
        """Until what this navigation brings is loaded; what loads late from before is not it."""
        seen = len(self.events)
        begin()
        arrived = self._event("Page.frameNavigated", seen)
        loader = arrived["frame"]["loaderId"]
        self._event("Page.lifecycleEvent", seen, name="load", loaderId=loader)

    def _send(self, method: str, **params: Any) -> int:
        self._number += 1
        message = {"id": self._number, "method": method, "params": params}
        if self._session and not method.startswith(("Target.", "Browser.")):
            message["sessionId"] = self._session
        os.write(self._write, json.dumps(message).encode() + b"\0")
        return self._number

    def _answer(self, number: int, method: str) -> Any:
        end = time.monotonic() + PATIENCE
        while number not in self._answers:
            self._hear(end, method)
        said = self._answers.pop(number)
        assert "error" not in said, f"{method}: {said['error']}"
        return said["result"]

    def _event(self, method: str, seen: int, **like: str) -> Any:
        """The first of this kind among the events from number `seen` on."""
        end = time.monotonic() + PATIENCE
        while True:
            while seen < len(self.events):
                event, seen = self.events[seen], seen + 1
                params = event.get("params", {})
                if event["method"] == method and all(params.get(k) == v for k, v in like.items()):
                    return params
            self._hear(end, method)

    def _hear(self, end: float, what: str) -> None:
        """Put the next message where it belongs."""
        said = self._next(end, what)
        if "id" in said:
            self._answers[said["id"]] = said
        else:
            self.events.append(said)

    def _next(self, end: float, what: str) -> dict[str, Any]:
        while b"\0" not in self._buffer:
            ready, _, _ = select.select([self._read], [], [], max(0.0, end - time.monotonic()))
            assert ready, f"the browser does not answer: {what}"
            content = os.read(self._read, 1 << 16)
            assert content, f"the browser is gone: {what}"
            self._buffer += content
        message, self._buffer = self._buffer.split(b"\0", 1)
        said: dict[str, Any] = json.loads(message)
        return said


@contextmanager
def open_browser(profile: Path) -> Iterator[Browser]:
    """A browser with an empty profile, ended with the block; skips the test if there is none."""
    program = next(filter(None, map(shutil.which, NAMES)), None)
    if program is None:
        pytest.skip(f"no browser on this machine ({', '.join(NAMES)})")
    theirs_read, ours_write = os.pipe()
    ours_read, theirs_write = os.pipe()
    # The protocol's pipes are descriptors 3 and 4; only a shell can put them there safely.
    command = ["bash", "-c", f'exec "$@" 3<&{theirs_read} 4>&{theirs_write}', "browser"]
    command += [program, *FLAGS, f"--user-data-dir={profile}", "about:blank"]
    process = subprocess.Popen(
        command, pass_fds=(theirs_read, theirs_write), stderr=subprocess.DEVNULL
    )
    os.close(theirs_read)
    os.close(theirs_write)
    try:
        yield Browser(process, ours_write, ours_read)
    finally:
        os.close(ours_write)
        os.close(ours_read)
        process.terminate()
        try:
            process.wait(20)
        except subprocess.TimeoutExpired:
            process.kill()
            process.wait()

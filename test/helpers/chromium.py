"""Drive a headless Chromium over its debugging pipe: no driver, no network, no port.

Messages are JSON, each ended by a zero byte, on the browser's file descriptors 3 and 4.
"""

from __future__ import annotations

import base64
import fcntl
import json
import os
import select
import shutil
import subprocess
import time

import pytest

NAMES = ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable")
FLAGS = (
    "--headless=new",
    "--no-sandbox",
    "--no-first-run",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-dev-shm-usage",
    "--use-angle=swiftshader",
    "--enable-unsafe-swiftshader",
    "--force-device-scale-factor=1",
    "--hide-scrollbars",
    "--remote-debugging-pipe",
)
TIMEOUT_S = 90.0


def find_chromium():
    """Return the browser's path, or skip the test."""
    for name in NAMES:
        path = shutil.which(name)
        if path:
            return path
    pytest.skip("no chromium on this machine: the report is not tested in a browser")


def _above_pipe(fd):
    """Return a duplicate of the descriptor with a number above 3 and 4."""
    moved = fcntl.fcntl(fd, fcntl.F_DUPFD_CLOEXEC, 10)
    os.close(fd)
    return moved


class Browser:
    """One page of one browser; a context manager."""

    def __init__(self, profile, width=1280, height=900):
        self.events = []
        self._next = 0
        self._buffer = b""
        to_read, self._write = os.pipe()
        self._read, to_write = os.pipe()
        command = [find_chromium(), *FLAGS, f"--window-size={width},{height}",
                   f"--user-data-dir={profile}", "about:blank"]  # fmt: skip
        to_read, to_write = (_above_pipe(fd) for fd in (to_read, to_write))

        def connect():
            os.dup2(to_read, 3)
            os.dup2(to_write, 4)

        # Other descriptors of this process are not inheritable: none has to be closed.
        self._process = subprocess.Popen(
            command, preexec_fn=connect, close_fds=False, stdin=subprocess.DEVNULL,
            stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL,
        )  # fmt: skip
        os.close(to_read)
        os.close(to_write)
        self._session = None

    def __enter__(self):
        try:
            targets = self.call("Target.getTargets")["targetInfos"]
            page = next(t["targetId"] for t in targets if t["type"] == "page")
            attached = self.call("Target.attachToTarget", targetId=page, flatten=True)
            self._session = attached["sessionId"]
            for domain in ("Page", "Runtime", "Log"):
                self.call(f"{domain}.enable")
        except BaseException:
            self.close()
            raise
        return self

    def __exit__(self, *_):
        self.close()

    def close(self):
        self._process.terminate()
        try:
            self._process.wait(20)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()
        os.close(self._read)
        os.close(self._write)

    def call(self, method, **params):
        """Send one command and return its result; store events received before it."""
        self._next += 1
        message = {"id": self._next, "method": method, "params": params}
        if self._session:
            message["sessionId"] = self._session
        os.write(self._write, json.dumps(message).encode() + b"\0")
        deadline = time.monotonic() + TIMEOUT_S
        while True:
            answer = self._receive(deadline)
            if answer.get("id") == self._next:
                if "error" in answer:
                    raise RuntimeError(f"{method}: {answer['error']['message']}")
                return answer["result"]
            self.events.append(answer)

    def _receive(self, deadline):
        while b"\0" not in self._buffer:
            ready, _, _ = select.select([self._read], [], [], max(deadline - time.monotonic(), 0))
            content = os.read(self._read, 1 << 20) if ready else b""
            if not content:
                raise RuntimeError("chromium does not answer" if not ready else "chromium ended")
            self._buffer += content
        text, self._buffer = self._buffer.split(b"\0", 1)
        return json.loads(text)

    def open(self, path):
        self.call("Page.navigate", url=path.resolve().as_uri())

    def evaluate(self, expression):
        """Return the value of a JavaScript expression; a promise is awaited."""
        answer = self.call("Runtime.evaluate", expression=expression, returnByValue=True,
                           awaitPromise=True)  # fmt: skip
        if "exceptionDetails" in answer:
            raise RuntimeError(json.dumps(answer["exceptionDetails"])[:400])
        return answer["result"].get("value")

    def wait_for(self, condition):
        """Wait until a JavaScript expression is true; it is polled every 10 ms."""
        look = f"""new Promise((resolve, reject) => {{
            const end = performance.now() + {TIMEOUT_S * 900};
            const look = () => ({condition}) ? resolve(true)
                : performance.now() > end ? reject(new Error('timeout')) : setTimeout(look, 10);
            look(); }})"""
        try:
            return self.evaluate(look)
        except RuntimeError as error:
            raise RuntimeError(f"{condition}: {error}") from None

    def mouse(self, kind, x, y, **more):
        self.call("Input.dispatchMouseEvent", type=kind, x=x, y=y, **more)

    def click(self, selector):
        box = self.evaluate(
            f"(() => {{ const b = document.querySelector('{selector}').getBoundingClientRect();"
            "return [b.x + b.width / 2, b.y + b.height / 2]; })()"
        )
        for kind in ("mousePressed", "mouseReleased"):
            self.mouse(kind, *box, button="left", clickCount=1)

    def screenshot(self, path, **more):
        path.write_bytes(base64.b64decode(self.call("Page.captureScreenshot", **more)["data"]))
        return path

    def complaints(self):
        """Return the page's console messages and errors."""
        found = []
        for event in self.events:
            method, params = event.get("method"), event.get("params", {})
            if method == "Runtime.consoleAPICalled":
                found.append([a.get("value", a.get("description")) for a in params["args"]])
            elif method == "Runtime.exceptionThrown":
                found.append(params["exceptionDetails"].get("text"))
            elif method == "Log.entryAdded" and params["entry"]["level"] in ("error", "warning"):
                found.append(params["entry"]["text"])
        return found

"""The live page: a small web server in a thread of its own.

Pages receive the map by server-sent events. A page sends requests as POST to one of a few names,
with the token that the node prints. No request is ever interpreted as a file path, because the
pages are built before the server starts.
"""

from __future__ import annotations

import asyncio
import hmac
import json
import secrets
import threading
from collections.abc import Awaitable, Callable, Mapping
from concurrent.futures import Future
from contextlib import suppress
from importlib.resources import files
from typing import Any

from aiohttp import web

from tccm_ros.errors import OutputError, TccmError, one_line
from tccm_ros.report import palette
from tccm_ros.report.page import MAP_LAYERS, viewer_asset, viewer_page, viewer_script
from tccm_ros.view.live_state import LiveState

PERIOD_S = 0.2
"""Period of messages to the pages, s, for a smoothly moving pose."""

MAX_RATE = 50_000
"""Rate limit of map updates to each page after the snapshot, bytes per second."""

MAX_PAGES = 32
"""Maximum number of open pages; further ones are refused."""

MAX_WAITING = 20
"""Length of a page's message queue; a page that does not read is closed when its queue is full, and
reconnects by itself."""

SILENCE_S = 15.0
"""Time without messages after which a comment is written to detect closed pages, s."""

MAX_BODY = 10_000
"""Maximum size of a request, bytes."""

ANSWER_S = 15.0
"""Timeout for the node's answer, s."""

HEADERS = {
    "Cache-Control": "no-store",
    "Content-Security-Policy": "default-src 'none'; script-src 'self'; style-src 'self'; "
    "connect-src 'self'; img-src 'self' data:; frame-ancestors 'none'; base-uri 'none'",
    "Referrer-Policy": "no-referrer",
    "X-Content-Type-Options": "nosniff",
}

Ask = Callable[[str, Mapping[str, Any]], Awaitable[Any]]
"""Sends a request (name and values) to the node and returns a JSON value."""


class LivePage:
    """Web server of the page, until it is closed.

    Parameters
    ----------
    ask
        Answers the requests of pages; called in the server's thread.
    questions
        Names of allowed requests.
    host, port
        Address of the server; port 0 takes a free port.

    Attributes
    ----------
    token
        Token required in requests.
    url
        Address of the page, with the token.

    Raises
    ------
    OutputError
        If the address cannot be bound.
    """

    def __init__(self, ask: Ask, questions: frozenset[str], host: str, port: int):
        self._ask, self._questions, self._host = ask, questions, host
        self._state, self._pages = LiveState(), set[asyncio.Queue[str | None]]()
        self.token = secrets.token_urlsafe(18)
        self._texts = _page_texts()
        self._loop = asyncio.new_event_loop()
        self._ended = asyncio.Event()
        started: Future[int] = Future()
        self._thread = threading.Thread(target=self._run, args=(port, started), daemon=True)
        self._thread.start()
        try:
            self.port = started.result()
        except OSError as error:
            why = one_line(error)
            raise OutputError(f"{host}:{port}: the live page cannot be served ({why})") from None
        shown = f"[{host}]" if ":" in host else host
        self._names = {f"{name}:{self.port}" for name in (shown, "localhost", "127.0.0.1")}
        self.url = f"http://{shown}:{self.port}/#{self.token}"

    def update(self, change: Callable[[LiveState], object]) -> None:
        """Queue a change of the state for the server's thread; none once the page is closed."""
        with suppress(RuntimeError):  # by a closed loop alone
            self._loop.call_soon_threadsafe(change, self._state)

    def close(self) -> None:
        """Notify the pages of the end and stop the server."""
        if self._thread.is_alive():
            self._loop.call_soon_threadsafe(self._ended.set)
            self._thread.join()
            self._loop.close()

    # --- in the server's thread ---

    def _run(self, port: int, started: Future[int]) -> None:
        try:
            self._loop.run_until_complete(self._serve(port, started))
        except Exception as error:  # of the start; a later one ends the server with a traceback
            if started.done():
                raise
            started.set_exception(error)

    async def _serve(self, port: int, started: Future[int]) -> None:
        app = web.Application(client_max_size=MAX_BODY, middlewares=[self._guard])
        for name in self._texts:
            app.router.add_get(f"/{name}", self._text)
        app.router.add_get("/events", self._events)
        app.router.add_post("/ask/{name}", self._answer)
        runner = web.AppRunner(
            app, access_log=None, handler_cancellation=True, shutdown_timeout=1.0
        )
        await runner.setup()
        try:
            await web.TCPSite(runner, self._host, port).start()
        except OSError:
            await runner.cleanup()
            raise
        started.set_result(runner.addresses[0][1])
        budget = float(MAX_RATE)
        while not self._ended.is_set():
            budget = min(budget + MAX_RATE * PERIOD_S, float(MAX_RATE))
            if budget > 0.0:
                budget -= self._send(self._state.delta(int(budget)))
            try:
                await asyncio.wait_for(self._ended.wait(), PERIOD_S)
            except TimeoutError:
                continue
        for page in self._pages:
            _put(page, None)
        await runner.cleanup()

    def _send(self, delta: Mapping[str, Any]) -> int:
        """Send a delta to all pages and return its size, bytes."""
        if not delta:
            return 0
        text = json.dumps(delta, separators=(",", ":"))
        for page in self._pages:
            _put(page, text)
        return len(text)

    @web.middleware
    async def _guard(self, request: web.Request, handler: Any) -> web.StreamResponse:
        """Refuse requests with other host names (DNS rebinding) or from other origins."""
        if request.host not in self._names:
            return _refusal(403, "another host")
        origin = request.headers.get("Origin")
        if origin is not None and origin.removeprefix("http://") not in self._names:
            return _refusal(403, "another origin")
        response: web.StreamResponse = await handler(request)
        if not response.prepared:
            response.headers.update(HEADERS)
        return response

    async def _text(self, request: web.Request) -> web.Response:
        kind, text = self._texts[request.path[1:]]
        return web.Response(text=text, content_type=kind)

    async def _events(self, request: web.Request) -> web.StreamResponse:
        if len(self._pages) >= MAX_PAGES:
            return _refusal(503, f"{MAX_PAGES} pages are open")
        response = web.StreamResponse(headers={**HEADERS, "Content-Type": "text/event-stream"})
        page: asyncio.Queue[str | None] = asyncio.Queue(MAX_WAITING)
        _put(page, json.dumps({"first": True, **self._state.snapshot()}, separators=(",", ":")))
        self._pages.add(page)
        try:
            await response.prepare(request)
            while (text := await _next(page)) is not None:
                await response.write(text.encode())
            await response.write(b'data: {"ended":true}\n\n')
        except (ConnectionError, asyncio.CancelledError):
            pass  # the page was closed
        finally:
            self._pages.discard(page)
        return response

    async def _answer(self, request: web.Request) -> web.Response:
        """Answer a page's request if it has the token."""
        name, token = request.match_info["name"], request.headers.get("X-Token", "")
        if not hmac.compare_digest(token.encode(), self.token.encode()):
            return _refusal(403, "the token is wrong: take the address that the node prints")
        if name not in self._questions:
            return _refusal(404, "no such question")
        try:
            values = await request.json()
        except (ValueError, RecursionError):
            return _refusal(400, "not JSON")
        if not isinstance(values, dict):
            return _refusal(400, "not an object")
        try:
            answer = await asyncio.wait_for(self._ask(name, values), ANSWER_S)
        except TimeoutError:
            return _refusal(504, "the node does not answer")
        except (TccmError, TypeError, ValueError, AssertionError, OverflowError) as error:
            return _refusal(400, one_line(error))
        return web.json_response(answer)


async def _next(page: asyncio.Queue[str | None]) -> str | None:
    """Return the next text to write: a message, or a comment after a long silence."""
    try:
        text = await asyncio.wait_for(page.get(), SILENCE_S)
    except TimeoutError:
        return ":\n\n"
    return None if text is None else f"data: {text}\n\n"


def _put(page: asyncio.Queue[str | None], text: str | None) -> None:
    """Queue a message; if the queue is full, tell the page to reconnect."""
    if page.full():
        while not page.empty():
            page.get_nowait()
        text = None
    page.put_nowait(text)


def _refusal(status: int, why: str) -> web.Response:
    return web.json_response({"error": why}, status=status, headers=HEADERS)


def _page_texts() -> dict[str, tuple[str, str]]:
    """Return content type and text of the served files, by name."""
    page = viewer_page(
        "Live map",
        '<link rel="stylesheet" href="live.css">',
        "waiting for the node",
        MAP_LAYERS | {"path": ("path, robot", True)},
        controls=_asset("controls.html"),
        sections=_asset("sections.html"),
        scripts='<script src="live.js"></script>',
    )
    colors = f"const WORLD_COLORS = {json.dumps(palette.WORLD)};"
    script = f"{colors}\n{viewer_script()}\n{_asset('live.js')}"
    return {
        "": ("text/html", page),
        "live.js": ("text/javascript", f"(() => {{\n'use strict';\n{script}\n}})();\n"),
        "live.css": ("text/css", f"{viewer_asset('page.css')}\n{_asset('live.css')}"),
    }


def _asset(name: str) -> str:
    return files("tccm_ros.view").joinpath("live", name).read_text(encoding="utf-8")

"""The server of the studio: one process, one thread that computes, a few pages."""

import asyncio
import secrets
import socket
from collections.abc import Callable, Mapping
from concurrent.futures import Executor, ThreadPoolExecutor
from errno import EADDRINUSE
from typing import Any

from bokeh.application.application import Application
from bokeh.application.handlers.function import FunctionHandler
from bokeh.document import Document
from bokeh.server.server import BaseServer
from bokeh.server.tornado import BokehTornado
from bokeh.server.views.autoload_js_handler import AutoloadJsHandler
from bokeh.server.views.doc_handler import DocHandler
from bokeh.server.views.metadata_handler import MetadataHandler
from bokeh.server.views.ws import WSHandler
from bokeh.settings import settings
from bokeh.util.token import get_session_id
from tornado.httpserver import HTTPServer
from tornado.httputil import HTTPMessageDelegate, HTTPServerRequest
from tornado.ioloop import IOLoop
from tornado.web import RequestHandler

from dechirp.core.errors import InvalidSetting
from dechirp.studio.connection import Connection
from dechirp.studio.guard import Guard, Headers, Refusal, is_loopback

MOST_PAGES = 8
MOST_MESSAGE = 2**20
"""Bytes that a browser may send at once: its largest message is the text of a settings file."""
_CLOSED_AFTER_MS = 10_000
"""A page that was closed, or never began, is forgotten; a slow browser begins within this."""

Page = Callable[[Document], None]


class Studio:
    """The studio on its port.

    Parameters
    ----------
    pages : callable
        What fills the documents of pages, by their addresses, given the worker for all of them.
    host : str
        Address to listen on. Any but this machine's own needs a token, which is made here.
    port : int
        0 for any that is free.

    Raises
    ------
    InvalidSetting
        If nobody can listen there.
    """

    def __init__(
        self, pages: Callable[[Executor], Mapping[str, Page]], *, host: str, port: int
    ) -> None:
        self._socket = _bound(host, port)
        port = self._socket.getsockname()[1]
        self.token = None if is_loopback(host) else secrets.token_urlsafe(32)
        named = f"[{host}]" if ":" in host else host
        self.address = f"http://{named}:{port}/" + (f"?token={self.token}" if self.token else "")
        self._guard = Guard(host, port, self.token)
        self._worker = ThreadPoolExecutor(1, thread_name_prefix="studio")
        self._pages = pages(self._worker)

    async def serve(self, stopped: asyncio.Event) -> None:
        """Answer until told to stop."""
        settings.resources = "server"  # whatever the environment says: nothing comes from outside
        settings.compression_level = 0  # of arrays, which would take longer than sending them
        pages = {path: Application(FunctionHandler(make)) for path, make in self._pages.items()}
        app = _Guarded(self._guard, pages)
        http = HTTPServer(app, max_body_size=MOST_MESSAGE, max_header_size=2**16)
        http.add_socket(self._socket)
        server = BaseServer(IOLoop.current(), app, http)
        server.start()
        try:
            await stopped.wait()
        finally:
            server.stop()
            await http.close_all_connections()
            self._worker.shutdown(wait=False, cancel_futures=True)


def _bound(host: str, port: int) -> socket.socket:
    """Socket that listens there."""
    family = socket.AF_INET6 if ":" in host else socket.AF_INET
    try:
        host.encode("idna")  # else the socket fails on it in another way, and stays open
        bound = socket.create_server((host, port), family=family)
    except (OSError, ValueError) as error:
        if getattr(error, "errno", None) == EADDRINUSE:
            raise InvalidSetting(
                "--port",
                got=f"{port}, where another program listens",
                need="free",
                fix=f"Give another one, as --port {port + 1}, or 0 for any that is free.",
            ) from None
        why, _, _ = (getattr(error, "strerror", None) or str(error)).partition(" (")
        raise InvalidSetting(
            "--host",
            got=f"{host}, port {port}: {why}",
            need="an address of this machine, with a port that one may listen on",
            fix="Leave it out for 127.0.0.1; ports below 1024 are often for administrators.",
        ) from None
    bound.setblocking(False)
    return bound


class _Guarded(BokehTornado):
    """Bokeh's server behind a guard, with a cap on pages."""

    def __init__(self, guard: Guard, pages: Mapping[str, Application]) -> None:
        super().__init__(
            pages,
            extra_websocket_origins=sorted(guard.places),
            extra_patterns=[("/healthz", _Health)],
            use_index=False,
            sign_sessions=True,
            secret_key=secrets.token_bytes(32),
            include_headers=[],
            include_cookies=[],
            websocket_max_message_size_bytes=MOST_MESSAGE,
            check_unused_sessions_milliseconds=1000,
            unused_session_lifetime_milliseconds=_CLOSED_AFTER_MS,
            ico_path="none",
        )
        self._guard = guard
        self.add_transform(Headers)

    def new_connection(self, *of: Any) -> Connection:
        made = Connection(*of)
        self._clients.add(made)
        return made

    def find_handler(self, request: HTTPServerRequest, **_: Any) -> HTTPMessageDelegate:
        if self._guard.enters(request):
            return self.get_handler_delegate(request, _Entrance, {"cookie": self._guard.cookie})
        route = super().find_handler(request)
        refusal = self._guard.refusal(request) or self._unavailable(request, route.handler_class)
        if refusal is not None:
            return self.get_handler_delegate(request, _Refused, {"refusal": refusal})
        return route

    def _unavailable(self, request: HTTPServerRequest, kind: type) -> Refusal | None:
        """A page too many; or what Bokeh would serve for pages of other sites, and is not here.

        What would answer counts, not the address: Bokeh knows a page by several.
        """
        sessions = [one for page in self.app_paths for one in self.get_sessions(page)]
        if issubclass(kind, AutoloadJsHandler | MetadataHandler):
            return Refusal(404, "Not found.")
        if issubclass(kind, DocHandler) and len(sessions) >= MOST_PAGES:
            return Refusal(503, f"{MOST_PAGES} pages are open, as many as may be. Close one.")
        if issubclass(kind, WSHandler) and _session_id(request) not in {o.id for o in sessions}:
            return Refusal(403, "Forbidden: this page was closed. Load it again.")
        return None


def _session_id(request: HTTPServerRequest) -> str | None:
    """Session that a connection says it belongs to."""
    token = request.headers.get("Sec-WebSocket-Protocol", "").rpartition(",")[2].strip()
    try:
        return get_session_id(token)
    except Exception:  # whatever was sent instead
        return None


class _Health(RequestHandler):
    def get(self) -> None:
        self.set_header("Content-Type", "text/plain")
        self.write("ok\n")


class _Refused(RequestHandler):
    def initialize(self, refusal: Refusal) -> None:
        self._refusal = refusal

    def prepare(self) -> None:
        self.set_status(self._refusal.status)
        self.set_header("Content-Type", "text/plain; charset=utf-8")
        self.finish(f"{self._refusal.why}\n")


class _Entrance(RequestHandler):
    """Put the token into a cookie, and lead on to the address without it."""

    def initialize(self, cookie: str) -> None:
        self._cookie = cookie

    def get(self) -> None:
        # Lax: a link in a mail leads here, and its browser sends no stricter one after that.
        self.set_cookie(self._cookie, self.get_argument("token"), httponly=True, samesite="Lax")
        self.redirect("/")

"""Server of the studio: one process, one worker thread, a few pages, batched messages."""

import asyncio
import secrets
import socket
import sys
from collections.abc import Awaitable, Callable, Mapping
from concurrent.futures import Executor, Future, ThreadPoolExecutor
from errno import EADDRINUSE
from typing import Any, NamedTuple, TypeVar

from bokeh.application.application import Application
from bokeh.application.handlers.function import FunctionHandler
from bokeh.core.serialization import Ref, Serializer
from bokeh.document import Document
from bokeh.document.events import DocumentPatchedEvent
from bokeh.document.json import PatchJson
from bokeh.document.models import DocumentModelManager
from bokeh.model import Model
from bokeh.protocol import Protocol
from bokeh.protocol.message import Message
from bokeh.protocol.messages.patch_doc import patch_doc
from bokeh.resources import Component, Resources
from bokeh.server.connection import ServerConnection
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

from dechirp.core.compiled_kernels import use_compiled_kernels
from dechirp.core.errors import InvalidSetting
from dechirp.studio.access_control import AccessControl, Refusal, SecurityHeaders, is_loopback

T = TypeVar("T")


class _CollectedChange(NamedTuple):
    """Message of a change that is sent with the others of its batch."""

    def prepare(self) -> None:
        """Serialize nothing: the batch does."""


class _CollectingProtocol(Protocol):
    """Bokeh protocol that collects changes of the page instead of making a message of each."""

    def __init__(self) -> None:
        super().__init__()
        self.changes: list[DocumentPatchedEvent] = []

    def create(self, msgtype: Any, *arguments: Any, **metadata: Any) -> Any:
        """Create a message; that of a change is a `_CollectedChange`."""
        if msgtype != "PATCH-DOC":
            return super().create(msgtype, *arguments, **metadata)
        self.changes += arguments[0]
        return _CollectedChange()


class BatchingConnection(ServerConnection):
    """Bokeh connection that batches changes: Bokeh itself sends some forty messages per frame.

    Messages are sent after the code that makes the changes has returned, so the first one can
    contain all of them. The page then draws a frame as a whole.
    """

    def __init__(self, protocol: Protocol, socket: Any, context: Any, session: Any) -> None:
        self._collected = _CollectingProtocol()
        super().__init__(self._collected, socket, context, session)
        self._browser = socket
        self._page_session = session

    def detach_session(self) -> None:
        """End the session with its browser: a closed page takes no place among `MAX_PAGES`."""
        self._page_session.request_expiration()
        super().detach_session()

    def send_patch_document(self, event: DocumentPatchedEvent) -> Awaitable[None]:
        """Send a change with all others that are made before it is awaited: Bokeh up to 3.9."""
        return self.send_message(self.protocol.create("PATCH-DOC", [event]))

    async def send_message(self, message: Any) -> None:
        """Send a message, of changes the whole batch: called by Bokeh from 3.10 on."""
        if not isinstance(message, _CollectedChange):
            await self._browser.send_message(message)
            return
        changes, self._collected.changes = self._collected.changes, []
        changes = [change for change in changes if _is_changed_model_in_document(change)]
        if changes:
            await self._browser.send_message(_build_patch_message(changes))


def _is_changed_model_in_document(change: DocumentPatchedEvent) -> bool:
    """Return True if the changed model is still in the page; else it would be sent again as new."""
    model = getattr(change, "model", None)
    return model is None or model.document is not None


def _build_patch_message(changes: list[DocumentPatchedEvent]) -> Message[Any]:
    """Build the message of `patch_doc.create`, with arrays in its text.

    A separate array takes two more messages, a hundred per frame: 10 % of the time of server and
    browser.
    """
    models = changes[0].document.models
    serializer = _LazySerializer(models)
    content = PatchJson(events=serializer.encode(changes))
    models.flush_synced(lambda model: not serializer.has_ref(model))
    return patch_doc(patch_doc.create_header(), {}, content)


class _LazySerializer(Serializer):
    """Bokeh serializer with lazy model lookup: looking up all 1,100 models takes 3 ms a message."""

    def __init__(self, models: DocumentModelManager) -> None:
        super().__init__(deferred=False)
        self._models = models
        self._unsent: set[Model] = set()
        models.flush_synced(self._remember_unsent)  # Bokeh offers no other access to them

    def get_ref(self, obj: object) -> Ref | None:
        """Return the reference of an object that the browser has, else None."""
        if isinstance(obj, Model) and obj.id in self._models and obj not in self._unsent:
            return obj.ref
        return super().get_ref(obj)

    def _remember_unsent(self, model: Model) -> bool:
        self._unsent.add(model)
        return True


class _CallingThread(ThreadPoolExecutor):
    """Executor that runs each job at once, on the thread that submits it.

    From 3.10 on, Bokeh runs handlers on threads. Those of the studio are short and use its
    asynchronous loop, on whose thread earlier versions of Bokeh call them.
    """

    def submit(self, job: Callable[..., T], /, *arguments: Any, **options: Any) -> Future[T]:
        """Run a job."""
        future: Future[T] = Future()
        try:
            future.set_result(job(*arguments, **options))
        except Exception as error:
            future.set_exception(error)
        return future


MAX_PAGES = 8
MAX_MESSAGE_BYTES = 2**20
"""Largest message from a browser: the text of a settings file."""
UNUSED_LIFETIME_MS = 30_000
"""Time after which a page that never connected is discarded. A page waits 20 s for its connection,
see `connection.js`, and is then loaded again, so it never finds its session discarded before."""

_SWITCH_INTERVAL_S = 0.5e-3
"""Time after which a thread takes the interpreter lock from another: Python's 5 ms delay the worker
after each of 150 compiled loops of a frame while a page is sent. 4 % more maps a second."""
_SCRIPTS: tuple[Component, ...] = ("bokeh", "bokeh-widgets")
"""Parts of Bokeh that the pages use; tables, mathematics in texts and WebGL take 2.28 MB more."""

PageBuilder = Callable[[Document], None]


class StudioServer:
    """Studio server on a port.

    Parameters
    ----------
    pages : callable
        Function that returns the page builders by address, given the shared worker.
    host : str
        Address to listen on. Any address but this machine's own requires a token, created here.
    port : int
        Port; 0 selects a free one.

    Raises
    ------
    InvalidSetting
        If the server cannot listen there.
    """

    def __init__(
        self, pages: Callable[[Executor], Mapping[str, PageBuilder]], *, host: str, port: int
    ) -> None:
        self._socket = _open_listening_socket(host, port)
        port = self._socket.getsockname()[1]
        self.token = None if is_loopback(host) else secrets.token_urlsafe(32)
        shown_host = f"[{host}]" if ":" in host else host
        self.address = f"http://{shown_host}:{port}/" + (
            f"?token={self.token}" if self.token else ""
        )
        self._access = AccessControl(host, port, self.token)
        self._worker = ThreadPoolExecutor(1, thread_name_prefix="studio")
        self._pages = pages(self._worker)

    async def serve(self, stop_event: asyncio.Event) -> None:
        """Serve requests until the event is set."""
        use_compiled_kernels()
        sys.setswitchinterval(_SWITCH_INTERVAL_S)
        asyncio.get_running_loop().set_default_executor(_CallingThread())
        settings.resources = "server"  # overrides the environment: no external resources
        settings.compression_level = 0  # compressing arrays would take longer than sending them
        pages = {path: Application(FunctionHandler(make)) for path, make in self._pages.items()}
        app = _GuardedBokeh(self._access, pages)
        http = HTTPServer(app, max_body_size=MAX_MESSAGE_BYTES, max_header_size=2**16)
        http.add_socket(self._socket)
        server = BaseServer(IOLoop.current(), app, http)
        server.start()
        try:
            await stop_event.wait()
        finally:
            server.stop()
            await http.close_all_connections()
            self._worker.shutdown(wait=False, cancel_futures=True)


def _open_listening_socket(host: str, port: int) -> socket.socket:
    """Return a socket that listens at an address."""
    family = socket.AF_INET6 if ":" in host else socket.AF_INET
    try:
        host.encode("idna")  # an invalid name would make the socket fail differently and stay open
        listener = socket.create_server((host, port), family=family)
    except (OSError, ValueError) as error:
        if getattr(error, "errno", None) == EADDRINUSE:
            raise InvalidSetting(
                "--port",
                value=f"{port}, which another program uses",
                expected="a free port",
                fix=f"choose another one, such as --port {port + 1}, or 0 for a free one",
            ) from None
        reason, _, _ = (getattr(error, "strerror", None) or str(error)).partition(" (")
        raise InvalidSetting(
            "--host",
            value=f"{host}, port {port}: {reason}",
            expected="an address of this machine and a permitted port",
            fix="omit it for 127.0.0.1; ports below 1024 often need administrator rights",
        ) from None
    listener.setblocking(False)
    return listener


class _GuardedBokeh(BokehTornado):
    """Bokeh server with access control and a limit on pages."""

    def __init__(self, access: AccessControl, pages: Mapping[str, Application]) -> None:
        super().__init__(
            pages,
            extra_websocket_origins=sorted(access.allowed_hosts),
            extra_patterns=[("/healthz", _HealthHandler)],
            use_index=False,
            sign_sessions=True,
            secret_key=secrets.token_bytes(32),
            include_headers=[],
            include_cookies=[],
            websocket_max_message_size_bytes=MAX_MESSAGE_BYTES,
            check_unused_sessions_milliseconds=1000,
            unused_session_lifetime_milliseconds=UNUSED_LIFETIME_MS,
            ico_path="none",
        )
        self._access = access
        self.add_transform(SecurityHeaders)

    def resources(self, absolute_url: str | bool | None = None) -> Resources:
        """Return the scripts that the pages use: the others are as long again."""
        return super().resources(absolute_url).clone(components=list(_SCRIPTS))

    def new_connection(self, *arguments: Any) -> BatchingConnection:
        connection = BatchingConnection(*arguments)
        self._clients.add(connection)
        return connection

    def find_handler(self, request: HTTPServerRequest, **_: Any) -> HTTPMessageDelegate:
        if self._access.has_valid_token_in_url(request):
            return self.get_handler_delegate(
                request, _TokenCookieRedirectHandler, {"cookie": self._access.cookie}
            )
        route = super().find_handler(request)
        refusal = self._access.find_refusal(request) or self._refusal_of_unavailable_page(
            request, route.handler_class
        )
        if refusal is not None:
            return self.get_handler_delegate(request, _RefusalHandler, {"refusal": refusal})
        return route

    def _refusal_of_unavailable_page(
        self, request: HTTPServerRequest, handler_class: type
    ) -> Refusal | None:
        """Refuse too many pages, closed pages, and Bokeh's handlers for embedding in other sites.

        The handler is checked, not the address: Bokeh serves a page at several addresses.
        """
        sessions = [session for page in self.app_paths for session in self.get_sessions(page)]
        if issubclass(handler_class, AutoloadJsHandler | MetadataHandler):
            return Refusal(404, "Not found.")
        if issubclass(handler_class, DocHandler) and len(sessions) >= MAX_PAGES:
            return Refusal(503, f"{MAX_PAGES} pages are open, the maximum. Close one.")
        if issubclass(handler_class, WSHandler) and _claimed_session_id(request) not in {
            o.id for o in sessions
        }:
            return Refusal(403, "Forbidden: this page was closed. Load it again.")
        return None


def _claimed_session_id(request: HTTPServerRequest) -> str | None:
    """Return the session that a connection claims; None if its token is invalid."""
    token = request.headers.get("Sec-WebSocket-Protocol", "").rpartition(",")[2].strip()
    try:
        return get_session_id(token)
    except Exception:  # the client may send anything
        return None


class _HealthHandler(RequestHandler):
    def get(self) -> None:
        self.set_header("Content-Type", "text/plain")
        self.write("ok\n")


class _RefusalHandler(RequestHandler):
    def initialize(self, refusal: Refusal) -> None:
        self._refusal = refusal

    def prepare(self) -> None:
        self.set_status(self._refusal.status)
        self.set_header("Content-Type", "text/plain; charset=utf-8")
        self.finish(f"{self._refusal.reason}\n")


class _TokenCookieRedirectHandler(RequestHandler):
    """Store the token in a cookie and redirect to the address without it."""

    def initialize(self, cookie: str) -> None:
        self._cookie = cookie

    def get(self) -> None:
        # Lax: after a link in a mail, browsers do not send stricter cookies.
        self.set_cookie(self._cookie, self.get_argument("token"), httponly=True, samesite="Lax")
        self.redirect("/")

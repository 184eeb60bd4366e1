"""Studio server: pages, access control, message limits and shutdown."""

import asyncio
import base64
import json
import os
import re
import signal
import socket
import subprocess
import sys
import threading
import time
from contextlib import contextmanager
from html import unescape
from http.client import HTTPConnection
from urllib.parse import urlsplit

import pytest
from bokeh.document import Document
from bokeh.models import ColumnDataSource, Div
from bokeh.protocol import Protocol
from bokeh.server.session import ServerSession
from tornado.ioloop import IOLoop

from dechirp.cli.main import main
from dechirp.core.errors import InvalidSetting
from dechirp.studio.access_control import allowed_host_headers
from dechirp.studio.browser_events import read_studio_asset_text
from dechirp.studio.server import (
    MAX_MESSAGE_BYTES,
    MAX_PAGES,
    UNUSED_LIFETIME_MS,
    BatchingConnection,
    StudioServer,
)
from nightly import nightly

ACK = b'"msgtype": "ACK"'


def add_small_page(document) -> None:
    """Add one word to a page."""
    document.add_root(Div(text="here"))


def raise_error(document) -> None:
    """Fail like a page with a bug."""
    raise RuntimeError("on purpose")


@contextmanager
def run_server(host: str = "127.0.0.1"):
    """Run a server in a separate thread."""
    pages = {"/": add_small_page, "/lesson": add_small_page, "/broken": raise_error}
    studio = StudioServer(lambda worker: pages, host=host, port=0)
    stop_calls, started = [], threading.Event()

    async def run() -> None:
        stop = asyncio.Event()
        stop_calls.append(lambda: loop.call_soon_threadsafe(stop.set))
        loop = asyncio.get_running_loop()
        loop.call_soon(started.set)
        await studio.serve(stop)

    thread = threading.Thread(target=lambda: asyncio.run(run()))
    thread.start()
    started.wait()
    try:
        yield studio
    finally:
        stop_calls[0]()
        thread.join()


@pytest.fixture
def studio():
    """Run a server that only this machine can reach."""
    with run_server() as server:
        yield server


def send_request(studio: StudioServer, path: str = "/", **headers: str):
    """Send a GET request, and return status, headers and text of the answer."""
    port = urlsplit(studio.address).port
    connection = HTTPConnection("127.0.0.1", port, timeout=20)
    connection.request("GET", path, headers={k.replace("_", "-"): v for k, v in headers.items()})
    answer = connection.getresponse()
    result = answer.status, answer.headers, answer.read().decode()
    connection.close()
    return result


def extract_token(page: str) -> str:
    """Return the Bokeh token of a page, which identifies its session."""
    return re.search(r'"token":"([^"]+)"', unescape(page))[1]


def open_websocket(
    studio: StudioServer, token: str, *, origin: str | None = None, payload: bytes = b""
) -> tuple[int, bytes]:
    """Open a WebSocket with a page token, send a payload, and return status and reply."""
    url = urlsplit(studio.address)
    lines = [
        "GET /ws HTTP/1.1",
        f"Host: {url.netloc}",
        "Connection: Upgrade",
        "Upgrade: websocket",
        "Sec-WebSocket-Version: 13",
        f"Sec-WebSocket-Key: {base64.b64encode(bytes(16)).decode()}",
        f"Sec-WebSocket-Protocol: bokeh, {token}",
        *([] if origin is None else [f"Origin: {origin}"]),
    ]
    with socket.create_connection((url.hostname, url.port), timeout=20) as connection:
        connection.sendall("\r\n".join([*lines, "", ""]).encode() + payload)
        stream = connection.makefile("rb")
        status = int(stream.readline().split()[1])
        while stream.readline().strip():
            pass
        return status, b"".join(iter(stream.read1, b"")) if payload else stream.read1()


# Pages


def test_page_loads_no_external_resources(studio):
    status, headers, text = send_request(studio)

    assert status == 200
    sources = re.findall(r'(?:src|href)="([^"]+)"', text)
    assert sources
    assert all(source.startswith("/static/") for source in sources)
    policy = headers["Content-Security-Policy"]
    assert "default-src 'none'" in policy
    assert not set(":.") & set(policy.replace("data: blob:", ""))  # neither scheme nor host
    assert "unsafe" not in policy.partition("script-src")[2].partition(";")[0]
    assert headers["X-Content-Type-Options"] == "nosniff"
    assert headers["Referrer-Policy"] == "no-referrer"


def test_page_is_not_stored_and_scripts_take_half_of_bokeh(studio):
    _, headers, text = send_request(studio)

    assert headers["Cache-Control"] == "no-store"  # its session ends soon after it is closed
    scripts = re.findall(r'<script [^>]*src="([^"]+)"', text)
    sizes = {path: len(send_request(studio, path)[2].encode()) for path in scripts}
    # All parts of Bokeh 3.9: 3.95 MB; no table of its own, which takes 0.3 MB, 0.5 in Bokeh 3.10.
    assert sum(sizes.values()) < 3_950_000 / 2, sizes


def test_environment_cannot_set_external_resources(studio, monkeypatch):
    monkeypatch.setenv("BOKEH_RESOURCES", "cdn")

    assert "https://" not in send_request(studio)[2]


def test_healthz_returns_ok(studio):
    assert send_request(studio, "/healthz")[::2] == (200, "ok\n")


def test_failing_page_leaves_other_pages_working(studio):
    assert send_request(studio, "/broken")[0] == 500
    assert send_request(studio, "/healthz")[0] == 200
    status, first = open_websocket(studio, extract_token(send_request(studio)[2]))
    assert status == 101
    assert ACK in first


def test_page_limit_returns_503_and_keeps_server_running(studio):
    statuses = [send_request(studio, path)[0] for path in ["/", "/lesson/"] * (MAX_PAGES // 2)]
    status, _, text = send_request(studio)

    assert statuses == [200] * MAX_PAGES
    assert [send_request(studio, path)[0] for path in ("/lesson", "/lesson/")] == [503, 503]
    assert (status, text) == (503, f"{MAX_PAGES} pages are open, the maximum. Close one.\n")
    assert send_request(studio, "/healthz")[0] == 200


def test_slow_browser_finds_its_session_until_it_loads_the_page_again():
    wait_ms = re.search(r"CONNECT_MS = ([\d_]+)", read_studio_asset_text("connection.js"))[1]
    # Sessions are checked every second, from when the page is built, before its browser waits.
    assert 1.25 * int(wait_ms) <= UNUSED_LIFETIME_MS


@nightly
def test_closed_page_makes_room_within_seconds(studio):
    pages = [send_request(studio)[2] for _ in range(MAX_PAGES)]
    assert send_request(studio)[0] == 503
    assert open_websocket(studio, extract_token(pages[0]))[0] == 101  # and closes it
    give_up = time.monotonic() + 8
    while send_request(studio)[0] != 200:
        assert time.monotonic() < give_up
        time.sleep(0.1)
    assert open_websocket(studio, extract_token(pages[1]))[0] == 101  # it has not connected yet


def test_simultaneous_changes_are_sent_as_one_message():
    document, messages = Document(), []
    sources = [ColumnDataSource(data={"x": [0]}) for _ in range(3)]
    for source in sources:
        document.add_root(source)

    class Browser:
        async def send_message(self, message) -> None:
            messages.append(message.content["events"])

    def change() -> None:
        for number, source in enumerate(sources):
            source.data = {"x": [number]}

    async def apply_changes() -> None:
        session = ServerSession("one", document, io_loop=IOLoop.current())
        BatchingConnection(Protocol(), Browser(), None, session)
        for _ in range(2):
            await session.with_document_locked(change)

    asyncio.run(apply_changes())

    assert [len(events) for events in messages] == [3, 3]
    assert [event["model"]["id"] for event in messages[0]] == [source.id for source in sources]


# Access control


@pytest.mark.parametrize("path", ["/", "/ws", "/healthz", "/static/js/bokeh.min.js"])
@pytest.mark.parametrize("host", ["evil.example", "127.0.0.1", "127.0.0.1:1", "localhost.evil:80"])
def test_rejects_requests_with_foreign_host_header(studio, path, host):
    assert send_request(studio, path, Host=host)[0] == 403


def test_host_names_are_case_insensitive(studio):
    assert send_request(studio, Host=f"LocalHost:{urlsplit(studio.address).port}")[0] == 200
    assert allowed_host_headers("Radar.Example", 5006) >= {"radar.example:5006"}


@pytest.mark.parametrize("name", ["127.0.0.1", "localhost", "[::1]"])
def test_accepts_every_loopback_host_name(studio, name):
    assert send_request(studio, Host=f"{name}:{urlsplit(studio.address).port}")[0] == 200


@pytest.mark.parametrize(
    "origin", ["http://evil.example", "null", "http://127.0.0.1:1", "http://[", ""]
)
def test_rejects_websocket_with_foreign_origin(studio, origin):
    token = extract_token(send_request(studio)[2])

    assert open_websocket(studio, token, origin=origin)[0] == 403
    assert open_websocket(studio, token, origin=studio.address.rstrip("/"))[0] == 101


def test_token_connects_only_to_its_own_session(studio):
    token = extract_token(send_request(studio)[2])
    with run_server() as other_studio:
        assert open_websocket(other_studio, token)[0] == 403

    # The token of the same page with a wrong signature.
    forged = f"{token.partition('.')[0]}.{base64.urlsafe_b64encode(bytes(32)).decode().rstrip('=')}"
    assert ACK not in open_websocket(studio, forged)[1]
    assert ACK in open_websocket(studio, token)[1]


def test_foreign_site_may_link_but_not_embed(studio):
    by_link = {"Sec_Fetch_Site": "cross-site", "Sec_Fetch_Dest": "document"}
    in_frame = {"Sec_Fetch_Site": "cross-site", "Sec_Fetch_Dest": "iframe"}

    assert send_request(studio, **by_link)[0] == 200
    assert send_request(studio, **in_frame)[0] == 403
    for path in ("/autoload.js", "/autoload-js", "/lesson/autoload.js", "/metadata"):
        assert send_request(studio, f"{path}?bokeh-autoload-element=1")[0] == 404


def test_oversized_message_closes_only_its_connection(studio):
    token = extract_token(send_request(studio)[2])

    # Header of a browser text frame, masked with zeros; the length alone exceeds the limit.
    payload = b"\x81\xff" + (MAX_MESSAGE_BYTES + 1).to_bytes(8, "big") + bytes(4)
    status, reply = open_websocket(studio, token, payload=payload)

    assert status == 101
    assert reply.endswith(b"message too big")
    assert send_request(studio, "/healthz")[0] == 200


def test_requests_on_network_require_token():
    with run_server("0.0.0.0") as studio:
        entrance = urlsplit(studio.address)
        host = f"127.0.0.1:{entrance.port}"

        for path in ("/", "/ws", "/healthz", "/static/js/bokeh.min.js", "/?token=", "/?token=no"):
            assert send_request(studio, path, Host=host)[0] == 403
        status, headers, _ = send_request(studio, f"/?{entrance.query}", Host=host)
        assert (status, headers["Location"]) == (302, "/")
        cookie = headers["Set-Cookie"]
        assert "HttpOnly" in cookie
        assert "SameSite=Lax" in cookie
        assert send_request(studio, Host=host, Cookie=cookie.partition(";")[0])[0] == 200
        assert send_request(studio, Host=host, Cookie=cookie.partition(";")[0][:-1])[0] == 403
        bearer = f"Bearer {studio.token}"
        assert send_request(studio, "/healthz", Host=host, Authorization=bearer)[0] == 200


def test_each_server_has_its_own_token():
    tokens = set()
    for _ in range(2):
        with run_server("0.0.0.0") as studio:
            tokens.add(studio.token)

    assert len(tokens) == 2
    assert all(len(base64.urlsafe_b64decode(token + "=")) == 32 for token in tokens)


# Command line


def test_refuses_traffic_without_a_vehicle_for_the_radar(tmp_path, monkeypatch, capsys):
    monkeypatch.setattr("dechirp.cli.commands.studio._serve_until_signal", lambda *_: None)
    path = tmp_path / "trace.csv"
    steps = ["0,7,car,0,0,0,4.5,1.8,1.5", "1,7,car,5,0,0,4.5,1.8,1.5"]
    rows = ["time,id,class,x,y,heading,length,width,height", *steps]
    path.write_text("\n".join(rows) + "\n", encoding="utf-8")

    for changes in ([], ["--set", "traffic.ego=9"]):
        with pytest.raises(SystemExit) as exit_info:
            main(["studio", "--port", "0", "--scenario", str(path), *changes])
        assert exit_info.value.code == 2
        assert "most time in the trace have car-7 (2 steps)" in capsys.readouterr().err


def test_rejects_port_in_use(studio, capsys):
    port = urlsplit(studio.address).port
    with pytest.raises(SystemExit) as exit_info:
        main(["studio", "--port", str(port)])

    assert exit_info.value.code == 2
    assert capsys.readouterr().err == (
        f"--port: {port}, which another program uses; expected a free port;"
        f" choose another one, such as --port {port + 1}, or 0 for a free one\n"
    )


def test_rejects_address_of_other_machine():
    with pytest.raises(InvalidSetting, match="--host: 192.0.2.1.*address of this machine"):
        StudioServer(lambda worker: {}, host="192.0.2.1", port=0)


@pytest.mark.parametrize("arguments", [["nowhere"], ["--port", "70000"], ["--port", "http"]])
def test_rejects_invalid_calls_before_serving(arguments, capsys):
    with pytest.raises(SystemExit) as exit_info:
        main(["studio", *arguments])

    assert exit_info.value.code == 2
    assert "; expected " in capsys.readouterr().err


@nightly  # the browser tests start a server too
@pytest.mark.parametrize("signal_number", [signal.SIGINT, signal.SIGTERM])
def test_sigint_and_sigterm_exit_cleanly_and_release_port(signal_number):
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(path for path in sys.path if path)}
    process = subprocess.Popen(
        [sys.executable, "-m", "dechirp", "studio", "--port", "0", "--json"],
        env=environment,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )
    document = json.loads(process.stdout.readline())
    address = urlsplit(document["address"])
    assert document["token"] is None
    connection = HTTPConnection(address.hostname, address.port, timeout=60)
    connection.request("GET", "/")  # an open page whose browser never connects
    assert connection.getresponse().read()
    connection.close()

    process.send_signal(signal_number)
    out, err = process.communicate(timeout=60)

    assert (process.returncode, out, err) == (0, "", "")
    socket.create_server((address.hostname, address.port)).close()

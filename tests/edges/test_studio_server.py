"""The server of the studio: who is let in, how many, and what one that breaks does to others."""

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
from dechirp.studio.access_control import allowed_hosts
from dechirp.studio.connection import BatchingConnection
from dechirp.studio.server import MAX_MESSAGE_BYTES, MAX_PAGES, StudioServer

ACK = b'"msgtype": "ACK"'


def small(document) -> None:
    """Fill a page with a word."""
    document.add_root(Div(text="here"))


def broken(document) -> None:
    """Fail, as a page with a mistake does."""
    raise RuntimeError("on purpose")


@contextmanager
def served(host: str = "127.0.0.1"):
    """Run a server in a thread of its own."""
    pages = {"/": small, "/lesson": small, "/broken": broken}
    studio = StudioServer(lambda worker: pages, host=host, port=0)
    stopped, began = [], threading.Event()

    async def run() -> None:
        stop = asyncio.Event()
        stopped.append(lambda: loop.call_soon_threadsafe(stop.set))
        loop = asyncio.get_running_loop()
        loop.call_soon(began.set)
        await studio.serve(stop)

    thread = threading.Thread(target=lambda: asyncio.run(run()))
    thread.start()
    began.wait()
    try:
        yield studio
    finally:
        stopped[0]()
        thread.join()


@pytest.fixture
def studio():
    """Give a server that only this machine reaches."""
    with served() as one:
        yield one


def asked(studio: StudioServer, path: str = "/", **headers: str):
    """Ask for something: status, headers and text of the answer."""
    port = urlsplit(studio.address).port
    connection = HTTPConnection("127.0.0.1", port, timeout=20)
    connection.request("GET", path, headers={k.replace("_", "-"): v for k, v in headers.items()})
    answer = connection.getresponse()
    got = answer.status, answer.headers, answer.read().decode()
    connection.close()
    return got


def token_of(page: str) -> str:
    """Token of Bokeh's in a page, by which its connection shows whose it is."""
    return re.search(r'"token":"([^"]+)"', unescape(page))[1]


def connected(
    studio: StudioServer, token: str, *, origin: str | None = None, says: bytes = b""
) -> tuple[int, bytes]:
    """Connect as the page of a token does, and say something: status, and what comes back."""
    place = urlsplit(studio.address)
    lines = [
        "GET /ws HTTP/1.1",
        f"Host: {place.netloc}",
        "Connection: Upgrade",
        "Upgrade: websocket",
        "Sec-WebSocket-Version: 13",
        f"Sec-WebSocket-Key: {base64.b64encode(bytes(16)).decode()}",
        f"Sec-WebSocket-Protocol: bokeh, {token}",
        *([] if origin is None else [f"Origin: {origin}"]),
    ]
    with socket.create_connection((place.hostname, place.port), timeout=20) as there:
        there.sendall("\r\n".join([*lines, "", ""]).encode() + says)
        stream = there.makefile("rb")
        status = int(stream.readline().split()[1])
        while stream.readline().strip():
            pass
        return status, b"".join(iter(stream.read1, b"")) if says else stream.read1()


# What is served


def test_a_page_asks_for_nothing_outside(studio):
    status, headers, text = asked(studio)

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


def test_resources_are_the_servers_own_whatever_the_environment_says(studio, monkeypatch):
    monkeypatch.setenv("BOKEH_RESOURCES", "cdn")

    assert "https://" not in asked(studio)[2]


def test_healthz_says_that_it_serves(studio):
    assert asked(studio, "/healthz")[::2] == (200, "ok\n")


def test_a_page_that_breaks_leaves_the_others(studio):
    assert asked(studio, "/broken")[0] == 500
    assert asked(studio, "/healthz")[0] == 200
    status, first = connected(studio, token_of(asked(studio)[2]))
    assert status == 101
    assert ACK in first


def test_no_more_pages_than_may_be_and_the_rest_goes_on(studio):
    statuses = [asked(studio, path)[0] for path in ["/", "/lesson/"] * (MAX_PAGES // 2)]
    status, _, text = asked(studio)

    assert statuses == [200] * MAX_PAGES
    assert [asked(studio, path)[0] for path in ("/lesson", "/lesson/")] == [503, 503]
    assert (status, text) == (503, f"{MAX_PAGES} pages are open, the maximum. Close one.\n")
    assert asked(studio, "/healthz")[0] == 200


def test_what_changed_together_goes_as_one_message():
    document, sent = Document(), []
    sources = [ColumnDataSource(data={"x": [0]}) for _ in range(3)]
    for source in sources:
        document.add_root(source)

    class Browser:
        async def send_message(self, message) -> None:
            sent.append(message.content["events"])

    def change() -> None:
        for number, source in enumerate(sources):
            source.data = {"x": [number]}

    async def turns() -> None:
        session = ServerSession("one", document, io_loop=IOLoop.current())
        BatchingConnection(Protocol(), Browser(), None, session)
        for _ in range(2):
            await session.with_document_locked(change)

    asyncio.run(turns())

    assert [len(events) for events in sent] == [3, 3]
    assert [event["model"]["id"] for event in sent[0]] == [source.id for source in sources]


# Who is let in


@pytest.mark.parametrize("path", ["/", "/ws", "/healthz", "/static/js/bokeh.min.js"])
@pytest.mark.parametrize("host", ["evil.example", "127.0.0.1", "127.0.0.1:1", "localhost.evil:80"])
def test_a_server_that_is_asked_for_under_a_foreign_name_refuses(studio, path, host):
    assert asked(studio, path, Host=host)[0] == 403


def test_names_are_the_same_in_capitals(studio):
    assert asked(studio, Host=f"LocalHost:{urlsplit(studio.address).port}")[0] == 200
    assert allowed_hosts("Radar.Example", 5006) >= {"radar.example:5006"}


@pytest.mark.parametrize("name", ["127.0.0.1", "localhost", "[::1]"])
def test_every_name_of_this_machine_for_itself_will_do(studio, name):
    assert asked(studio, Host=f"{name}:{urlsplit(studio.address).port}")[0] == 200


@pytest.mark.parametrize(
    "origin", ["http://evil.example", "null", "http://127.0.0.1:1", "http://[", ""]
)
def test_the_page_of_another_site_does_not_connect(studio, origin):
    token = token_of(asked(studio)[2])

    assert connected(studio, token, origin=origin)[0] == 403
    assert connected(studio, token, origin=studio.address.rstrip("/"))[0] == 101


def test_a_page_connects_to_its_own_session_and_makes_no_other(studio):
    token = token_of(asked(studio)[2])
    with served() as other:
        assert connected(other, token)[0] == 403

    # Of that very page, but signed by somebody else.
    forged = f"{token.partition('.')[0]}.{base64.urlsafe_b64encode(bytes(32)).decode().rstrip('=')}"
    assert ACK not in connected(studio, forged)[1]
    assert ACK in connected(studio, token)[1]


def test_another_site_may_link_here_and_not_embed(studio):
    by_link = {"Sec_Fetch_Site": "cross-site", "Sec_Fetch_Dest": "document"}
    in_frame = {"Sec_Fetch_Site": "cross-site", "Sec_Fetch_Dest": "iframe"}

    assert asked(studio, **by_link)[0] == 200
    assert asked(studio, **in_frame)[0] == 403
    for path in ("/autoload.js", "/autoload-js", "/lesson/autoload.js", "/metadata"):
        assert asked(studio, f"{path}?bokeh-autoload-element=1")[0] == 404


def test_a_message_longer_than_any_of_ours_ends_its_connection_alone(studio):
    token = token_of(asked(studio)[2])

    # A text frame from a browser, masked with zeros, of which the length is enough.
    says = b"\x81\xff" + (MAX_MESSAGE_BYTES + 1).to_bytes(8, "big") + bytes(4)
    status, said = connected(studio, token, says=says)

    assert status == 101
    assert said.endswith(b"message too big")
    assert asked(studio, "/healthz")[0] == 200


def test_on_a_network_every_request_needs_the_token():
    with served("0.0.0.0") as studio:
        entrance = urlsplit(studio.address)
        host = f"127.0.0.1:{entrance.port}"

        for path in ("/", "/ws", "/healthz", "/static/js/bokeh.min.js", "/?token=", "/?token=no"):
            assert asked(studio, path, Host=host)[0] == 403
        status, headers, _ = asked(studio, f"/?{entrance.query}", Host=host)
        assert (status, headers["Location"]) == (302, "/")
        cookie = headers["Set-Cookie"]
        assert "HttpOnly" in cookie
        assert "SameSite=Lax" in cookie
        assert asked(studio, Host=host, Cookie=cookie.partition(";")[0])[0] == 200
        assert asked(studio, Host=host, Cookie=cookie.partition(";")[0][:-1])[0] == 403
        bearer = f"Bearer {studio.token}"
        assert asked(studio, "/healthz", Host=host, Authorization=bearer)[0] == 200


def test_a_token_is_of_one_server():
    tokens = set()
    for _ in range(2):
        with served("0.0.0.0") as studio:
            tokens.add(studio.token)

    assert len(tokens) == 2
    assert all(len(base64.urlsafe_b64decode(token + "=")) == 32 for token in tokens)


# The command


def test_a_port_that_is_taken_is_refused_in_a_sentence(studio, capsys):
    port = urlsplit(studio.address).port
    with pytest.raises(SystemExit) as ended:
        main(["studio", "--port", str(port)])

    assert ended.value.code == 2
    assert capsys.readouterr().err == (
        f"--port: {port}, which another program uses; expected a free port;"
        f" choose another one, as --port {port + 1}, or 0 for a free one\n"
    )


def test_an_address_of_another_machine_is_refused():
    with pytest.raises(InvalidSetting, match="--host: 192.0.2.1.*address of this machine"):
        StudioServer(lambda worker: {}, host="192.0.2.1", port=0)


@pytest.mark.parametrize("words", [["nowhere"], ["--port", "70000"], ["--port", "http"]])
def test_a_wrong_call_is_refused_before_anything_is_served(words, capsys):
    with pytest.raises(SystemExit) as ended:
        main(["studio", *words])

    assert ended.value.code == 2
    assert "; expected " in capsys.readouterr().err


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_ctrl_c_and_sigterm_end_it_well_and_free_the_port(number):
    paths = {**os.environ, "PYTHONPATH": os.pathsep.join(path for path in sys.path if path)}
    process = subprocess.Popen(
        [sys.executable, "-m", "dechirp", "studio", "--port", "0", "--json"],
        env=paths,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )
    started = json.loads(process.stdout.readline())
    address = urlsplit(started["address"])
    assert started["token"] is None
    connection = HTTPConnection(address.hostname, address.port, timeout=60)
    connection.request("GET", "/")  # a page that is at work, and whose browser never came
    assert connection.getresponse().read()
    connection.close()

    process.send_signal(number)
    out, err = process.communicate(timeout=60)

    assert (process.returncode, out, err) == (0, "", "")
    socket.create_server((address.hostname, address.port)).close()

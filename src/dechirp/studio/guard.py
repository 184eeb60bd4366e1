"""Who may talk to the server: under its own names, from its own pages, with its token.

A page of a foreign site cannot read what the server answers, but could ask; and a name of theirs
that leads to this machine would make it look like their own. So both names are checked: the one
that was asked for, and the one of the page that asks.
"""

import re
import socket
from base64 import b64encode
from dataclasses import dataclass
from hashlib import sha256
from hmac import compare_digest
from ipaddress import ip_address
from urllib.parse import urlsplit

import psutil
from tornado.httputil import HTTPHeaders, HTTPServerRequest
from tornado.web import OutputTransform

_LOOPBACK = ("127.0.0.1", "localhost", "::1")
_SCRIPT = re.compile(rb"<script(?![^>]*\ssrc=)[^>]*>(.*?)</script>", re.DOTALL)
# Bokeh puts styles into the elements that it makes. Callbacks in JavaScript would need eval.
_POLICY = (
    "default-src 'none'; script-src 'self'{scripts}; style-src 'self'"
    " 'unsafe-inline'; img-src 'self' data: blob:; connect-src 'self'; base-uri 'none';"
    " form-action 'none'; frame-ancestors 'none'"
)


@dataclass(frozen=True)
class Refusal:
    """Why something that was asked for is not given."""

    status: int
    why: str


def is_loopback(host: str) -> bool:
    """Whether only this machine reaches an address."""
    try:
        return ip_address(host).is_loopback
    except ValueError:
        return host == "localhost"


def places(host: str, port: int) -> frozenset[str]:
    """Every `name:port` that leads to a server which listens on an address of this machine."""
    names = {*_LOOPBACK, host.lower()}
    if not is_loopback(host):
        names.add(socket.gethostname().lower())
        for addresses in psutil.net_if_addrs().values():
            inet = (one for one in addresses if one.family in (socket.AF_INET, socket.AF_INET6))
            names.update(one.address.partition("%")[0] for one in inet)
    bare = {f"[{name}]" if ":" in name else name for name in names}
    with_port = {f"{name}:{port}" for name in bare}
    return frozenset(with_port | bare if port == 80 else with_port)


def _place_of(origin: str) -> str | None:
    """`name:port` of the page that asks; None where it is no address."""
    try:
        return urlsplit(origin).netloc.lower()
    except ValueError:
        return None


class Guard:
    """Tells who is refused.

    Parameters
    ----------
    host, port : str, int
        Where the server listens.
    token : str or None
        What every request must bring in a cookie, or as `Authorization: Bearer`; None: nothing.
    """

    def __init__(self, host: str, port: int, token: str | None) -> None:
        self.places, self._token = places(host, port), token
        self.cookie = f"dechirp-studio-{port}"  # cookies of one host go to all its ports

    def refusal(self, request: HTTPServerRequest) -> Refusal | None:
        """Why a request is refused; None: it is not."""
        headers = request.headers
        if request.host.lower() not in self.places:
            return Refusal(403, "Forbidden: this server does not go by that name.")
        origin = headers.get("Origin")
        if origin is not None and _place_of(origin) not in self.places:
            return Refusal(403, "Forbidden: asked for by the page of another site.")
        # Of another site one may come here by a link, not by a frame, a picture or a script.
        foreign = headers.get("Sec-Fetch-Site", "none") in ("cross-site", "same-site")
        if foreign and headers.get("Sec-Fetch-Dest") != "document":
            return Refusal(403, "Forbidden: asked for by the page of another site.")
        if self._token is not None and not self._is_token(self._brought(request)):
            return Refusal(403, "Forbidden: open the address that `dechirp studio` printed.")
        return None

    def enters(self, request: HTTPServerRequest) -> bool:
        """Whether a request has the token in its address, to be put into a cookie."""
        return self._token is not None and self._is_token(request.arguments.get("token", [b""])[-1])

    def _brought(self, request: HTTPServerRequest) -> bytes:
        if self.cookie in request.cookies:
            return request.cookies[self.cookie].value.encode()
        return request.headers.get("Authorization", "").removeprefix("Bearer ").encode()

    def _is_token(self, text: bytes) -> bool:
        return self._token is not None and compare_digest(text, self._token.encode())


class Headers(OutputTransform):
    """Headers of every answer: nothing comes from elsewhere, and no script but the page's own.

    Scripts in a page are allowed by their hashes, so that markup which gets into a page by a name
    in a file runs nothing.
    """

    def transform_first_chunk(
        self, status_code: int, headers: HTTPHeaders, chunk: bytes, finishing: bool
    ) -> tuple[int, HTTPHeaders, bytes]:
        """Add them."""
        scripts = ""
        if headers.get("Content-Type", "").startswith("text/html"):
            digests = {sha256(script).digest() for script in _SCRIPT.findall(chunk)}
            scripts = "".join(sorted(f" 'sha256-{b64encode(one).decode()}'" for one in digests))
        headers["Content-Security-Policy"] = _POLICY.format(scripts=scripts)
        headers["X-Content-Type-Options"] = "nosniff"
        headers["Referrer-Policy"] = "no-referrer"
        headers["Cross-Origin-Resource-Policy"] = "same-origin"
        headers["Cross-Origin-Opener-Policy"] = "same-origin"
        del headers["Server"]
        return status_code, headers, chunk

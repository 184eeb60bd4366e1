"""Access control of the server by host name, origin and token.

A page of another site cannot read the answers of the server, but could send requests, and a
foreign host name that resolves to this machine would make them same-origin. So both the requested
host and the origin of the page are checked.
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
# Bokeh sets inline styles on its elements. JavaScript callbacks would need eval.
_POLICY = (
    "default-src 'none'; script-src 'self'{scripts}; style-src 'self'"
    " 'unsafe-inline'; img-src 'self' data: blob:; connect-src 'self'; base-uri 'none';"
    " form-action 'none'; frame-ancestors 'none'"
)


@dataclass(frozen=True)
class Refusal:
    """Refusal of a request: HTTP status and reason."""

    status: int
    reason: str


def is_loopback(host: str) -> bool:
    """Return True if only this machine can reach an address."""
    try:
        return ip_address(host).is_loopback
    except ValueError:
        return host == "localhost"


def allowed_host_headers(host: str, port: int) -> frozenset[str]:
    """Return every `name:port` of a server that listens on an address of this machine."""
    names = {*_LOOPBACK, host.lower()}
    if not is_loopback(host):
        names.add(socket.gethostname().lower())
        for addresses in psutil.net_if_addrs().values():
            inet = (
                address
                for address in addresses
                if address.family in (socket.AF_INET, socket.AF_INET6)
            )
            names.update(address.address.partition("%")[0] for address in inet)
    host_names = {f"[{name}]" if ":" in name else name for name in names}
    with_port = {f"{name}:{port}" for name in host_names}
    return frozenset(with_port | host_names if port == 80 else with_port)


def _host_and_port_of_origin(origin: str) -> str | None:
    """Return `name:port` of an origin; None if it is not an address."""
    try:
        return urlsplit(origin).netloc.lower()
    except ValueError:
        return None


class AccessControl:
    """Check of requests by host, origin and token.

    Parameters
    ----------
    host, port : str, int
        Address of the server.
    token : str or None
        Token that every request must send in a cookie or as `Authorization: Bearer`; None: no
        token is required.
    """

    def __init__(self, host: str, port: int, token: str | None) -> None:
        self.allowed_hosts, self._token = allowed_host_headers(host, port), token
        self.cookie = f"dechirp-studio-{port}"  # cookies of one host go to all its ports

    def find_refusal(self, request: HTTPServerRequest) -> Refusal | None:
        """Return the refusal of a request; None if it is accepted."""
        headers = request.headers
        if request.host.lower() not in self.allowed_hosts:
            return Refusal(403, "Forbidden: unknown host name.")
        origin = headers.get("Origin")
        if origin is not None and _host_and_port_of_origin(origin) not in self.allowed_hosts:
            return Refusal(403, "Forbidden: request from a page of another site.")
        # Other sites may link here, but not embed the page in a frame, a picture or a script.
        foreign = headers.get("Sec-Fetch-Site", "none") in ("cross-site", "same-site")
        if foreign and headers.get("Sec-Fetch-Dest") != "document":
            return Refusal(403, "Forbidden: request from a page of another site.")
        if self._token is not None and not self._matches_token(
            self._token_from_cookie_or_header(request)
        ):
            return Refusal(403, "Forbidden: open the address that `dechirp studio` printed.")
        return None

    def has_valid_token_in_url(self, request: HTTPServerRequest) -> bool:
        """Return True if the address of a request contains the token, to be stored in a cookie."""
        return self._token is not None and self._matches_token(
            request.arguments.get("token", [b""])[-1]
        )

    def _token_from_cookie_or_header(self, request: HTTPServerRequest) -> bytes:
        if self.cookie in request.cookies:
            return request.cookies[self.cookie].value.encode()
        return request.headers.get("Authorization", "").removeprefix("Bearer ").encode()

    def _matches_token(self, text: bytes) -> bool:
        return self._token is not None and compare_digest(text, self._token.encode())


class SecurityHeaders(OutputTransform):
    """Security headers of every response: no external content, and only the page's own scripts.

    Scripts in a page are allowed by their hashes, so that markup injected by a name in a file
    cannot run.
    """

    def transform_first_chunk(
        self, status_code: int, headers: HTTPHeaders, chunk: bytes, finishing: bool
    ) -> tuple[int, HTTPHeaders, bytes]:
        """Add the headers."""
        scripts = ""
        if headers.get("Content-Type", "").startswith("text/html"):
            digests = {sha256(script).digest() for script in _SCRIPT.findall(chunk)}
            # A page from the cache of the browser would claim a session that has ended.
            headers["Cache-Control"] = "no-store"
            scripts = "".join(
                sorted(f" 'sha256-{b64encode(digest).decode()}'" for digest in digests)
            )
        headers["Content-Security-Policy"] = _POLICY.format(scripts=scripts)
        headers["X-Content-Type-Options"] = "nosniff"
        headers["Referrer-Policy"] = "no-referrer"
        headers["Cross-Origin-Resource-Policy"] = "same-origin"
        headers["Cross-Origin-Opener-Policy"] = "same-origin"
        del headers["Server"]
        return status_code, headers, chunk

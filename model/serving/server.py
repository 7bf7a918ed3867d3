"""HTTP server of the page, for this machine's user alone.

It listens on the loopback interface. Every request needs the secret token of the address that
`pbrnet serve` prints, which other users and other web pages do not know, and a `Host` and `Origin`
of this machine, which a page that rebinds its name's address does not have.
"""

from __future__ import annotations

import hmac
import secrets
import sys
from collections.abc import Callable
from http import HTTPStatus
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from typing import Any
from urllib.parse import parse_qs, urlsplit

from pbrnet.model.serving.gallery import Shot, Shown
from pbrnet.model.serving.worker import Superseded
from pbrnet.pipeline.cli import unexpected
from pbrnet.pipeline.templating import templates
from pbrnet.pipeline.terminal import say, visible
from pbrnet.scenes.checked import build
from pbrnet.scenes.errors import InputError, PbrnetError
from pbrnet.scenes.files import parse_json

ADDRESS = "127.0.0.1"
NAMES = (ADDRESS, "localhost")
MAX_BODY = 4096  # bytes
TOKEN_HEADER = "X-Pbrnet-Token"
_PATIENCE = 30.0  # seconds that a connection may be silent


class PageServer(ThreadingHTTPServer):
    """Server of a page and its pictures; `ask` returns a shot's picture, from any thread."""

    daemon_threads = True

    def __init__(self, port: int, content: dict[str, Any], ask: Callable[[Shot], Shown]) -> None:
        super().__init__((ADDRESS, port), _Handler)
        self.ask, self.token, self.nonce = ask, secrets.token_urlsafe(), secrets.token_urlsafe()
        template = templates("pbrnet.model.serving").get_template("viewer.html")
        page = template.render(content=content, nonce=self.nonce, token_header=TOKEN_HEADER)
        self.page = page.encode()

    @property
    def url(self) -> str:
        """Address of the page, with its token."""
        return f"http://{ADDRESS}:{self.server_port}/?token={self.token}"

    def handle_error(self, request: Any, client_address: Any) -> None:
        """Report a fault in a thread; a browser that has gone is none."""
        error = sys.exception()
        if isinstance(error, Exception) and not isinstance(error, OSError):
            say(*unexpected(error), err=True)


class _Refused(Exception):
    """A request that is not answered: status and a line that says why."""

    def __init__(self, status: HTTPStatus, message: str) -> None:
        super().__init__(message)
        self.status = status


class _Handler(BaseHTTPRequestHandler):
    server: PageServer
    protocol_version = "HTTP/1.1"
    server_version, sys_version = "pbrnet", ""
    timeout = _PATIENCE

    def do_GET(self) -> None:
        """Answer with the page."""
        self._answer(self._page)

    def do_POST(self) -> None:
        """Answer with a picture."""
        self._answer(self._picture)

    def send_error(self, code: int, message: str | None = None, explain: str | None = None) -> None:
        """Send an error as one line of text, and close the connection."""
        known = 405 if code == HTTPStatus.NOT_IMPLEMENTED else code
        line = visible(message or HTTPStatus(known).phrase)[:500]
        self.close_connection = True
        self._send(known, f"{line}\n".encode(), "text/plain; charset=utf-8", Connection="close")

    def log_message(self, format: str, *args: Any) -> None:
        """Print no line for each request."""

    def _answer(self, answer: Callable[[], None]) -> None:
        try:
            self._check_sender()
            answer()
        except _Refused as refused:
            self.send_error(refused.status, str(refused))

    def _check_sender(self) -> None:
        """Refuse requests of other sites, other users and other names of this machine."""
        host, origin = self.headers.get("Host", ""), self.headers.get("Origin")
        if host.rpartition(":")[0] not in NAMES and host not in NAMES:
            raise _Refused(HTTPStatus.FORBIDDEN, f"answers only to {' and '.join(NAMES)}")
        if origin is not None and origin != f"http://{host}":
            raise _Refused(HTTPStatus.FORBIDDEN, "answers only to its own page")
        query = parse_qs(urlsplit(self.path).query).get("token", [""])[0]
        given = self.headers.get(TOKEN_HEADER) or query
        if not hmac.compare_digest(given.encode(), self.server.token.encode()):
            message = "wrong token: open the address that pbrnet serve printed"
            raise _Refused(HTTPStatus.FORBIDDEN, message)

    def _page(self) -> None:
        if urlsplit(self.path).path != "/":
            raise _Refused(HTTPStatus.NOT_FOUND, "no such page")
        self._send(HTTPStatus.OK, self.server.page, "text/html; charset=utf-8")

    def _picture(self) -> None:
        if urlsplit(self.path).path != "/picture":
            raise _Refused(HTTPStatus.NOT_FOUND, "no such page")
        try:
            shot = build(Shot, parse_json(self._body(), "request"), error=InputError)
        except InputError as error:
            raise _Refused(HTTPStatus.BAD_REQUEST, str(error)) from None
        try:
            shown = self.server.ask(shot)
        except Superseded:
            raise _Refused(HTTPStatus.CONFLICT, "a newer request took its place") from None
        except PbrnetError as error:
            raise _Refused(HTTPStatus.UNPROCESSABLE_ENTITY, str(error)) from None
        except Exception as error:
            lines = unexpected(error)
            say(*lines, err=True)
            raise _Refused(HTTPStatus.INTERNAL_SERVER_ERROR, " ".join(lines)) from None
        facts = {"X-Seconds": f"{shown.seconds:.3f}", "X-Distance": f"{shown.distance:.4f}"}
        self._send(HTTPStatus.OK, shown.png, "image/png", **facts)

    def _body(self) -> bytes:
        """Content of a request of at most `MAX_BODY` bytes."""
        length = self.headers.get("Content-Length", "")
        if "Transfer-Encoding" in self.headers or not (length.isascii() and length.isdecimal()):
            raise _Refused(HTTPStatus.LENGTH_REQUIRED, "a Content-Length is required")
        if len(length) > 9 or int(length) > MAX_BODY:
            message = f"more than {MAX_BODY} bytes"
            raise _Refused(HTTPStatus.REQUEST_ENTITY_TOO_LARGE, message)
        return self.rfile.read(int(length))

    def _send(self, status: int, content: bytes, kind: str, **headers: str) -> None:
        nonce = f"'nonce-{self.server.nonce}'"
        policy = (
            f"default-src 'none'; script-src {nonce}; style-src {nonce}; img-src blob:; "
            "connect-src 'self'; base-uri 'none'; form-action 'none'; frame-ancestors 'none'"
        )
        self.send_response(status)
        for name, value in {
            "Content-Type": kind,
            "Content-Length": str(len(content)),
            "Content-Security-Policy": policy,
            "Cross-Origin-Resource-Policy": "same-origin",
            "X-Content-Type-Options": "nosniff",
            "Referrer-Policy": "no-referrer",
            "Cache-Control": "no-store",
            **headers,
        }.items():
            self.send_header(name, value)
        self.end_headers()
        self.wfile.write(content)

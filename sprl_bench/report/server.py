"""A page served while runs go on: one address, nothing else, and only for this machine unless told otherwise."""

from __future__ import annotations

import errno
import hashlib
import ipaddress
import logging
import socket
import threading
import time
from collections.abc import Callable
from http import HTTPStatus
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from typing import Final
from urllib.parse import urlsplit

logger = logging.getLogger("sprl_bench")

LOOPBACK: Final = "127.0.0.1"
SECURITY: Final = (
    ("Cache-Control", "no-cache"),
    ("Cross-Origin-Resource-Policy", "same-origin"),
    ("Referrer-Policy", "no-referrer"),
    ("X-Content-Type-Options", "nosniff"),
    ("X-Frame-Options", "DENY"),
)


class FreshPage:
    """A page that is made again when someone asks for it, but not more often than every few seconds.

    If that fails, because a file is broken, say, the last page is kept.
    """

    def __init__(self, make: Callable[[], str], every_s: float) -> None:
        self._make, self._every_s = make, every_s
        self._lock = threading.Lock()
        self._page = make().encode()
        self._made = time.monotonic()

    def read(self) -> bytes:
        """Return the page."""
        with self._lock:
            if time.monotonic() - self._made >= self._every_s:
                self._make_again()
            return self._page

    def _make_again(self) -> None:
        try:
            self._page = self._make().encode()
        except (OSError, ValueError) as error:
            logger.warning("The page is kept as it was: %s", error)
        self._made = time.monotonic()


def make_server(
    make: Callable[[], str], *, host: str = LOOPBACK, port: int = 0, every_s: float = 5
) -> ThreadingHTTPServer:
    """Return a server of one page; the caller calls its `serve_forever`.

    Args:
        make: Returns the page.
        host: The address to listen at.
        port: 0 for a free one.
        every_s: The page is made at most this often.

    Raises:
        OSError: The address is in use or not this machine's; the message says which argument must change.
    """
    page = FreshPage(make, every_s)

    class Handler(_Handler):
        def page(self) -> bytes:
            return page.read()

    try:
        server = ThreadingHTTPServer((host, port), Handler)
    except OSError as error:
        raise OSError(_refusal(host, port, error)) from error
    server.daemon_threads = True
    return server


def _refusal(host: str, port: int, error: OSError) -> str:
    """Return why a server cannot listen, as a sentence."""
    if error.errno == errno.EADDRINUSE:
        return f"port is {port}; it must be free, and another program listens there. 0 takes a free one."
    if error.errno == errno.EACCES:
        return f"port is {port}; it must be one that you may listen at, 1024 or above. 0 takes a free one."
    if error.errno == errno.EADDRNOTAVAIL or isinstance(error, socket.gaierror):
        return f"host is {host!r}; it must be an address of this machine."
    return str(error)


class _Handler(BaseHTTPRequestHandler):
    server_version = "sprl-bench"
    sys_version = ""

    def page(self) -> bytes:
        raise NotImplementedError

    def do_GET(self) -> None:
        """Answer with the page, or with nothing if the browser has it already."""
        self._answer(with_body=True)

    def do_HEAD(self) -> None:
        """Answer with the headers alone."""
        self._answer(with_body=False)

    def _answer(self, *, with_body: bool) -> None:
        if not self._is_for_us():
            self.send_error(HTTPStatus.FORBIDDEN, "Another host's name")
        elif self.path.partition("?")[0] != "/":
            self.send_error(HTTPStatus.NOT_FOUND, "There is only /")
        else:
            self._send(self.page(), with_body=with_body)

    def _send(self, page: bytes, *, with_body: bool) -> None:
        tag = f'"{hashlib.sha256(page).hexdigest()[:16]}"'
        known = self.headers.get("If-None-Match") == tag
        self.send_response(HTTPStatus.NOT_MODIFIED if known else HTTPStatus.OK)
        for name, value in (*SECURITY, ("ETag", tag), ("Content-Type", "text/html; charset=utf-8")):
            self.send_header(name, value)
        self.send_header("Content-Length", str(0 if known else len(page)))
        self.end_headers()
        if with_body and not known:
            self.wfile.write(page)

    def _is_for_us(self) -> bool:
        """Whether the browser asked for this machine: a page elsewhere must not reach us by a name of its own."""
        host = urlsplit(f"//{self.headers.get('Host', '')}").hostname or ""
        return host == "localhost" or _is_address(host)

    def log_message(self, *_: object) -> None:
        """Print nothing: the page asks again and again."""


def _is_address(host: str) -> bool:
    try:
        ipaddress.ip_address(host)
    except ValueError:
        return False
    return True

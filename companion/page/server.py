"""The page's own process: keeps the last minutes, and answers any number of browsers that ask again and again.

A browser asks for what is newer than it has: the server waits for none, and one that leaves costs nothing.
"""

from __future__ import annotations

import os
import socket
import sys
import threading
from collections import deque
from http import HTTPStatus
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from importlib import resources
from typing import IO
from urllib.parse import parse_qs, urlsplit

KEPT = 1500
"""Snapshots: five minutes at five a second."""
_MOST_A_REPLY = 600
"""A browser that comes late starts with the last two minutes, about 0.6 MB."""
_BROWSER_S = 5.0
"""A connection that says nothing for so long is closed; the page asks every 0.2 s."""
_POLICY = (
    "default-src 'none'; script-src 'unsafe-inline'; style-src 'unsafe-inline'; connect-src "
    "'self'; img-src data:"
)


class Store:
    """The newest snapshots as the JSON lines they came as, numbered from 1."""

    def __init__(self) -> None:
        self._lines: deque[bytes] = deque(maxlen=KEPT)
        self._count = 0
        self._lock = threading.Lock()

    def add(self, line: bytes) -> None:
        """Keep one line; the feed writes them whole or not at all."""
        with self._lock:
            self._lines.append(line.strip())
            self._count += 1

    def since(self, number: int) -> bytes:
        """JSON ``{"last": n, "snapshots": [...]}`` with what came after ``number``, the newest 600 at most."""
        with self._lock:
            # A number from the future is one of a page that saw an earlier flight.
            if 0 <= number <= self._count:
                missing = self._count - number
            else:
                missing = self._count
            if missing:
                lines = list(self._lines)[-min(missing, _MOST_A_REPLY) :]
            else:
                lines = []
            return b'{"last":%d,"snapshots":[%s]}' % (self._count, b",".join(lines))


def handler(store: Store) -> type[BaseHTTPRequestHandler]:
    """The request handler of one store."""
    page = resources.files("companion.page").joinpath("page.html").read_bytes()

    class Handler(BaseHTTPRequestHandler):
        """``/`` is the page, ``/snapshots?since=N`` the numbers."""

        protocol_version = "HTTP/1.1"
        timeout = _BROWSER_S

        def do_GET(self) -> None:
            """Answer one request."""
            url = urlsplit(self.path)
            if url.path == "/":
                self._send(page, "text/html; charset=utf-8")
            elif url.path == "/snapshots":
                number = parse_qs(url.query).get("since", ["0"])[0]
                self._send(
                    store.since(int(number) if number.isdecimal() else 0), "application/json"
                )
            elif url.path == "/favicon.ico":
                self._send(b"", "image/x-icon")
            else:
                self.send_error(HTTPStatus.NOT_FOUND)

        def _send(self, body: bytes, kind: str) -> None:
            self.send_response(HTTPStatus.OK)
            self.send_header("Content-Type", kind)
            self.send_header("Content-Length", str(len(body)))
            self.send_header("Cache-Control", "no-store")
            self.send_header("Content-Security-Policy", _POLICY)
            self.end_headers()
            self.wfile.write(body)

        def log_message(self, *_: object) -> None:
            """Say nothing: standard output belongs to the flight program."""

    return Handler


class _Server(ThreadingHTTPServer):
    daemon_threads = True
    # A page must not move in beside another program that holds the port.
    allow_reuse_address = True

    def handle_error(self, *_: object) -> None:
        """Say nothing where a browser leaves in the middle of a reply."""


def serve(host: str, port: int, lines: IO[bytes]) -> int:
    """Serve until ``lines`` ends. Says its address on standard output, or in one line why it cannot."""
    store = Store()
    try:
        server = _Server((host, port), handler(store))
    except (OSError, OverflowError) as error:
        if getattr(error, "errno", None) == 98:
            reason = "the port is taken"
        else:
            reason = str(error)
        print(f"cannot be served ({reason}); name another port", flush=True)
        return 4
    os.nice(10)  # the flight goes first
    if host in ("0.0.0.0", ""):
        shown = socket.gethostname()
    else:
        shown = host
    print(f"http://{shown}:{server.server_address[1]}/", flush=True)
    threading.Thread(target=server.serve_forever, daemon=True).start()
    for line in lines:
        store.add(line)
    server.shutdown()
    return 0


if __name__ == "__main__":  # python -m companion.page.server HOST PORT: snapshots on standard input
    raise SystemExit(serve(sys.argv[1], int(sys.argv[2]), sys.stdin.buffer))

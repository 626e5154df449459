"""Who may ask: pages of this server, and programs of this machine; no other site that is open in the browser."""

from __future__ import annotations

import ipaddress
import socket
from urllib.parse import urlsplit

from starlette.datastructures import Headers, MutableHeaders
from starlette.responses import PlainTextResponse
from starlette.types import ASGIApp, Message, Receive, Scope, Send

_POLICY = (
    "default-src 'none'; script-src 'self'; style-src 'self' 'unsafe-inline'; img-src data:; connect-src 'self'; "
    "frame-src 'self'; form-action 'self'; base-uri 'none'; frame-ancestors 'self'"
)
_HEADERS = {
    "Content-Security-Policy": _POLICY,
    "Cross-Origin-Resource-Policy": "same-origin",
    "X-Content-Type-Options": "nosniff",
    "Referrer-Policy": "same-origin",
    "Cache-Control": "no-store",
}


class Guard:
    """Refuses what comes from another site, and tells the browser that a page of the desk loads nothing from elsewhere.

    A name that an attacker points at this machine (DNS rebinding) is no address and not this machine's name.
    """

    def __init__(self, app: ASGIApp) -> None:
        self._app = app

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """One request."""

        async def send_with_headers(message: Message) -> None:
            if message["type"] == "http.response.start":
                MutableHeaders(scope=message).update(_HEADERS)
            await send(message)

        foreign = scope["type"] == "http" and is_foreign(Headers(scope=scope), scope["method"])
        app = PlainTextResponse("refused: the request comes from another site\n", 403) if foreign else self._app
        await app(scope, receive, send_with_headers)


def is_foreign(headers: Headers, method: str) -> bool:
    """Whether a browser sends the request for another site. Programs such as curl send no ``Origin``."""
    host = headers.get("host", "")
    if not _is_this_machine(urlsplit(f"//{host}").hostname or ""):
        return True
    origin = headers.get("origin")
    if origin is not None and urlsplit(origin).netloc != host:
        return True
    return method not in ("GET", "HEAD") and headers.get("sec-fetch-site", "none") not in ("same-origin", "none")


def _is_this_machine(name: str) -> bool:
    own = socket.gethostname().lower()
    try:
        ipaddress.ip_address(name)
    except ValueError:
        return name in ("localhost", own, f"{own}.local")
    return True

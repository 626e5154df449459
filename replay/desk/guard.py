"""Who may ask: pages of this server, and programs of this machine; no other site that is open in the browser."""

from __future__ import annotations

import ipaddress
import socket
from urllib.parse import urlsplit

from starlette.datastructures import Headers
from starlette.middleware.base import BaseHTTPMiddleware, RequestResponseEndpoint
from starlette.requests import Request
from starlette.responses import PlainTextResponse, Response

from models.common.pages.document import SCRIPT_HASH

_POLICY = (
    f"default-src 'none'; script-src 'self' {SCRIPT_HASH}; style-src 'self' 'unsafe-inline'; img-src data:; "
    "connect-src 'self'; frame-src 'self'; form-action 'self'; base-uri 'none'; frame-ancestors "
    "'self'"
)
_HEADERS = {
    "Content-Security-Policy": _POLICY,
    "Cross-Origin-Resource-Policy": "same-origin",
    "X-Content-Type-Options": "nosniff",
    "Referrer-Policy": "same-origin",
    "Cache-Control": "no-store",
}


class Guard(BaseHTTPMiddleware):
    """Refuses what comes from another site, and tells the browser that a page of the desk loads nothing from elsewhere.

    A name that an attacker points at this machine (DNS rebinding) is no address and not this machine's name.
    """

    async def dispatch(self, request: Request, call_next: RequestResponseEndpoint) -> Response:
        """One request."""
        if is_foreign(request.headers, request.method):
            response: Response = PlainTextResponse(
                "refused: the request comes from another site\n", 403
            )
        else:
            response = await call_next(request)
        response.headers.update(_HEADERS)
        return response


def is_foreign(headers: Headers, method: str) -> bool:
    """Whether a browser sends the request for another site. Programs such as curl send no ``Origin``."""
    host = headers.get("host", "")
    if not _is_this_machine(urlsplit(f"//{host}").hostname or ""):
        return True
    origin = headers.get("origin")
    if origin is not None and urlsplit(origin).netloc != host:
        return True
    return method not in ("GET", "HEAD") and headers.get("sec-fetch-site", "none") not in (
        "same-origin",
        "none",
    )


def _is_this_machine(name: str) -> bool:
    own = socket.gethostname().lower()
    try:
        ipaddress.ip_address(name)
    except ValueError:
        return name in ("localhost", own, f"{own}.local")
    return True

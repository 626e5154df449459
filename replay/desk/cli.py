"""``replay serve``: arguments, and the server around the page."""

from __future__ import annotations

import argparse
import socket
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Any

from companion.page.feed import read_address
from models.common.arguments import INTERRUPTED
from models.common.errors import ConfigError
from models.common.extras import how_to_install

if TYPE_CHECKING:
    from replay.desk.store import Desk

_EPILOG = """exit codes: 0 done; 2 bad arguments, or the port is taken; 130 interrupted. The walk over the page:
docs/desk.md."""


def add_parser(commands: Any) -> None:
    """Register ``serve`` with the subparsers of ``replay``."""
    said = (
        "Serves a page: drop logs onto it, correct the drafted vehicle, read the answer of replay "
        "diagnose."
    )
    p = commands.add_parser(
        "serve",
        help="a page that diagnoses the logs dropped onto it",
        description=said,
        epilog=_EPILOG,
    )
    p.add_argument(
        "address",
        nargs="?",
        default=":8000",
        metavar="[HOST]:PORT",
        help="where (default :8000, this machine only; 0.0.0.0:8000: everybody on the network)",
    )
    p.add_argument(
        "--folder",
        type=Path,
        default=Path("replay-desk"),
        metavar="DIR",
        help="keeps logs and answers; delete it, and nothing is left (default: replay-desk, here)",
    )
    p.add_argument("--quiet", action="store_true", help="do not print the address")
    p.set_defaults(run=run, target_system=None)


def run(a: argparse.Namespace) -> int:
    """Serve until interrupted; UserErrors are reported by the caller."""
    address = read_address(a.address, "replay serve")
    try:
        import_module("uvicorn")
        from replay.desk.store import Desk
    except ModuleNotFoundError as error:
        raise ConfigError(
            f"serve: needs the package {error.name}: {how_to_install('serve')}"
        ) from None

    try:
        listening = socket.create_server(address)
    except OSError as error:
        raise ConfigError(
            f"{a.address}: cannot be served ({error.strerror}); name another"
        ) from None
    # After the port, so that a start that fails leaves no folder.
    with listening:
        _serve(a, listening, Desk.of(a.folder))
    # Nothing else ends it; the interrupt may be spent on the server's own shutdown.
    return INTERRUPTED


def _serve(a: argparse.Namespace, listening: socket.socket, desk: Desk) -> None:
    import uvicorn

    from replay.desk.app import app

    host, port = listening.getsockname()[:2]
    if not a.quiet:
        if host == "0.0.0.0":
            shown = socket.gethostname()
        else:
            shown = host
        print(
            f"http://{shown}:{port}/  (everything stays in {desk.folder}; Ctrl-C ends it)",
            flush=True,
        )
    config = uvicorn.Config(app(desk), log_level="error", timeout_graceful_shutdown=2)
    uvicorn.Server(config).run(sockets=[listening])

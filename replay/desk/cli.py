"""``replay serve``: arguments, and the server around the page."""

from __future__ import annotations

import argparse
import socket
from pathlib import Path
from typing import Any

from companion.page.address import Address, read_address
from models.errors import ConfigError

_EPILOG = """exit codes: 0 done; 2 bad arguments, or the port is taken; 130 interrupted. The walk over the page:
docs/desk.md."""


def add_parser(commands: Any) -> None:
    """Register ``serve`` with the subparsers of ``replay``."""
    p: argparse.ArgumentParser = commands.add_parser(
        "serve", help="a page onto which logs are dropped, and which answers", epilog=_EPILOG,
        description="Serves a page on this machine: drop logs onto it, correct the drafted vehicle, read the answer of "
        "replay diagnose. Works offline; everything stays in one folder.",
    )  # fmt: skip
    p.add_argument(
        "address", nargs="?", default=":8000", metavar="[HOST]:PORT",
        help="where (default :8000, this machine only; 0.0.0.0:8000: everybody on the network)",
    )  # fmt: skip
    p.add_argument(
        "--folder", type=Path, default=Path("replay-desk"), metavar="DIR",
        help="keeps logs and answers; delete it, and nothing is left (default: replay-desk, here)",
    )  # fmt: skip
    p.add_argument("--quiet", action="store_true", help="do not print the address")
    p.set_defaults(run=run, target_system=None)


def run(a: argparse.Namespace) -> int:
    """Serve until interrupted; UserErrors are reported by the caller."""
    address = read_address(a.address, "replay serve")
    try:
        import uvicorn

        from replay.desk.app import app
        from replay.desk.store import Desk
    except ModuleNotFoundError as error:
        raise ConfigError(f"serve: needs the package {error.name}: pip install 'corner-compensator[serve]'") from None

    desk = Desk.of(a.folder)
    listening = _listen(address)
    host, port = listening.getsockname()[:2]
    if not a.quiet:
        shown = socket.gethostname() if host == "0.0.0.0" else host
        print(f"http://{shown}:{port}/  (everything stays in {desk.folder}; Ctrl-C ends it)", flush=True)
    config = uvicorn.Config(app(desk), log_level="error", timeout_graceful_shutdown=2)
    uvicorn.Server(config).run(sockets=[listening])
    return 0


def _listen(address: Address) -> socket.socket:
    try:
        return socket.create_server((address.host, address.port))
    except OSError as error:
        raise ConfigError(f"{address}: cannot be served ({error.strerror}); name another") from None

"""A network of one's own for each flight, so that many fly at a time on fixed ports (Linux)."""

from __future__ import annotations

import fcntl
import os
import socket
import struct
from collections.abc import Sequence

_SIOCSIFFLAGS = 0x8914
_IFF_UP = 1
"""Linux, ``netdevice(7)``."""


def in_own_network(command: Sequence[str]) -> list[str]:
    """The command, started in a network namespace of its own: see ``unshare(1)``."""
    if os.geteuid() == 0:
        return ["unshare", "--net", *command]
    return ["unshare", "--net", "--map-root-user", *command]


def raise_loopback() -> None:
    """In a new namespace 127.0.0.1 is down. Needs no ``ip`` command."""
    request = struct.pack("16sh", b"lo", _IFF_UP)
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sock:
        fcntl.ioctl(sock.fileno(), _SIOCSIFFLAGS, request)

"""A UDP socket that pymavlink opened, read and written without the books that it keeps for every datagram."""

from __future__ import annotations

import socket
from contextlib import suppress
from time import monotonic
from typing import Any

Address = tuple[str, int]
_PEERS = 8
"""Whom a server answers at most: each costs a call for every message that is sent."""
_SILENT_S = 10.0
"""After so long without a word a peer gives its place to another."""


class Datagrams:
    """The socket of a ``mavudp``: a server answers those that it hears, a client its one destination."""

    def __init__(self, connection: Any) -> None:
        self._receive = connection.port.recvfrom
        self._send = connection.port.sendto
        self._destination: Address | None = (
            None if connection.udp_server else connection.destination_addr
        )
        self.peers: tuple[Address, ...] = ()
        """Whom frames go to, by their numbers."""
        self._heard_s: dict[Address, float] = {}

    def recv(self, size: int) -> bytes:
        """One datagram. Raises BlockingIOError where none is waiting."""
        data: bytes
        data, address = self._receive(size)
        if self._destination is None:
            now_s = monotonic()
            if address not in self._heard_s and not self._has_place(now_s):
                return data
            self._heard_s[address] = now_s
            if address not in self.peers:
                self.peers = tuple(sorted(self._heard_s))
        return data

    def _has_place(self, now_s: float) -> bool:
        """Whether one more peer finds a place; where there is none, of one that has long been silent."""
        if len(self._heard_s) < _PEERS:
            return True
        silent = min(self._heard_s, key=self._heard_s.__getitem__)
        if now_s - self._heard_s[silent] < _SILENT_S:
            return False
        del self._heard_s[silent]
        return True

    def write(self, data: bytes) -> None:
        """One datagram to every peer; what the network does not take now is lost, as datagrams are."""
        for address in self.peers or self._looked_up():
            try:
                self._send(data, address)
            except OSError:
                continue

    def _looked_up(self) -> tuple[Address, ...]:
        """The destination by its number: asked for once, as a name server may take seconds."""
        if self._destination is not None:
            host, port = self._destination
            with suppress(OSError):
                self.peers = ((socket.gethostbyname(host), port),)
        return self.peers

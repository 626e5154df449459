"""A UDP socket that pymavlink opened, read and written without the books that it keeps for every datagram."""

from __future__ import annotations

import socket
from contextlib import suppress
from typing import Any

Address = tuple[str, int]


class Datagrams:
    """The socket of a ``mavudp``: a server answers everyone that it has heard, a client its one destination."""

    def __init__(self, connection: Any) -> None:
        self._receive, self._send = connection.port.recvfrom, connection.port.sendto
        self._destination: Address | None = None if connection.udp_server else connection.destination_addr
        self.peers: tuple[Address, ...] = ()
        """Whom frames go to, by their numbers."""
        self._heard: Address | None = None

    def recv(self, size: int) -> bytes:
        """One datagram. Raises BlockingIOError where none is waiting."""
        data: bytes
        data, address = self._receive(size)
        if address != self._heard and self._destination is None:
            self._heard = address
            self.peers = tuple(sorted({*self.peers, address}))
        return data

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

"""``[HOST]:PORT`` of a page that is served."""

from __future__ import annotations

from dataclasses import dataclass

from models.errors import ConfigError


@dataclass(frozen=True)
class Address:
    """Where the page is served."""

    host: str
    port: int

    def __str__(self) -> str:
        return f"{self.host}:{self.port}"


def read_address(text: str, option: str = "--page") -> Address:
    """``:8080`` is this machine only; ``0.0.0.0:8080`` everybody on the network. Raises ConfigError."""
    host, colon, port = text.rpartition(":")
    if not colon or not port.isdigit() or not 0 <= int(port) <= 65535 or ":" in host:
        raise ConfigError(f"{option} {text}: must be [HOST]:PORT, such as :8080 or 0.0.0.0:8080")
    return Address(host or "127.0.0.1", int(port))

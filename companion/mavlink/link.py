"""The one owner of a MAVLink endpoint: opens it, drains it, stamps what arrives, sends. One thread, one loop."""

from __future__ import annotations

import errno
import os
import socket
import time
from collections.abc import Iterator
from contextlib import redirect_stdout, suppress
from pathlib import Path
from typing import Any

from companion.clock import Clock, SystemClock
from companion.last_word import relieve
from companion.mavlink import BAUD, OWN_COMPONENT
from companion.mavlink.datagrams import Datagrams
from companion.mavlink.dialect import mavlink
from companion.mavlink.signing import Signatures
from companion.mavlink.wire_frames import Frame, FrameReader, pack
from models.common.errors import ConfigError, LinkError

_NETWORK = ("udp", "udpin", "udpout", "tcp")
_SYSTEM_UNKNOWN = 1
"""We send as this system until the vehicle's own is heard."""
_RELIEVED_S = 2.0
"""Within so long the second process of a companion that was killed gives the port up, on a busy computer too."""
_AGAIN_S = 0.05
_READ = 65536
"""Bytes of one read: more than a datagram holds, and 0.7 s of a serial port at 921600 baud."""
_READS = 300
"""In a row: somewhat more than a UDP socket of Linux holds by default, and 10 ms of work."""


class Arrivals:
    """Arrival stamps: Unix time at start plus monotonic time since, never backwards, with the link's number in the low
    two bits, as ground stations write them into a .tlog. What is recorded is exactly what was decided upon.
    """

    def __init__(self, clock: Clock | None = None) -> None:
        self.clock = clock or SystemClock()
        self._start_us = int(self.clock.time() * 1e6)
        self._now_ns = self.clock.monotonic_ns
        self._start_ns = self._now_ns()

    def stamp(self, link: int = 0) -> int:
        """Now [us]."""
        return (self._start_us + (self._now_ns() - self._start_ns) // 1000) & ~3 | link

    def now_s(self) -> float:
        """Now [s], since an arbitrary start."""
        return self._now_ns() / 1e9


class Link:
    """An open endpoint. ``number`` 0 is the vehicle, 1 an upstream controller."""

    def __init__(self, connection: Any, endpoint: str, arrivals: Arrivals, number: int = 0) -> None:
        self.endpoint = endpoint
        self.received = self.sent = 0
        self._connection = connection
        self._arrivals = arrivals
        self._number = number
        self._frames = FrameReader()
        self._datagrams = Datagrams(connection) if endpoint.startswith("udp") else None
        transport = self._datagrams or connection
        self._receive = transport.recv
        self._write = transport.write
        self._prints = endpoint.startswith("tcp")  # pymavlink prints its reconnects
        self._serial = endpoint.startswith("/dev/")
        self._unsent = b""
        self.dropped = 0
        """Frames that a full serial port did not take."""
        signing = connection.mav.signing
        self.signatures = Signatures(signing) if signing.secret_key is not None else None

    @property
    def bad(self) -> int:
        """Frames that were dropped: wrong checksum, or not signed as they should be."""
        return self._frames.counts.bad_crc + (
            0 if self.signatures is None else self.signatures.refused
        )

    @property
    def mav(self) -> Any:
        """pymavlink's state of this link: who we are, sequence number, signing."""
        return self._connection.mav

    @property
    def fileno(self) -> int:
        """What select() waits on; -1 while a TCP peer is away."""
        fd = getattr(self._connection, "fd", None)
        if fd is None:
            return -1
        return int(fd)

    def identify(self, system: int, component: int) -> None:
        """Send as this system and component."""
        self.mav.srcSystem = system
        self.mav.srcComponent = component

    def drain(self) -> Iterator[tuple[int, Frame]]:
        """(arrival stamp [us, receiver's clock], frame) of what has arrived, without waiting.

        A neighbour that floods the link must not keep the caller from its other work: the rest comes next time.
        """
        signatures = self.signatures
        feed = self._frames.feed
        for _ in range(_READS):
            if not (data := self._read()):
                return
            stamp = self._arrivals.stamp(self._number)
            for frame in feed(data):
                if signatures is None or signatures.accepts(frame):
                    self.received += 1
                    yield stamp, frame

    def _read(self) -> bytes:
        try:
            if self._prints:
                with redirect_stdout(None):
                    data = self._receive(_READ)
            else:
                data = self._receive(_READ)
        except BlockingIOError:
            return b""
        except OSError as error:
            if error.errno in (
                errno.EAGAIN,
                errno.EWOULDBLOCK,
                errno.ECONNREFUSED,
                errno.ECONNRESET,
                errno.EBADF,
            ):
                return b""
            raise LinkError(
                f"{self.endpoint}: {error.strerror or error}; check the cable or the endpoint"
            ) from None
        except Exception as error:  # pyserial's own: a device that was unplugged
            raise LinkError(
                f"{self.endpoint}: lost ({error}); plug it in again and restart"
            ) from None
        if data:
            return bytes(data)
        return b""

    def send(self, message_id: int, payload: bytes) -> bytes:
        """Send one message; returns the frame for the recorder."""
        mav = self.mav
        signatures = self.signatures
        raw = pack(
            message_id,
            payload,
            mav.srcSystem,
            mav.srcComponent,
            mav.seq,
            signed=signatures is not None,
        )
        if signatures is not None:
            raw = signatures.sign(raw)
        mav.seq = (mav.seq + 1) % 256
        self.forward(raw)
        return raw

    @property
    def peers(self) -> tuple[tuple[str, int], ...]:
        """Addresses of a UDP socket's peers; none for a stream, which needs none."""
        if self._datagrams is None:
            return ()
        return self._datagrams.peers

    def frame(self, message_id: int, payload: bytes) -> bytes:
        """A finished frame that is not sent now, and unsigned."""
        mav = self.mav
        return pack(message_id, payload, mav.srcSystem, mav.srcComponent, mav.seq, signed=False)

    def forward(self, raw: bytes) -> None:
        """Send a frame as it is."""
        try:
            if self._serial and not self._write_now(raw):
                self.dropped += 1
                return
            if not self._serial:
                self._write(raw)
        except OSError as error:
            raise LinkError(f"{self.endpoint}: cannot send ({error.strerror or error})") from None
        self.sent += 1

    def _write_now(self, raw: bytes) -> bool:
        """Give a frame to a serial port without waiting; False where it takes none, or not yet the end of the last one.

        pyserial's own write waits until the port is ready again, which a port that is stuck never is.
        """
        self._unsent = self._unsent[self._taken(self._unsent) :]
        if self._unsent or not (taken := self._taken(raw)):
            return False
        self._unsent = raw[taken:]
        return True

    def _taken(self, data: bytes) -> int:
        """How many bytes the port takes at once."""
        try:
            if data:
                return os.write(self.fileno, data)
            return 0
        except BlockingIOError:
            return 0

    def close(self) -> None:
        """Close the endpoint."""
        self._connection.close()


def open_link(
    endpoint: str,
    arrivals: Arrivals,
    *,
    baud: int = BAUD,
    number: int = 0,
    signing_key: bytes | None = None,
) -> Link:
    """Open a pymavlink endpoint string.

    Raises ConfigError where the string is no endpoint, LinkError where it cannot be opened (port in use, no device).
    """
    relieve(endpoint)
    scheme = _check(endpoint)
    mavutil = _mavutil()
    try:
        with redirect_stdout(None):
            connection = mavutil.mavlink_connection(
                endpoint,
                baud=baud,
                source_system=_SYSTEM_UNKNOWN,
                source_component=OWN_COMPONENT,
                retries=2,
                autoreconnect=True,
            )
    except (OSError, EOFError) as error:
        raise LinkError(f"{endpoint}: cannot be opened: {_reason(error, scheme)}") from None
    except ModuleNotFoundError as error:
        raise LinkError(
            f"{endpoint}: needs the package {error.name}: pip install pyserial"
        ) from None
    except Exception as error:  # pyserial and pymavlink raise their own
        raise LinkError(f"{endpoint}: cannot be opened: {error}") from None
    # Whatever dialect and version pymavlink was started with in this process.
    connection.mav = mavlink.MAVLink(
        connection, srcSystem=_SYSTEM_UNKNOWN, srcComponent=OWN_COMPONENT
    )
    if signing_key is not None:
        connection.setup_signing(signing_key, sign_outgoing=True)
    return Link(connection, endpoint, arrivals, number)


def _mavutil() -> Any:
    """pymavlink's endpoints. Their import reads MAVLINK_DIALECT, fails on names that it does not know, and sets it."""
    before = dict(os.environ)
    os.environ["MAVLINK_DIALECT"] = "ardupilotmega"
    try:
        from pymavlink import mavutil
    finally:
        del os.environ["MAVLINK_DIALECT"]
        os.environ.update(before)
    return mavutil


def _check(endpoint: str) -> str:
    scheme, _, rest = endpoint.partition(":")
    if scheme not in _NETWORK:
        if endpoint.startswith("/dev/") or endpoint.upper().startswith("COM"):
            if endpoint.startswith("/dev/") and not Path(endpoint).exists():
                raise LinkError(f"{endpoint}: cannot be opened: no such device")
            return "serial"
        raise ConfigError(
            f"endpoint '{endpoint}' is not known: use udp:HOST:PORT, udpin:…, udpout:…, tcp:…, "
            "/dev/… or sim:NAME"
        )
    host, _, port = rest.rpartition(":")
    if not host or not port.isdigit() or not 0 < int(port) < 65536:
        raise ConfigError(
            f"endpoint '{endpoint}' needs HOST:PORT after '{scheme}:', such as "
            f"{scheme}:127.0.0.1:14550"
        )
    if scheme in ("udp", "udpin"):
        _await_port(endpoint, host, int(port))
    return scheme


def _await_port(endpoint: str, host: str, port: int) -> None:
    """Until nobody else holds the port: the second process of a companion that was killed keeps it until relieved.

    pymavlink binds with SO_REUSEADDR: two listeners would share the port, each missing what the other gets.
    """
    end_s = time.monotonic() + _RELIEVED_S
    while True:
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
            try:
                probe.bind((host, port))
            except OSError as error:
                if error.errno != errno.EADDRINUSE or time.monotonic() > end_s:
                    said = _reason(error, "udp")
                    raise LinkError(f"{endpoint}: cannot be opened: {said}") from None
            else:
                return
        time.sleep(_AGAIN_S)
        relieve(endpoint)


def _reason(error: OSError | EOFError, scheme: str) -> str:
    if isinstance(error, PermissionError):
        return "permission denied" + (
            "; add your user to the group dialout" if scheme == "serial" else ""
        )
    number, said = (error.errno, error.strerror) if isinstance(error, OSError) else (None, None)
    if number == errno.EADDRINUSE:
        return "the port is in use by another program; stop it or choose another port"
    if number == errno.ECONNREFUSED:
        return "connection refused; is the autopilot or router listening there?"
    return said or str(error) or type(error).__name__


def read_signing_key(path: Path) -> bytes:
    """The 32-byte MAVLink 2 signing key in ``path``: raw bytes or 64 hexadecimal digits."""
    try:
        content = path.read_bytes()
    except OSError as error:
        raise ConfigError(f"signing key {path}: cannot be read ({error.strerror})") from None
    if len(content) != 32:
        with suppress(ValueError):
            content = bytes.fromhex(content.decode("ascii").strip())
    if len(content) != 32:
        raise ConfigError(f"signing key {path}: must hold 32 bytes or 64 hexadecimal digits")
    return content

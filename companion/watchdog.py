"""Reports to systemd that the flight loop is alive (sd_notify(3)): one datagram to the socket in $NOTIFY_SOCKET.

With WatchdogSec= in the unit, systemd restarts a loop that hangs. Without the variable, as on a terminal, nothing is
sent. The protocol is a line of text a message, so no library is needed.
"""

from __future__ import annotations

import os
import socket
from collections.abc import Mapping


class Watchdog:
    """One service's end of the socket. A socket that does not answer costs nothing: nothing here waits or raises."""

    def __init__(self, environment: Mapping[str, str] | None = None) -> None:
        env = os.environ if environment is None else environment
        address = env.get("NOTIFY_SOCKET", "")
        self._address = "\0" + address[1:] if address.startswith("@") else address
        ours = env.get("WATCHDOG_PID", "") in ("", str(os.getpid()))
        interval_us = env.get("WATCHDOG_USEC", "")
        watched = ours and interval_us.isdigit() and int(interval_us) > 0
        self.period_s = int(interval_us) / 4e6 if watched else float("inf")
        """A quarter of what systemd waits for."""
        self._due_s = float("-inf")
        self._socket: socket.socket | None = None
        if self._address:
            self._socket = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM | socket.SOCK_CLOEXEC)
            self._socket.setblocking(False)

    def ready(self) -> None:
        """The link is open and the loop begins."""
        self._send("READY=1")

    def alive(self, now_s: float) -> None:
        """Call at every pass of the loop; sends when due."""
        if now_s >= self._due_s and self.period_s != float("inf"):
            self._due_s = now_s + self.period_s
            self._send("WATCHDOG=1")

    def status(self, text: str) -> None:
        """What ``systemctl status`` shows."""
        self._send("STATUS=" + text.replace("\n", " "))

    def stopping(self) -> None:
        """The flight ends; give it time to hand over."""
        self._send("STOPPING=1")

    def close(self) -> None:
        """Close the socket."""
        if self._socket is not None:
            self._socket.close()
            self._socket = None

    def _send(self, text: str) -> None:
        if self._socket is None:
            return
        try:
            self._socket.sendto(text.encode(), self._address)
        except OSError:
            return  # systemd is restarting, or its buffer is full: the next beat is soon

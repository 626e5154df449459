"""MAVLink 2 signatures: link id, 48 bits of time in 10 us since 2015, and the start of a SHA-256 over key and frame.

https://mavlink.io/en/guide/message_signing.html. The state (key, time, streams heard) is pymavlink's own, so that
frames which pymavlink encodes and those which ``frames.pack`` encodes count on one clock.
"""

from __future__ import annotations

import hmac
from hashlib import sha256
from typing import Any

from companion.mavlink.wire_frames import SIGNATURE_BYTES, V2, Frame

_NEW_STREAM_US10 = 6_000_000
"""A stream that was not heard before may be one minute behind, in units of 10 us."""


class Signatures:
    """Checks and makes signatures with the state of one link (``MAVLink.signing`` of pymavlink)."""

    def __init__(self, state: Any) -> None:
        self._state = state
        self.refused = 0
        """Frames without a signature, with a wrong one, or sent a second time."""

    def accepts(self, frame: Frame) -> bool:
        """Whether a frame is signed with the key and newer than all of its stream before it."""
        raw = frame.raw
        state = self._state
        if raw[0] != V2 or not raw[2] & 1:
            self.refused += 1
            return False
        stamp = int.from_bytes(raw[-12:-6], "little")
        stream = (raw[-SIGNATURE_BYTES], frame.system, frame.component)
        newest = state.stream_timestamps.get(stream)
        if newest is not None:
            replayed = stamp <= newest
        else:
            replayed = stamp + _NEW_STREAM_US10 < state.timestamp
        if replayed or not hmac.compare_digest(self._digest(raw[:-6]), raw[-6:]):
            self.refused += 1
            return False
        state.stream_timestamps[stream] = stamp
        state.timestamp = max(state.timestamp, stamp)
        return True

    def sign(self, unsigned: bytes) -> bytes:
        """The frame with its signature; its header must announce one (incompatibility flag 1)."""
        state = self._state
        frame: bytes = unsigned + bytes([state.link_id]) + state.timestamp.to_bytes(6, "little")
        state.timestamp += 1
        return frame + self._digest(frame)

    def _digest(self, frame: bytes) -> bytes:
        return sha256(bytes(self._state.secret_key) + frame).digest()[:6]

"""STATUSTEXT of any length: one message up to 50 characters, else the chunks of MAVLink 2, broken between words."""

from __future__ import annotations

import textwrap
from collections.abc import Iterator

from companion.mavlink.outgoing import Message, statustext

_CHUNK = 50
"""Bytes of text in one STATUSTEXT."""


def chunks(text: str) -> list[str]:
    """``text`` in pieces of 50 characters that end between words; all but the last are filled up with spaces.

    Ground stations join the pieces as they are, and take a piece that is not full for the last one.
    """
    whole = textwrap.wrap(" ".join(text.split()), _CHUNK - 1, break_on_hyphens=False) or [""]
    return [*(piece.ljust(_CHUNK) for piece in whole[:-1]), whole[-1]]


def messages(severity: int, text: str, number: int) -> Iterator[Message]:
    """The STATUSTEXT messages of one text. ``number`` 1...65535 tells texts of several chunks apart."""
    plain = text.encode("ascii", "replace").decode("ascii")
    if len(plain) <= _CHUNK:
        yield statustext(severity, plain)
        return
    for place, piece in enumerate(chunks(plain)):
        yield statustext(severity, piece, number, place)

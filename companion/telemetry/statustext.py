"""STATUSTEXT of any length: one message up to 50 characters, else the chunks of MAVLink 2, broken between words."""

from __future__ import annotations

from collections.abc import Iterator

from companion.mavlink.outgoing import Message, statustext

_CHUNK = 50
"""Bytes of text in one STATUSTEXT."""


def chunks(text: str) -> list[str]:
    """``text`` in pieces of 50 characters that end between words; all but the last are filled up with spaces.

    Ground stations join the pieces as they are, and take a piece that is not full for the last one.
    """
    pieces, line = [], ""
    for word in text.split():
        while len(word) > _CHUNK:  # no word of ours is; a path may be
            room = _CHUNK - len(line) - bool(line)
            line, word = f"{line} {word[:room]}".strip(), word[room:]
            pieces.append(line.ljust(_CHUNK))
            line = ""
        # A space after the word that ends a full piece would be lost: such a word goes to the next one.
        if line and len(line) + 1 + len(word) >= _CHUNK:
            pieces.append(line.ljust(_CHUNK))
            line = word
        else:
            line = f"{line} {word}".strip()
    return [*pieces, line]


def messages(severity: int, text: str, number: int) -> Iterator[Message]:
    """The STATUSTEXT messages of one text. ``number`` 1...65535 tells texts of several chunks apart."""
    plain = text.encode("ascii", "replace").decode("ascii")
    if len(plain) <= _CHUNK:
        yield statustext(severity, plain)
        return
    for place, piece in enumerate(chunks(plain)):
        yield statustext(severity, piece, number, place)

"""How far a log has been read, as a bar on stderr; only to a terminal."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from pathlib import Path

from replay.logs.pieces import Piece


def with_progress(path: Path, pieces: Iterable[Piece], what: str, *, quiet: bool) -> Iterator[Piece]:
    """Passes the pieces of a log on; a piece counts when the next one is asked for."""
    from tqdm import tqdm

    size = path.stat().st_size if path.is_file() else 0
    about = f"{path.name}: {what}"
    # disable=None: only to a terminal.
    with tqdm(total=size, unit="B", unit_scale=True, desc=about, disable=True if quiet else None, leave=False) as bar:
        for piece in pieces:
            yield piece
            bar.update(round(piece.share_read * size) - bar.n)

"""One page with the figures of the corner-effect paper, each drawn from our data, beside what the paper says.

``models cfd check --report`` gives figs 5 to 10, ``models compare --report`` figs 14 to 19. With the same folder both
are on one page. The paper's own curves were never published as numbers: its statements are what can be compared.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

from models.errors import ConfigError

PAGE, ENTRIES = "paper.md", "paper.json"
TITLE = "The paper's figures from our data"
PAPER = (
    "Ai, Xu, Xiang, Fan and Zhang 2020, *Modeling of a novel coaxial ducted fan aerial robot combined with corner "
    "environment by using artificial neural network*, Sensors 20(20), 5805"
)


@dataclass(frozen=True)
class Entry:
    """One figure: ``number`` of the first figure of the paper that it redraws, ``image`` a file in the same folder or
    empty."""

    number: int
    title: str
    image: str
    paper: str
    here: str
    verdict: str


def add(directory: Path, entries: Sequence[Entry]) -> Path:
    """Put ``entries`` on the page in ``directory`` beside those that are there; returns the page's path.

    Raises ConfigError where the folder's list of entries cannot be read.
    """
    known = {entry.title: entry for entry in (*_read(directory / ENTRIES), *entries)}
    page = sorted(known.values(), key=lambda entry: (entry.number, entry.title))
    (directory / ENTRIES).write_text(json.dumps([asdict(e) for e in page], indent=1) + "\n", encoding="utf-8")
    parts = [f"# {TITLE}", f"Paper: {PAPER}.", *map(_section, page)]
    (directory / PAGE).write_text("\n\n".join(parts) + "\n", encoding="utf-8")
    return directory / PAGE


def _section(entry: Entry) -> str:
    table = f"| the paper | here | |\n|---|---|---|\n| {entry.paper} | {entry.here} | {entry.verdict} |"
    picture = [f"![{entry.title}]({entry.image})"] if entry.image else []
    return "\n\n".join([f"## {entry.title}", *picture, table])


def _read(path: Path) -> list[Entry]:
    if not path.exists():
        return []
    try:
        return [Entry(**content) for content in json.loads(path.read_text(encoding="utf-8"))]
    except (OSError, ValueError, TypeError) as error:
        raise ConfigError(f"{path}: is not a list of figures ({error}); delete it or use another folder") from None

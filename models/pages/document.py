"""One HTML page for people: dark and light, phone and paper, no script, no outside request."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from html import escape
from pathlib import Path

from models.errors import ConfigError
from models.pages.svg import STYLE

PAGE_STYLE = STYLE + Path(__file__).with_name("page.css").read_text("utf-8")
"""Of every page."""


def document(title: str, parts: Iterable[str]) -> str:
    """The whole page around ``parts``, which are HTML already."""
    return (
        '<!doctype html>\n<html lang="en"><head><meta charset="utf-8">'
        '<meta name="viewport" content="width=device-width,initial-scale=1">'
        f"<title>{escape(title)}</title><style>{PAGE_STYLE}</style></head>\n"
        f"<body>{''.join(parts)}</body></html>\n"
    )


def write_document(option: str, target: Path, text: str) -> Path:
    """Write a page, its folder created. Raises ConfigError, which names the ``option``, where that fails."""
    try:
        target.parent.mkdir(parents=True, exist_ok=True)
        target.write_text(text, encoding="utf-8")
    except OSError as error:
        raise ConfigError(f"{option} {target.parent}: cannot be written ({error.strerror})") from None
    return target


def verdict(head: str, sentences: Sequence[str], *, bad: bool = False) -> str:
    """The first thing on a page: what came out, and what to do next. Plain text."""
    rest = "".join(f"<p>{escape(s)}</p>" for s in sentences)
    return f'<div class="verdict{" bad" if bad else ""}"><b>{escape(head)}</b>{rest}</div>'


def table(head: Sequence[str], rows: Iterable[Sequence[str]], numbers: Iterable[int] = ()) -> str:
    """A table in a box that scrolls sideways. Cells are HTML; columns in ``numbers`` are set flush right."""
    right = set(numbers)

    def row(kind: str, cells: Sequence[str]) -> str:
        marked = [f"<{kind}{' class=n' if i in right else ''}>{c}</{kind}>" for i, c in enumerate(cells)]
        return f"<tr>{''.join(marked)}</tr>"

    body = "".join(row("td", r) for r in rows)
    first = row("th", [escape(h) for h in head]) if any(head) else ""
    return f'<div class="wide"><table>{first}{body}</table></div>' if body else ""

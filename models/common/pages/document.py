"""One HTML page for people: dark and light, phone and paper, no script, no outside request."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from html import escape
from pathlib import Path

from models.common.pages.svg import STYLE
from models.common.text_file import make_folder, write_text

PAGE_STYLE = STYLE + Path(__file__).with_name("page.css").read_text("utf-8")
"""Of every page."""


def document(title: str, parts: Iterable[str]) -> str:
    """The whole page around ``parts``, which are HTML already."""
    return (
        '<!doctype html>\n<html lang="en"><head><meta charset="utf-8">'
        '<meta name="viewport" content="width=device-width,initial-scale=1">'
        f"<title>{escape(title)}</title><style>{PAGE_STYLE}</style></head>\n"
        f"<body><main>{''.join(parts)}</main></body></html>\n"
    )


def write_document(option: str, target: Path, text: str) -> Path:
    """Write a page, its folder created. Raises ConfigError, which names the ``option``, where that fails."""
    make_folder(option, target.parent)
    write_text(option, target, text)
    return target


def verdict(head: str, sentences: Sequence[str]) -> str:
    """The first thing on a page: what came out, and what to do next. Plain text."""
    rest = "".join(f"<p>{escape(s)}</p>" for s in sentences)
    return f'<div class="verdict"><b>{escape(head)}</b>{rest}</div>'

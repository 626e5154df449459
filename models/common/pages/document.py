"""One HTML page for people: dark and light, phone and paper, no outside request.

A script lets plots be zoomed and read. It is the only one that the page allows, by its hash: what a
log or a name holds never runs. Without it the page is complete.
"""

from __future__ import annotations

import base64
import hashlib
from collections.abc import Iterable, Sequence
from html import escape
from pathlib import Path

from models.common.pages.svg import STYLE
from models.common.text_file import make_folder, replaced

_HERE = Path(__file__).parent
PAGE_STYLE = (
    STYLE
    + (_HERE / "uplot" / "uPlot.min.css").read_text("utf-8")
    + (_HERE / "page.css").read_text("utf-8")
)
"""Of every page."""
PLOT_SCRIPT = (_HERE / "uplot" / "uPlot.iife.min.js").read_text("utf-8") + (
    _HERE / "zoom.js"
).read_text("utf-8")
"""uPlot (L. Sorokin, MIT licence, uplot/LICENSE) and what hands it the curves of the page."""
SCRIPT_HASH = f"'sha256-{base64.b64encode(hashlib.sha256(PLOT_SCRIPT.encode()).digest()).decode()}'"
"""Of a Content-Security-Policy that lets this script run and no other."""
PAGE_POLICY = (
    f"default-src 'none'; style-src 'unsafe-inline'; img-src data:; script-src {SCRIPT_HASH}"
)
PAGE_END = f"<script>{PLOT_SCRIPT}</script>"
"""Before the end of a page with plots."""


def document(title: str, parts: Iterable[str]) -> str:
    """The whole page around ``parts``, which are HTML already."""
    return (
        '<!doctype html>\n<html lang="en"><head><meta charset="utf-8">'
        '<meta name="viewport" content="width=device-width,initial-scale=1">'
        f'<meta http-equiv="Content-Security-Policy" content="{PAGE_POLICY}">'
        f"<title>{escape(title)}</title><style>{PAGE_STYLE}</style></head>\n"
        f"<body><main>{''.join(parts)}</main>{PAGE_END}</body></html>\n"
    )


def write_document(option: str, target: Path, text: str) -> Path:
    """Write a page, its folder created: whole, or the old one stays. Raises ConfigError, which names the ``option``."""
    make_folder(option, target.parent)
    with replaced(option, target) as part:
        part.write_text(text, encoding="utf-8")
    return target


def verdict(head: str, sentences: Sequence[str]) -> str:
    """The first thing on a page: what came out, and what to do next. Plain text."""
    rest = "".join(f"<p>{escape(s)}</p>" for s in sentences)
    return f'<div class="verdict"><b>{escape(head)}</b>{rest}</div>'

"""One HTML page for people: dark and light, phone and paper, no script, no outside request."""

from __future__ import annotations

import re
from base64 import b64encode
from collections.abc import Iterable, Sequence
from html import escape
from pathlib import Path

from models.errors import ConfigError
from models.pages.svg import PALETTE, STYLE

_WIDE_PX = 700
"""Images above this width hold several panels."""
_STYLE = """
*{box-sizing:border-box}
body{font:16px/1.5 system-ui,sans-serif;color:var(--ink);background:var(--paper);max-width:64rem;margin:1rem auto;
padding:0 1rem;overflow-wrap:break-word}
h1{font-size:1.5rem;line-height:1.25}h2{font-size:1.2rem;margin:2rem 0 .4rem}h3{font-size:1.05rem;margin:1.2rem 0 .3rem}
.verdict{padding:.7rem 1rem;border-left:.4rem solid var(--mark);background:var(--card);margin:1rem 0}
.verdict b{font-size:1.15rem}.verdict p{margin:.4rem 0 0}.verdict.bad{border-color:var(--bad)}
.dim{color:var(--dim)}td.bad,span.bad{color:var(--bad)}.small{font-size:.8rem;white-space:nowrap}
.wide{overflow-x:auto}table{border-collapse:collapse;margin:.6rem 0;max-width:100%}
th,td{text-align:left;padding:.3rem .6rem;border-bottom:1px solid var(--line);vertical-align:top}
th:first-child,td:first-child{padding-left:0}td.n,th.n{text-align:right;font-variant-numeric:tabular-nums}
.plots{display:grid;gap:.4rem 1.2rem;grid-template-columns:repeat(auto-fit,minmax(min(21rem,100%),1fr))}
figure{margin:.4rem 0;break-inside:avoid}figcaption{font-size:.95rem}
.key{margin-left:.7rem;white-space:nowrap}.keys{font-size:.95rem}.keys .key:first-child{margin-left:0}
.key::before{content:"";display:inline-block;width:.8rem;height:.25rem;margin-right:.3rem;vertical-align:middle;
background:currentColor}.key.band::before{height:.7rem;opacity:.35}
svg{width:100%;max-width:30rem;height:auto;display:block}
details{margin:1rem 0;border-top:1px solid var(--line);padding-top:.5rem}summary{cursor:pointer;font-weight:600}
.full{grid-column:1/-1}.full img{min-width:56rem}
img{width:100%;min-width:26rem;height:auto;background:#fff;border-radius:.3rem}code{font-size:.9em}pre{overflow-x:auto;
background:var(--card);padding:.6rem .8rem}
@media(max-width:30rem){th,td{padding:.3rem .35rem;font-size:.92rem}}
@media print{:root{color-scheme:light;--ink:#000;--dim:#444}body{max-width:none;font-size:11pt;print-color-adjust:exact}
h2,h3{break-after:avoid}table,tr,.verdict{break-inside:avoid}details,ul{break-before:avoid}
.plots{grid-template-columns:1fr 1fr}}
"""


def document(title: str, parts: Iterable[str]) -> str:
    """The whole page around ``parts``, which are HTML already."""
    return (
        '<!doctype html>\n<html lang="en"><head><meta charset="utf-8">'
        '<meta name="viewport" content="width=device-width,initial-scale=1">'
        f"<title>{escape(title)}</title><style>{PALETTE}{_STYLE}{STYLE}</style></head>\n"
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


def pictures(paths: Iterable[Path]) -> str:
    """PNG files inside the page, two beside each other where there is room, wide ones alone; captions are their names.

    Where an image is wider than the screen its box scrolls, so that its text keeps a size that can be read.
    """
    shown = [picture(path, _caption(path.stem)) for path in paths]
    return f'<div class="plots">{"".join(shown)}</div>' if shown else ""


def picture(path: Path, caption: str = "") -> str:
    """One PNG file inside the page."""
    data = path.read_bytes()
    wide = int.from_bytes(data[16:20], "big") > _WIDE_PX
    head = f"<figcaption><b>{escape(caption)}</b></figcaption>" if caption else ""
    image = f'<img alt="{escape(caption or path.stem)}" src="data:image/png;base64,{b64encode(data).decode()}">'
    return f'<figure class="wide{" full" if wide else ""}">{head}{image}</figure>'


def _caption(stem: str) -> str:
    """``fig5_9_lift_ratio`` and ``mesh`` as words; the numbers are the paper's."""
    numbered = re.fullmatch(r"fig(\d+(?:_\d+)*)_(.+)", stem)
    words = stem if numbered is None else numbered[2]
    of_paper = "" if numbered is None else f", as figure {numbered[1].replace('_', ' and ')} of the paper"
    return words.replace("_", " ").capitalize() + of_paper


def folded(summary: str, content: str) -> str:
    """Detail that opens with a click; nothing where there is no content."""
    return f"<details><summary>{escape(summary)}</summary>{content}</details>" if content else ""


def items(lines: Iterable[str]) -> str:
    """A list of plain sentences; nothing where there are none."""
    body = "".join(f"<li>{escape(line)}</li>" for line in lines)
    return f"<ul>{body}</ul>" if body else ""

"""HTML pages of the answers: every command has its template."""

from __future__ import annotations

from typing import Any

from jinja2 import Environment, PackageLoader, StrictUndefined

from models.common.pages.document import PAGE_END, PAGE_POLICY, PAGE_STYLE

_PAGES = Environment(
    loader=PackageLoader("replay"),
    autoescape=True,
    undefined=StrictUndefined,
    trim_blocks=True,
    lstrip_blocks=True,
)


def render(template: str, **content: Any) -> str:
    """One self-contained page. Text in ``content`` is escaped; a template marks what is HTML already."""
    page = {"style": PAGE_STYLE, "policy": PAGE_POLICY, "end": PAGE_END}
    return _PAGES.get_template(template).render(**page, **content)

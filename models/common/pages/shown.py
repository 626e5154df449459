"""A page that a notebook shows, and that can be written to a file."""

from __future__ import annotations

from dataclasses import dataclass, field
from html import escape
from pathlib import Path


@dataclass(frozen=True)
class ShownPage:
    """One self-contained HTML page."""

    html: str = field(repr=False)

    def save(self, file: Path | str) -> Path:
        """Write it."""
        path = Path(file)
        path.write_text(self.html, encoding="utf-8")
        return path

    def _repr_html_(self) -> str:
        # A whole page inside another: its style stays its own.
        style = "width:100%;height:40rem;border:0"
        return (
            f'<iframe title="page" style="{style}" sandbox srcdoc="{escape(self.html)}"></iframe>'
        )

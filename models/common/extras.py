"""What to type where a package of an extra is missing."""

from __future__ import annotations

import json
from pathlib import Path
from urllib.parse import unquote, urlsplit

NAME = "corner-compensator"


def how_to_install(extra: str) -> str:
    """The command that adds an extra."""
    return f"pip install '{_source()}[{extra}]'"


def _source() -> str:
    """The folder or wheel that the program was installed from (PEP 610), where it is still there; else its name."""
    # Imported here: only a program that ends needs it.
    from importlib import metadata

    try:
        said = metadata.distribution(NAME).read_text("direct_url.json")
    except metadata.PackageNotFoundError:
        return NAME
    url = urlsplit(json.loads(said or "{}").get("url", ""))
    path = Path(unquote(url.path))
    if url.scheme == "file" and path.exists():
        return str(path)
    return NAME

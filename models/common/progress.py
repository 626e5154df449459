"""Progress bars for long work: on stderr, only to a terminal, never with --quiet."""

from __future__ import annotations

import sys
from typing import Any


class Bars:
    """Call with (name, done, total); one bar after another, each as its name first appears."""

    def __init__(self, quiet: bool = False) -> None:
        # None: tqdm itself shows bars to a terminal only.
        self._off = True if quiet else None
        self._name = ""
        self._bar: Any = None

    def __call__(self, name: str, done: int, total: int) -> None:
        """Show that ``done`` of ``total`` parts of ``name`` are done."""
        if name != self._name or done < self._bar.n:
            from tqdm import tqdm

            self.close()
            self._name, self._bar = (
                name,
                tqdm(total=total, desc=name, leave=False, file=sys.stderr, disable=self._off),
            )
        self._bar.update(done - self._bar.n)

    def close(self) -> None:
        """Remove the bar that is shown."""
        if self._bar is not None:
            self._bar.close()
            self._name = ""
            self._bar = None

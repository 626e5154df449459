"""What long work says of itself: a bar on a terminal, else a line every half minute, also while one log takes long."""

from __future__ import annotations

import sys
import threading
import time
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import TypeVar

from tqdm import tqdm

T = TypeVar("T")

SAY_EVERY_S = 30.0
"""Between two lines."""


@dataclass(kw_only=True)
class Progress:
    """How far some work is."""

    what: str
    """Is counted."""
    total: int
    done: int = 0
    """Those of an earlier run, too."""
    failed: int = 0
    quiet: bool = False
    now: Callable[[], float] = time.monotonic
    _first: int = field(init=False)
    _start: float = field(init=False)
    _last: float = field(init=False)

    def __post_init__(self) -> None:
        """Work begins."""
        self._first = self.done
        self._start = self._last = self.now()

    def counted(self, items: Iterable[T], failed: Callable[[T], bool]) -> Iterator[T]:
        """The same items."""
        shown = sys.stderr.isatty() and not self.quiet
        bar = tqdm(
            items,
            total=self.total,
            initial=self.done,
            unit=f" {self.what}",
            disable=not shown,
            leave=False,
        )
        with said_often(self.line, silent=shown or self.quiet):
            for item in bar:
                yield item
                self.done += 1
                self.failed += failed(item)
                self._last = self.now()

    def line(self) -> str:
        """For a file that somebody reads later."""
        now = self.now()
        text = f"{self.done} of {self.total} {self.what}"
        if self.failed:
            text += f", {self.failed} failed"
        silent_s = now - self._last
        if silent_s > SAY_EVERY_S:
            text += f", none done for {silent_s / 60.0:.1f} min"
        elif self.done > self._first:
            each_s = (now - self._start) / (self.done - self._first)
            text += f", about {each_s * (self.total - self.done) / 60.0:.0f} min left"
        return text


@dataclass(kw_only=True)
class Step:
    """What a command is at that has no parts to count."""

    text: str
    start_s: float = field(default_factory=time.monotonic)

    def line(self) -> str:
        """For a file that somebody reads later."""
        return f"{self.text}, {(time.monotonic() - self.start_s) / 60.0:.1f} min so far"


@contextmanager
def said_often(line: Callable[[], str], *, silent: bool = False) -> Iterator[None]:
    """Print a line on stderr every half minute, whatever the block does."""
    over = threading.Event()

    def say() -> None:
        while not over.wait(SAY_EVERY_S):
            print(f"replay: {line()}", file=sys.stderr, flush=True)

    if silent:
        yield
        return
    thread = threading.Thread(target=say, daemon=True)
    thread.start()
    try:
        yield
    finally:
        over.set()
        thread.join()

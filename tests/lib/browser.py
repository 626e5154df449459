"""A headless Chromium by its debugging pipe: what a page shows, how wide it is, what it asks for, and pictures of it.

Chrome DevTools Protocol, https://chromedevtools.github.io/devtools-protocol/ (messages end with a zero byte).
"""

from __future__ import annotations

import base64
import json
import os
import shutil
import signal
import subprocess
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType
from typing import Any

CHROMIUM = (
    shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")
)
PHONE = (400, 800)
DESKTOP = (1280, 900)
"""Width and height of the window [px]."""

_FACTS = """({
  text: document.body.innerText,
  width: document.documentElement.scrollWidth,
  smallest: Math.min(...[...document.querySelectorAll('svg text')].filter(e => e.getClientRects().length).map(e => {
    const s = e.ownerSVGElement, scale = s.getBoundingClientRect().width / s.viewBox.baseVal.width;
    return parseFloat(getComputedStyle(e).fontSize) * scale;
  })),
  cut: [...document.querySelectorAll('td,th')].filter(e => e.getClientRects().length &&
    e.getBoundingClientRect().right > document.documentElement.clientWidth + 1 && !e.closest('.wide')).length,
  outside: [...document.querySelectorAll('svg')].flatMap(s => [...s.querySelectorAll('text')].filter(t => {
    const a = t.getBoundingClientRect(), b = s.getBoundingClientRect();
    return b.width && (a.left < b.left - 1 || a.right > b.right + 1);
  }).map(t => t.textContent)),
  paper: getComputedStyle(document.body).backgroundColor,
  ink: getComputedStyle(document.body).color,
})"""


@dataclass(frozen=True)
class Seen:
    """What a browser made of a page."""

    text: str
    width: int
    """Of the whole content [px]: above the window's width the page scrolls sideways."""
    smallest_text_px: float
    """The smallest text in a chart, as shown."""
    cut_cells: int
    """Table cells beyond the window's edge, outside boxes that scroll."""
    outside: tuple[str, ...]
    """Texts that stand out of their chart."""
    paper: str
    ink: str
    console: tuple[str, ...]
    """Errors and warnings."""
    requests: tuple[str, ...]
    """Everything that was asked for besides the page itself."""


def remove(folder: Path, patience_s: float = 20.0) -> None:
    """Delete a folder that a process which was just killed may still write to.

    Raises:
        OSError: files still appear after ``patience_s``.
    """
    end = time.monotonic() + patience_s
    while folder.exists():
        try:
            shutil.rmtree(folder)
        except OSError:
            if time.monotonic() > end:
                raise
            time.sleep(0.05)


class Browser:
    """One Chromium with one page, over file descriptors 3 (to it) and 4 (from it)."""

    def __init__(self) -> None:
        assert CHROMIUM is not None, "no chromium on this machine"
        self._home = Path(tempfile.mkdtemp(prefix="browser"))
        to_read, self._to = os.pipe()
        self._from, to_write = os.pipe()
        options = [
            "--headless", "--no-sandbox", "--disable-gpu", "--disable-background-networking", "--remote-debugging-pipe",
            "--hide-scrollbars", "--disable-dev-shm-usage", f"--user-data-dir={self._home}", "about:blank",
        ]  # fmt: skip

        def descriptors() -> None:
            low = os.dup(to_read)
            high = os.dup(to_write)
            os.dup2(low, 3)
            os.dup2(high, 4)

        self._process = subprocess.Popen(
            [CHROMIUM, *options], stderr=subprocess.DEVNULL, stdout=subprocess.DEVNULL, preexec_fn=descriptors,
            close_fds=False, start_new_session=True,
        )  # fmt: skip
        os.close(to_read)
        os.close(to_write)
        self._rest = b""
        self._number = 0
        self._session = ""
        self._events: list[dict[str, Any]] = []
        target = self.ask("Target.createTarget", url="about:blank")["targetId"]
        self._session = self.ask("Target.attachToTarget", targetId=target, flatten=True)[
            "sessionId"
        ]
        for domain in ("Page", "Runtime", "Network", "Log"):
            self.ask(f"{domain}.enable")

    def __enter__(self) -> Browser:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        at: TracebackType | None,
    ) -> None:
        os.killpg(self._process.pid, signal.SIGKILL)  # its helpers too: they write to its folder
        self._process.wait()
        os.close(self._to)
        os.close(self._from)
        remove(self._home)

    def ask(self, method: str, **parameters: Any) -> dict[str, Any]:
        """Send one command and wait for its answer; events that come before it are kept."""
        self._number += 1
        message: dict[str, Any] = {"id": self._number, "method": method, "params": parameters}
        if self._session:
            message["sessionId"] = self._session
        os.write(self._to, json.dumps(message).encode() + b"\0")
        while (answer := self._next()).get("id") != self._number:
            self._events.append(answer)
        if "error" in answer:
            raise RuntimeError(f"{method}: {answer['error']}")
        result: dict[str, Any] = answer["result"]
        return result

    def _next(self) -> dict[str, Any]:
        while b"\0" not in self._rest:
            part = os.read(self._from, 1 << 20)
            if not part:
                raise RuntimeError("the browser ended")
            self._rest += part
        line, _, self._rest = self._rest.partition(b"\0")
        out: dict[str, Any] = json.loads(line)
        return out

    def open(self, url: str, size: tuple[int, int] = DESKTOP, *, dark: bool = False) -> Seen:
        """Load a page in a window of that size [px] and say what came of it."""
        self._events.clear()
        phone = size[0] < 600
        self.ask(
            "Emulation.setDeviceMetricsOverride",
            width=size[0],
            height=size[1],
            deviceScaleFactor=1,
            mobile=phone,
        )
        scheme = {"name": "prefers-color-scheme", "value": "dark" if dark else "light"}
        self.ask("Emulation.setEmulatedMedia", features=[scheme])
        self.ask("Page.navigate", url=url)
        while not any(e.get("method") == "Page.loadEventFired" for e in self._events):
            self._events.append(self._next())
        facts = self.value(_FACTS)
        requests = [
            e["params"]["request"]["url"]
            for e in self._events
            if e.get("method") == "Network.requestWillBeSent"
        ]
        console = [
            json.dumps(e["params"])
            for e in self._events
            if e.get("method")
            in ("Runtime.consoleAPICalled", "Runtime.exceptionThrown", "Log.entryAdded")
        ]
        smallest = facts["smallest"]
        return Seen(
            facts["text"], facts["width"], float("inf") if smallest is None else smallest, facts["cut"],
            tuple(facts["outside"]), facts["paper"], facts["ink"], tuple(console),
            tuple(r for r in requests if r != url and not r.startswith("data:")),
        )  # fmt: skip

    def value(self, expression: str) -> Any:
        """A JavaScript expression, evaluated in the page; of a promise what it brings."""
        answer = self.ask(
            "Runtime.evaluate", expression=expression, returnByValue=True, awaitPromise=True
        )
        return answer["result"].get("value")

    def picture(self) -> bytes:
        """The whole page as PNG."""
        height = self.value("document.documentElement.scrollHeight")
        width = self.value("document.documentElement.clientWidth")
        clip = {"x": 0, "y": 0, "width": width, "height": min(height, 16_000), "scale": 1}
        shot = self.ask("Page.captureScreenshot", clip=clip, captureBeyondViewport=True)
        return base64.b64decode(shot["data"])

    def print(self) -> bytes:
        """The page as PDF."""
        return base64.b64decode(self.ask("Page.printToPDF", printBackground=False)["data"])

"""No page has an error that axe-core finds (D. Farough et al., Deque, MPL 2.0), in light, dark and on a phone.

AXE_JS names the file axe.min.js: npm pack axe-core.
"""

from __future__ import annotations

import json
import os
import re
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from http.client import HTTPConnection
from pathlib import Path
from urllib.parse import urlsplit

import pytest
from browser import CHROMIUM, DESKTOP, PHONE, Browser
from log_writers import QUAD_MASS_KG, flight, quad_flight, write_tlog
from patience import HANG_S

import models
from companion.config import PipelineConfig
from companion.mavlink.stream_rates import StreamKeeper
from companion.page.feed import PageFeed, read_address
from companion.page.snapshot import snapshot
from companion.pipeline import initial_state, step
from companion.vehicles import QUAD, default_vehicle
from models.corner_law import ClosedForm
from models.paper import report as paper
from models.paper.exhibit import Exhibit
from models.training.library import train
from replay.cli import main
from replay.logs.formats import load
from replay.rerun.log_samples import samples

AXE = os.environ.get("AXE_JS", "")
WHY_NOT = "AXE_JS does not name axe.min.js (npm pack axe-core), or there is no chromium"


def checked(test: Callable[..., None]) -> Callable[..., None]:
    """Where a browser and the checker are at hand."""
    return pytest.mark.slow(pytest.mark.skipif(not (AXE and CHROMIUM), reason=WHY_NOT)(test))


HEAVIER_KG = 0.6
FILES = ("diagnosis", "folder", "season", "prediction", "run", "changes", "fan", "paper")
LOOKS = {"light": (DESKTOP, False), "dark": (DESKTOP, True), "phone": (PHONE, False)}
CHECK = """axe.run(document, {iframes: false}).then(({violations}) =>
  violations.flatMap(rule => rule.nodes.map(node => `${rule.id}: ${node.html.slice(0, 160)}`)))"""


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two flights of a vehicle that is heavier than its file says."""
    folder = tmp_path_factory.mktemp("pages")
    logs = folder / "logs"
    logs.mkdir()
    for seed, name in enumerate(("monday", "friday")):
        made = quad_flight(60.0, mass_kg=QUAD_MASS_KG + seed * HEAVIER_KG, seed=seed)
        write_tlog(logs / f"{name}.tlog", made)
    (logs / "broken.tlog").write_bytes(b"\0" * 5000)
    write_tlog(folder / "near.tlog", flight(20.0))
    (folder / "my.toml").write_text(QUAD.read_text())
    return folder


@pytest.fixture(scope="module")
def files(folder: Path) -> dict[str, str]:
    """Pages that commands write, by name."""
    vehicle = ["--vehicle", str(folder / "my.toml"), "--model", "none", "--quiet"]
    monday = str(folder / "logs" / "monday.tlog")
    friday = str(folder / "logs" / "friday.tlog")
    commands = {
        "diagnosis": ["diagnose", friday, *vehicle, "--save-model", str(folder / "model")],
        "prediction": ["predict", monday, "--model", str(folder / "model"), "--horizon", "0.5"],
        "run": ["run", str(folder / "near.tlog"), "--quiet"],
        "changes": ["diagnose", friday, "--since", monday, *vehicle],
        "folder": ["diagnose", str(folder / "logs"), *vehicle, "--out", str(folder / "out")],
        "season": ["season", str(folder / "out")],
    }
    commands["prediction"] += ["--vehicle", str(folder / "my.toml"), "--quiet"]
    pages = {}
    for name, command in commands.items():
        page = folder / name
        main([*command, "--report", str(page)])
        pages[name] = (page / "report.html").as_uri()
    fan = train(ClosedForm().data_set(), "polynomial")
    pages["fan"] = fan.plot().save(folder / "fan.html").as_uri()
    exhibit = Exhibit(title="a", paper="b", here="c", verdict="d", head=("e",), rows=(("f",),))
    pages["paper"] = paper.write(folder / "paper", [exhibit]).as_uri()
    return pages


@pytest.fixture(scope="module")
def desk(folder: Path) -> Iterator[dict[str, str]]:
    """Pages of a desk, by name; the empty one is asked for first."""
    command = [sys.executable, "-m", "replay", "serve", ":0", "--folder", str(folder / "desk")]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)
    try:
        assert process.stdout is not None
        address = process.stdout.readline().split()[0].rstrip("/")
        yield {"address": address}
    finally:
        process.send_signal(signal.SIGINT)
        process.communicate(timeout=HANG_S)


def ask(address: str, method: str, path: str, body: bytes = b"") -> bytes:
    connection = HTTPConnection(urlsplit(address).netloc, timeout=HANG_S)
    connection.request(method, path, body)
    return connection.getresponse().read()


def with_logs(address: str, folder: Path, name: str) -> str:
    """A page with one log."""
    page: str = json.loads(ask(address, "POST", "/drops"))["page"]
    ask(address, "PUT", f"{page}/logs/{name}", (folder / "logs" / name).read_bytes())
    return page


def answered(address: str, page: str) -> str:
    ask(address, "POST", f"{page}/asks", b"kind=missing")
    end = time.monotonic() + HANG_S
    while b'class="doing"' in ask(address, "GET", page):
        assert time.monotonic() < end
        time.sleep(0.2)
    return page


@pytest.fixture(scope="module")
def live(folder: Path) -> Iterator[str]:
    """The page of a flight near ground and wall."""
    config = PipelineConfig(vehicle=default_vehicle(), model=models.load(), dry_run=True)
    state = initial_state(config)
    with ExitStack() as stack:
        feed = PageFeed(*read_address(":0"))
        stack.callback(feed.close)
        for sample in samples(load(folder / "near.tlog")[0]):
            state, decision = step(state, sample, config)
            if decision is not None and decision.disturbance is not None:
                sent = snapshot(decision, state, config, StreamKeeper(()), 0.0)
                feed.offer(lambda sent=sent: sent)
        yield feed.url


def found(browser: Browser, url: str, look: str) -> list[str]:
    size, dark = LOOKS[look]
    browser.open(url, size, dark=dark)
    if not url.startswith("file:"):
        time.sleep(1.0)
    browser.value("document.querySelectorAll('details').forEach(d => d.open = true)")
    browser.value(Path(AXE).read_text("utf-8") + ";0")
    violations: list[str] = browser.value(CHECK)
    return violations


@pytest.fixture(scope="module")
def browser() -> Iterator[Browser]:
    with Browser() as browser:
        yield browser


@checked
@pytest.mark.parametrize("look", LOOKS)
@pytest.mark.parametrize("name", FILES)
def test_a_page_of_a_command(files: dict[str, str], browser: Browser, name: str, look: str) -> None:
    assert found(browser, files[name], look) == []


@checked
@pytest.mark.parametrize("look", LOOKS)
def test_the_live_page(live: str, browser: Browser, look: str) -> None:
    assert found(browser, live, look) == []


@checked
def test_the_desk(desk: dict[str, str], folder: Path, browser: Browser) -> None:
    address = desk["address"]
    errors = {}
    for look in LOOKS:
        errors[f"empty, {look}"] = found(browser, address + "/", look)
    good = answered(address, with_logs(address, folder, "friday.tlog"))
    bad = answered(address, with_logs(address, folder, "broken.tlog"))
    new = with_logs(address, folder, "monday.tlog")
    for page in ("/", good, bad, new, "/drops/nowhere"):
        for look in LOOKS:
            errors[f"{page}, {look}"] = found(browser, address + page, look)
    assert {page: v for page, v in errors.items() if v} == {}


ROOT = Path(__file__).resolve().parents[1]
SOURCES = [
    file
    for package in ("companion", "models", "replay")
    for suffix in ("html", "py")
    for file in (ROOT / package).rglob(f"*.{suffix}")
]
WRONG = {
    "a header without words": r'<th[^>]*></th>|table\(\([^)]*""',
    "what scrolls cannot be reached by keys": r'<div class="wide">|<pre>',
}
"""What is wrong in the source of a page."""


@pytest.mark.parametrize("what", WRONG)
def test_no_source_of_a_page_has(what: str) -> None:
    found = [file.name for file in SOURCES if re.search(WRONG[what], file.read_text("utf-8"))]
    assert found == []


def test_all_of_the_live_page_is_its_main_part() -> None:
    page = (ROOT / "companion" / "page" / "page.html").read_text("utf-8")
    before = page.split("</style>")[1].split("<main>")[0]
    after = page.split("</main>")[1].split("<script>")[0]
    assert (before.strip(), after.strip()) == ("", "")


def test_the_page_of_a_surrogate_has_a_heading() -> None:
    assert models.load().plot().html.count("<h1>") == 1

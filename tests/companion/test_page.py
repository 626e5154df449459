"""The live page: what is sent is what is shown, in a real browser; the flight never waits for it."""

import html
import json
import os
import re
import shutil
import signal
import socket
import subprocess
import time
import urllib.request
from pathlib import Path

import pytest
from log_writers import flight, write_tlog
from patience import HANG_S

import companion.page
from companion.cli import main
from companion.config import PipelineConfig
from companion.mavlink.stream_rates import StreamKeeper
from companion.page.feed import PageFeed, read_address
from companion.page.server import KEPT, Store
from companion.page.snapshot import snapshot
from companion.pipeline import initial_state, step
from companion.sim.process import free_port
from companion.vehicles import default_vehicle
from models.common.errors import ConfigError, LinkError
from models.surrogate.empty import empty_model

CHROMIUM = (
    shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")
)


def get(feed, path):
    with urllib.request.urlopen(feed.url + path, timeout=HANG_S) as reply:
        return reply.read()


def wait_for(feed, number):
    for _ in range(6000):
        sent = json.loads(get(feed, "snapshots?since=0"))
        if sent["last"] >= number:
            return sent
        time.sleep(0.05)
    raise AssertionError("the page never got the snapshots")


def put(feed, sent):
    feed._due_s = -1.0
    feed.offer(lambda: sent)


@pytest.fixture(scope="module")
def sent(tmp_path_factory):
    """The last snapshot of a recorded hover near ground and wall."""
    import models

    return last_of(tmp_path_factory.mktemp("log"), models.load())


def last_of(folder, model):
    from replay.logs.formats import load
    from replay.rerun.log_samples import samples

    path = folder / "a.tlog"
    write_tlog(path, flight(6.0))
    config = PipelineConfig(vehicle=default_vehicle(), model=model, dry_run=True)
    state, out = initial_state(config), None
    for sample in samples(load(path)[0]):
        state, decision = step(state, sample, config)
        if decision is not None and decision.disturbance is not None:
            out = snapshot(decision, state, config, StreamKeeper(()), 0.0)
    assert out is not None
    return out


@pytest.fixture(scope="module")
def without_model(tmp_path_factory):
    """The same flight without a model of its air."""
    return last_of(tmp_path_factory.mktemp("log"), empty_model(default_vehicle()))


@pytest.fixture
def feed():
    feed = PageFeed(*read_address(":0"))
    yield feed
    feed.close()


def test_a_snapshot_is_plain_numbers_that_fit_a_pipe(sent):
    text = json.dumps(sent, allow_nan=False)
    assert len(text) < 3000
    assert sent["air"]["ground"]["seen"] == "surface"
    assert sent["air"]["fans"][0][2] == pytest.approx(0.45, abs=0.15)
    assert len(sent["rpm"]) == 4
    assert isinstance(sent["reasons"], list)


def test_without_a_model_no_trust_is_said(sent, without_model):
    assert sent["air"]["trust"] > 0.0
    assert without_model["air"]["trust"] is None


def test_what_is_sent_is_what_is_served(feed, sent):
    put(feed, sent)
    put(feed, {**sent, "t_s": 99.5})
    answer = wait_for(feed, 2)
    assert answer["snapshots"] == [sent, {**sent, "t_s": 99.5}]
    assert json.loads(get(feed, "snapshots?since=1"))["snapshots"] == [{**sent, "t_s": 99.5}]
    assert json.loads(get(feed, "snapshots?since=77"))["last"] == 2
    assert json.loads(get(feed, "snapshots?since=x"))["last"] == 2


def test_the_page_asks_nobody_else():
    page = (Path(companion.page.__file__).parent / "page.html").read_text()
    assert re.findall(r"https?://[^\"'\s]+", page) == ["http://www.w3.org/2000/svg"]
    assert len(page) < 20_000


@pytest.mark.slow
@pytest.mark.skipif(CHROMIUM is None, reason="no chromium on this machine")
@pytest.mark.parametrize("size", ["400,800", "1280,900"])
def test_a_real_browser_shows_the_values_that_were_sent(feed, sent, size, tmp_path):
    sent = {**sent, "reasons": ["not armed", "ground or wall jumped <b>"]}
    sent["air"] = {**sent["air"], "wrench": [*sent["air"]["wrench"][:5], -1e-5]}
    for k in range(20):
        put(feed, {**sent, "t_s": 10.0 + 0.1 * k, "rates": [["ATTITUDE", 12.0, 50.0]]})
    wait_for(feed, 20)
    done = subprocess.run(
        [CHROMIUM, "--headless", "--no-sandbox", "--disable-gpu", "--disable-background-networking",
         f"--user-data-dir={tmp_path}", f"--window-size={size}", "--enable-logging=stderr", "--v=0",
         "--virtual-time-budget=3000", "--dump-dom", feed.url],
        capture_output=True, text=True, timeout=HANG_S,
    )  # fmt: skip
    shown = {
        i: re.sub(r"<[^>]*>", "", v) for i, v in re.findall(r'<b id="(\w+)">(.*?)</b>', done.stdout)
    }
    push = sent["air"]
    assert shown["h"] == f"{min(f[2] for f in push['fans']):.2f} m"
    assert shown["d"] == f"{min(f[3] for f in push['fans']):.2f} m"
    assert shown["thrust"] == f"{sent['offset']['thrust'] * 100:.1f} %"
    assert shown["lift"] == f"{-push['wrench'][2]:.2f} N"
    for rpm in sent["rpm"]:
        assert f"<td>{rpm} rpm</td>" in done.stdout
    for reason in sent["reasons"]:
        assert f"<li>{html.escape(reason)}</li>" in done.stdout
    assert '<tr class="slow"><td>ATTITUDE</td><td>12 of 50 Hz</td>' in done.stdout
    assert done.stdout.count("<polyline") == 6
    assert "t 11.9 s" in done.stdout
    assert ">10 s ago<" in done.stdout, (
        "the axis is as long as what was flown, at least ten seconds"
    )
    assert "-0.000" not in done.stdout
    assert "<td>Mz</td><td>0.000 N m</td>" in done.stdout
    assert "CONSOLE" not in done.stderr, done.stderr


def test_a_page_that_hangs_costs_the_flight_nothing_but_lines(feed, sent):
    os.kill(feed._process.pid, signal.SIGSTOP)
    try:
        longest = 0.0
        for _ in range(300):
            begin = time.perf_counter()
            put(feed, sent)
            longest = max(longest, time.perf_counter() - begin)
    finally:
        os.kill(feed._process.pid, signal.SIGCONT)
    assert feed.dropped > 0
    assert feed.sent > 10
    # What arrives after all is whole lines.
    assert all(s == sent for s in wait_for(feed, feed.sent)["snapshots"])


def test_a_page_that_dies_is_survived(feed, sent):
    os.kill(feed._process.pid, signal.SIGKILL)
    feed._process.wait()
    put(feed, sent)
    assert feed.dropped == 1


def test_a_browser_that_leaves_and_ten_that_stay(feed, sent):
    put(feed, sent)
    wait_for(feed, 1)
    port = int(feed.url.rsplit(":", 1)[1].strip("/"))
    with socket.create_connection(("127.0.0.1", port)) as gone:
        gone.sendall(b"GET /snap")
    stay = [socket.create_connection(("127.0.0.1", port)) for _ in range(10)]
    assert json.loads(get(feed, "snapshots?since=0"))["last"] == 1
    for s in stay:
        s.close()


def test_bad_addresses_and_a_port_that_is_taken(capsys):
    for text in ("8080", ":99999", "here:", "::1:80"):
        with pytest.raises(ConfigError):
            read_address(text)
    link = f"udpin:127.0.0.1:{free_port()}"
    assert read_address(":8080") == ("127.0.0.1", 8080)
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        address = f":{taken.getsockname()[1]}"
        with pytest.raises(LinkError, match="port is taken"):
            PageFeed(*read_address(address))
        assert main(["--connect", link, "--duration", "1", "--page", address]) == 4
    err = capsys.readouterr().err
    assert len(err.strip().splitlines()) == 1
    assert main(["--connect", link, "--page", "nowhere"]) == 2


def test_the_store_keeps_five_minutes():
    store = Store()
    for k in range(KEPT + 10):
        store.add(b'{"t_s":%d}' % k)
    answer = json.loads(store.since(KEPT + 5))
    assert [s["t_s"] for s in answer["snapshots"]] == [KEPT + 5 + k for k in range(5)]
    assert len(json.loads(store.since(0))["snapshots"]) == 600

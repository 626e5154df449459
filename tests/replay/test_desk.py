"""The page of ``replay serve``: logs in, the form, the answer, and what is refused."""

from __future__ import annotations

import errno
import json
import re
import signal
import socket
import subprocess
import sys
import time
from pathlib import Path
from urllib.request import urlopen

import pytest
from browser import CHROMIUM, PHONE, Browser
from log_writers import QUAD_MASS_KG, frame, quad_flight, write_tlog
from patience import HANG_S

from companion.mavlink.dialect import mavlink
from models.common.extras import how_to_install

testclient = pytest.importorskip(
    "starlette.testclient", reason="starlette is not installed (extra: serve)"
)

from replay.cli import main  # noqa: E402
from replay.desk.app import app  # noqa: E402
from replay.desk.question import (  # noqa: E402
    FIELDS,
    Asked,
    Question,
    in_words,
    rows,
)
from replay.desk.store import Ask, Desk, Drop, safe_name  # noqa: E402
from replay.desk.work import Work  # noqa: E402
from replay.fleet.jobs import error_text  # noqa: E402
from replay.fleet.store import NAME, Store  # noqa: E402

HERE = "http://127.0.0.1:8000"
PATIENCE_S = HANG_S


@pytest.fixture(scope="module")
def flown(tmp_path_factory) -> bytes:
    return write_tlog(tmp_path_factory.mktemp("flown") / "a.tlog", quad_flight(30.0))


@pytest.fixture
def desk(tmp_path) -> Desk:
    return Desk.of(tmp_path / "desk")


class Idle(Work):
    """Takes questions and never answers."""

    def start(self, drop: Drop, ask: Ask, question: Question) -> None:
        self.asked = question.command(drop, ask)


@pytest.fixture
def idle(desk):
    with testclient.TestClient(app(desk, Idle(), most=3_000_000), base_url=HERE) as client:
        yield client


@pytest.fixture
def working(desk):
    with testclient.TestClient(app(desk), base_url=HERE) as client:
        yield client


def drop(client, **logs: bytes) -> str:
    """The page of a new drop that holds these logs."""
    page = client.post("/drops").json()["page"]
    for name, data in logs.items():
        assert client.put(f"{page}/logs/{name}.tlog", content=data).status_code == 201
    return page


def answer(client, page: str, **form) -> str:
    """The page once a question is answered, or is not."""
    assert client.post(f"{page}/asks", data=form).status_code == 200
    return finished(client, page)


def finished(client, page: str) -> str:
    """The page once nothing is being done any more."""
    end = time.monotonic() + PATIENCE_S
    while 'class="doing"' in (text := client.get(page).text):
        assert time.monotonic() < end, text
        time.sleep(0.1)
    return text


def told(client, page: str, number: int = 1) -> dict:
    return client.get(f"{page.replace('drops', 'files')}/asks/{number}/answer.json").json()


FOR_PEOPLE = {"accept": "text/html,application/xhtml+xml"}


def test_an_error_has_a_way_back_for_a_browser_and_is_a_line_for_a_copy(idle, flown):
    page = drop(idle, monday=flown)
    asked = idle.post(f"{page}/asks", data={"kind": "changed"}, headers=FOR_PEOPLE)
    assert asked.status_code == 400
    assert f'<a href="{page}">Back to these logs</a>' in asked.text
    assert 'role="alert"' in asked.text
    gone = idle.get("/drops/nowhere", headers=FOR_PEOPLE)
    assert gone.status_code == 404
    assert '<a href="/">Back to all logs</a>' in gone.text
    assert "there is no such page" in idle.get("/nowhere", headers=FOR_PEOPLE).text
    said = idle.put(f"{page}/logs/notes.txt", content=b"x")
    assert "<" not in said.text
    assert "notes.txt: is no log" in said.text


def test_a_wrong_number_is_said_in_the_words_of_the_form():
    said = in_words("--mass -3: must be above 0 and at most 10000")
    assert said == "mass, with battery: -3 must be above 0 and at most 10000"
    assert in_words("a.tlog: cannot be read") == "a.tlog: cannot be read"


def test_every_page_has_one_main_part_and_names_its_buttons(idle, flown):
    assert "Try a simulated flight" in idle.get("/").text
    page = drop(idle, monday=flown)
    for text in (idle.get("/").text, idle.get(page).text):
        assert text.count("<main>") == 1
        assert "<button>Remove" not in text
    assert "Try a simulated flight" not in idle.get("/").text
    assert 'aria-label="Remove monday.tlog"' in idle.get(page).text


def test_a_flight_that_cannot_be_simulated_leaves_nothing(idle, desk, tmp_path, monkeypatch):
    broken = tmp_path / "python"
    broken.write_text("#!/bin/sh\necho companion: no room >&2\nexit 2\n")
    broken.chmod(0o700)
    monkeypatch.setattr(sys, "executable", str(broken))
    said = idle.post("/trial")
    assert said.status_code == 500
    assert "no room" in said.text
    assert list(desk.folder.iterdir()) == []


@pytest.mark.slow
def test_an_empty_desk_has_a_flight_to_try(working):
    shown = working.post("/trial")
    assert "simulated-flight.tlog" in shown.text
    page = shown.url.path
    end = time.monotonic() + PATIENCE_S
    while 'class="doing"' in (text := working.get(page).text):
        assert time.monotonic() < end, text
        time.sleep(0.1)
    assert told(working, page)["verdict"]


@pytest.mark.slow
def test_a_log_is_dropped_answered_corrected_and_answered_again(working, flown):
    page = drop(working, monday=flown)
    text = answer(working, page, kind="missing")
    assert re.search(r"<summary>[^<]*, \d+ s, \d+ s in the air; can be judged: ", text)
    assert re.search(r'id="mass_kg"[^>]*placeholder="[\d.]+"', text)
    assert "hover_rpm" in text
    assert "vehicle file" in text
    report = working.get(f"{page.replace('drops', 'files')}/asks/1/report.html").text
    assert "Error of the model" in report
    assert report.startswith("<!doctype html>")
    text = answer(working, page, kind="missing", mass_kg=f" {QUAD_MASS_KG} ", rotor_radius_m="11")
    facts = {f["key"]: f["value"] for f in told(working, page, 2)["vehicle"]["known"]}
    assert facts["mass_kg"] == QUAD_MASS_KG
    assert facts["rotor_radius_m"] == pytest.approx(11 * 0.0127)
    assert f'value="{QUAD_MASS_KG}"' in text
    file = Path(told(working, page, 2)["logs"][0]).parents[1]
    edited = (
        (file / "asks" / "2" / "vehicle.toml").read_text().replace("mass_kg = 3.0", "mass_kg = 3.5")
    )
    answer(working, page, kind="missing", edited="yes", vehicle=edited)
    assert "vehicle" not in told(working, page, 3)
    text = answer(working, page, kind="missing", edited="yes", vehicle="mass_kg = 'heavy'")
    assert "edited.toml" in text
    assert str(file) not in re.sub(r"in <code>.*?</code>", "", text)


@pytest.mark.slow
def test_a_season_has_a_row_for_a_broken_log_and_what_changed_is_asked_of_good_ones(
    working, flown, tmp_path
):
    heavy = write_tlog(tmp_path / "b.tlog", quad_flight(60.0, mass_kg=1.3 * QUAD_MASS_KG, seed=2))
    long = write_tlog(tmp_path / "c.tlog", quad_flight(60.0, seed=3))
    page = drop(working, monday=long, tuesday=heavy, broken=b"\x00" * 5000)
    text = answer(working, page, kind="season")
    files = f"{page.replace('drops', 'files')}/asks"
    report = working.get(f"{files}/1/report.html").text
    assert all(name in report for name in ("monday.tlog", "tuesday.tlog", "broken.tlog"))
    (link, *_) = re.findall(r'href="(logs/[^"]*)"', report)
    assert working.get(f"{files}/1/{link}").status_code == 200
    assert re.search(r"<td>broken.tlog</td><td><details><summary>broken.tlog: ", text)
    assert working.post(f"{page}/logs/broken.tlog/delete").status_code == 200
    text = answer(working, page, kind="changed", good="monday.tlog", mass_kg=str(QUAD_MASS_KG))
    assert {c["name"] for c in told(working, page, 2)["changed"]} & {"payload", "thrust_scale"}
    assert "good: monday.tlog" in text


@pytest.mark.slow
@pytest.mark.parametrize(("kind", "name"), [(10, "rover"), (4, "helicopter"), (1, "aeroplane")])
def test_what_is_no_multirotor_is_said(working, tmp_path, kind, name):
    text = answer(
        working,
        drop(working, x=write_tlog(tmp_path / "x", quad_flight(5.0, kind=kind))),
        kind="missing",
    )
    assert f"is a {name}" in text.replace("an aero", "a aero")
    assert "only multirotors are drafted" in text


def framed(path: Path, kind: int) -> bytes:
    """A log that says its FRAME_TYPE."""
    flown, names = quad_flight(20.0), (("FRAME_CLASS", 1.0), ("FRAME_TYPE", float(kind)))
    said = [
        mavlink.MAVLink_param_value_message(name.encode(), value, 9, 2, k)
        for k, (name, value) in enumerate(names)
    ]
    return write_tlog(
        path, [*flown, *((flown[-1][0] + 1 + k, frame(message)) for k, message in enumerate(said))]
    )


@pytest.mark.slow
def test_logs_of_two_vehicles_are_refused_together_without_the_desks_paths(working, desk, tmp_path):
    page = drop(working, a=framed(tmp_path / "x", 1), b=framed(tmp_path / "y", 12))
    text = answer(working, page, kind="missing")
    assert "a.tlog and b.tlog are of two vehicles (quad-x; quad-bf)" in text
    assert str(desk.folder) not in re.sub(r"in <code>.*?</code>", "", text)


@pytest.mark.slow
def test_a_cancelled_question_ends_at_once_and_the_next_in_the_queue_goes_on(desk, flown):
    with testclient.TestClient(app(desk, Work(at_once=1)), base_url=HERE) as client:
        page = drop(client, a=flown)
        for _ in range(3):
            client.post(f"{page}/asks", data={"kind": "missing"})
        assert "waits for its turn" in client.get(page).text
        client.post(f"{page}/asks/1/cancel")
        client.post(f"{page}/asks/3/cancel")
        text = answer(client, page, kind="season")
    assert text.count(">cancelled<") == 2
    assert text.count('report.html">answer') == 2


@pytest.mark.slow
def test_deleting_a_drop_ends_its_work_and_leaves_nothing(working, desk, flown):
    page = drop(working, a=flown)
    working.post(f"{page}/asks", data={"kind": "missing"})
    time.sleep(0.5)
    assert working.post(f"{page}/delete").status_code == 200
    time.sleep(0.5)
    assert working.get(page).status_code == 404
    assert [path for path in desk.folder.rglob("*") if path.is_file()] == []


def test_a_question_of_an_earlier_run_of_the_desk_is_said_to_have_stopped(idle, flown):
    page = drop(idle, a=flown)
    idle.post(f"{page}/asks", data={"kind": "missing"})
    assert "the desk was closed" in idle.get(page).text


@pytest.mark.parametrize(
    ("name", "kept"),
    [
        ("../../etc/x.tlog", "x.tlog"),
        ("..\\up.tlog", "up.tlog"),
        ("...tlog.BIN", "tlog.BIN"),
        ("a;b$(c).ulg", "a_b_(c).ulg"),
        ("-rf.tlog", "rf.tlog"),
        (f"{'x' * 300}.tlog", f"{'x' * 115}.tlog"),
    ],
)
def test_a_name_is_never_a_path(name, kept):
    assert safe_name(name) == kept


def test_a_path_in_a_name_lands_among_the_logs(idle, desk, flown):
    page = drop(idle)
    assert idle.put(f"{page}/logs/..%2F..%2F..%2Fevil.tlog", content=flown).json() == {
        "log": "evil.tlog"
    }
    assert [p.name for p in desk.folder.rglob("*.tlog")] == ["evil.tlog"]
    (held,) = desk.drops
    assert held.logs[0].parent == held.folder / "logs"


@pytest.mark.parametrize(
    "path",
    [
        "/drops/..",
        "/drops/%2e%2e%2f",
        "/files/%2e%2e/secret",
        "/files/..%2f..%2fsecret",
        "/static/..%2fapp.py",
    ],
)
def test_nothing_beside_the_folder_is_served(idle, desk, path):
    (desk.folder.parent / "secret").write_text("secret")
    assert "secret" not in idle.get(path).text
    assert "import annotations" not in idle.get(path).text


@pytest.mark.parametrize(
    ("headers", "status"),
    [
        ({}, 201),
        ({"origin": HERE, "sec-fetch-site": "same-origin"}, 201),
        ({"origin": "http://127.0.0.1:3000"}, 403),
        ({"origin": "https://example.org", "sec-fetch-site": "cross-site"}, 403),
        ({"origin": "null"}, 403),
        ({"sec-fetch-site": "same-site"}, 403),
        ({"host": "rebound.example.org:8000"}, 403),
        ({"host": "localhost:8000"}, 201),
        ({"host": "[::1]:8000"}, 201),
        ({"host": ""}, 403),
    ],
)
def test_another_site_is_refused(idle, headers, status):
    reply = idle.post("/drops", headers=headers)
    assert reply.status_code == status
    assert reply.headers["cross-origin-resource-policy"] == "same-origin"
    assert "default-src 'none'" in reply.headers["content-security-policy"]


def test_pages_ask_for_nothing_from_elsewhere(idle, flown):
    for page in ("/", drop(idle, a=flown)):
        assert not re.search(r'(src|href|action)="(https?:)?//', idle.get(page).text)


@pytest.mark.parametrize(
    ("name", "word"),
    [("notes.txt", "is no log"), ("a.tlog.gz", "is no log"), ("tlog", "is no log")],
)
def test_what_is_no_log_is_refused_in_one_line(idle, name, word):
    reply = idle.put(f"{drop(idle)}/logs/{name}", content=b"x")
    assert reply.status_code == 415
    assert word in reply.text
    assert len(reply.text.splitlines()) == 1


def test_a_season_says_how_far_it_is_to_every_browser(desk):
    work = Work()
    with testclient.TestClient(app(desk, work), base_url=HERE) as client:
        page = drop(client, a=b"a", b=b"b", c=b"c")
        of_desk = desk.drops[0]
        ask = Question(Asked.SEASON).written(of_desk)
        work._steps[ask.folder] = "reads the logs"
        with Store.open(of_desk.each / NAME, make=True) as store:
            store.add("of an earlier question", {"sha256": "a", "log": "a"})
            work._before[ask.folder] = of_desk.last
            for name in "ab":
                store.add("q", {"sha256": name, "log": name})
            for _ in range(2):
                assert "reads the logs: 2 of 3 done" in client.get(page).text


def test_a_season_may_end_while_its_page_is_made(desk, monkeypatch):
    """Pages are made in threads of their own."""
    work = Work()
    with testclient.TestClient(app(desk, work), base_url=HERE) as client:
        drop(client, a=b"a")
        ask = Question(Asked.SEASON).written(desk.drops[0])
        work._steps[ask.folder] = "reads the logs"
        work._before[ask.folder] = 0

        def ended(_: Drop) -> int:
            work._before.clear()
            return 1

        monkeypatch.setattr(Drop, "last", property(ended))
        assert work.step(ask) == "reads the logs: 1 of 1 done"


@pytest.mark.slow
def test_a_cancelled_season_is_taken_up_again(desk, flown, tmp_path):
    other = write_tlog(tmp_path / "b.tlog", quad_flight(30.0, seed=2))
    with testclient.TestClient(app(desk), base_url=HERE) as client:
        page = drop(client, a=flown)
        answer(client, page, kind="season")
        assert client.put(f"{page}/logs/b.tlog", content=other).status_code == 201
        client.post(f"{page}/asks", data={"kind": "season"})
        client.post(f"{page}/asks/2/cancel")
        assert 'aria-label="Go on with question 2"' in client.get(page).text
        (first,) = (path.stat() for path in results(desk))
        assert client.post(f"{page}/asks/2/again").status_code == 200
        text = finished(client, page)
        assert 'asks/3/season/report.html">over time' in text
        report = client.get(f"{page.replace('drops', 'files')}/asks/3/report.html").text
        assert "2 of 2 logs could be used" in report
        links = re.findall(r'href="(logs/[^"]*)"', report)
        assert len(links) == 2
        for link in links:
            assert client.get(f"{page.replace('drops', 'files')}/asks/3/{link}").status_code == 200
    kept = [path.stat() for path in results(desk)]
    assert first.st_ino in [one.st_ino for one in kept], "it was not worked out twice"


def results(desk: Desk) -> list[Path]:
    return sorted((desk.drops[0].each / "results").iterdir())


@pytest.mark.slow
def test_a_log_that_is_removed_is_in_no_season(working, desk, flown, tmp_path):
    other = write_tlog(tmp_path / "b.tlog", quad_flight(30.0, seed=2))
    page = drop(working, a=flown, b=other)
    answer(working, page, kind="season")
    assert desk.drops[0].last == 2
    working.post(f"{page}/logs/b.tlog/delete")
    with Store.look(desk.drops[0].each) as store:
        (row,) = store.rows("SELECT path FROM logs")
    assert Path(row["path"]).name == "a.tlog"


def test_what_is_asked_again_needs_its_logs(idle, desk, flown):
    page = drop(idle, a=flown, b=b"b")
    idle.post(f"{page}/asks", data={"kind": "changed", "good": "a.tlog", "mass_kg": "2"})
    assert idle.post(f"{page}/asks/1/again").status_code == 200
    assert desk.drops[0].asks[0].question["numbers"] == [["mass_kg", "2"]]
    idle.post(f"{page}/logs/a.tlog/delete")
    refused = idle.post(f"{page}/asks/1/again")
    assert refused.status_code == 404
    assert "a.tlog: is not here" in refused.text


def test_what_is_too_large_is_refused_with_and_without_an_announced_size(idle, desk):
    page = drop(idle)
    parts = (b"x" * 1_000_000 for _ in range(4))
    for content in (b"x" * 3_000_001, parts):
        reply = idle.put(f"{page}/logs/a.tlog", content=content)
        assert reply.status_code == 413
        assert "is larger than" in reply.text
    assert not list(desk.folder.rglob("*.part"))
    assert not list(desk.folder.rglob("*.tlog"))


def test_a_full_disk_is_said(idle, desk, monkeypatch):
    page = drop(idle)

    def full(*_):
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(Drop, "_keep", full)
    reply = idle.put(f"{page}/logs/a.tlog", content=b"xy")
    assert (reply.status_code, "No space left" in reply.text) == (507, True)
    assert not list(desk.folder.rglob("*.part"))


def test_the_same_log_twice_is_refused_and_another_of_the_same_name_is_kept(idle, flown):
    page = drop(idle, a=flown)
    reply = idle.put(f"{page}/logs/b.tlog", content=flown)
    assert (reply.status_code, reply.text) == (409, "b.tlog: is the same log as a.tlog")
    assert idle.put(f"{page}/logs/a.tlog", content=flown[:-1]).json() == {"log": "a-2.tlog"}


def test_a_log_without_a_date_of_its_own_keeps_that_of_its_file(idle, desk):
    idle.put(f"{drop(idle)}/logs/a.BIN?changed_s=1700000000", content=b"x")
    assert desk.drops[0].logs[0].stat().st_mtime == 1_700_000_000


@pytest.mark.parametrize(
    ("form", "word"),
    [
        ({"kind": "delete"}, "must be one of"),
        ({"kind": "changed"}, "tick the good logs"),
        ({"kind": "changed", "good": "../a.tlog"}, "is not here"),
        ({"kind": "changed", "good": "a.tlog"}, "leave at least one"),
    ],
)
def test_a_question_that_makes_no_sense_is_refused(idle, flown, form, word):
    reply = idle.post(f"{drop(idle, a=flown)}/asks", data=form)
    assert reply.status_code in (400, 404)
    assert word in reply.text


def test_a_question_without_logs_and_an_endless_form_are_refused(idle):
    page = drop(idle)
    assert "drop one" in idle.post(f"{page}/asks", data={"kind": "missing"}).text
    assert idle.post(f"{page}/asks", data={"vehicle": "x" * 300_000}).status_code == 413


def test_what_is_typed_is_never_an_option_of_its_own(desk, flown):
    held = desk.new_drop()
    (held.folder / "logs" / "a.tlog").write_bytes(flown)
    question = Question.of(
        [
            ("kind", "missing"),
            ("mass_kg", "--json /x"),
            ("position_m", "1 --report /x"),
            ("seed", "3"),
        ],
        held,
    )
    command = question.command(held, question.written(held))
    assert "--mass=--json /x" in command
    assert "--span=1 --report /x" in command
    assert not [word for word in command if "seed" in word]


def test_hints_stand_in_the_unit_of_their_field():
    (mass, propeller, span) = rows([{"key": "rotor_radius_m", "value": 0.127, "from": "0.0635 to 0.254, ten inches; --propeller INCH gives it"}])  # fmt: skip  # noqa: E501
    assert propeller[1:] == ("10", "5 to 20, ten inches")
    assert (mass[1:], span[1:]) == (("", ""), ("", ""))
    assert FIELDS["position_m"].shown(0.25) == "0.5"


@pytest.mark.parametrize(
    ("said", "code", "line"),
    [
        ("replay: a.tlog: no heartbeat\n", 3, "a.tlog: no heartbeat"),
        ("Traceback (most ...):\n  ...\nValueError: x", 1, "the program broke (ValueError: x); please report it"),
        ("", -9, "its process died (signal 9): probably too little memory"),
        ("", 2, "ended with exit code 2"),
    ],
)  # fmt: skip
def test_how_a_diagnosis_failed_is_said_in_words(said, code, line):
    assert error_text(said, code) == line


@pytest.mark.parametrize(
    ("arguments", "word"),
    [
        (["nonsense"], "[HOST]:PORT"),
        ([":0", "--folder", "{file}"], "--folder"),
        (["{port}"], "name another"),
    ],
)
def test_a_wrong_start_is_one_line(tmp_path, capsys, arguments, word):
    (tmp_path / "file").write_text("x")
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = f":{taken.getsockname()[1]}"
        filled = [a.format(file=tmp_path / "file", port=port) for a in arguments]
        extra = [] if "--folder" in filled else ["--folder", str(tmp_path / "desk")]
        assert main(["serve", *filled, *extra]) == 2
    assert not (tmp_path / "desk").exists(), "a start that failed leaves no folder"
    (line,) = capsys.readouterr().err.splitlines()
    assert word in line


@pytest.fixture
def served(tmp_path):
    """The address of a server in a process of its own, in which Ctrl-C is pressed in the end."""
    command = [sys.executable, "-m", "replay", "serve", ":0", "--folder", str(tmp_path / "desk")]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    try:
        line = process.stdout.readline()
        assert str(tmp_path / "desk") in line
        yield line.split()[0]
    finally:
        process.send_signal(signal.SIGINT)
        _, errors = process.communicate(timeout=HANG_S)
    assert (process.returncode, errors) == (130, "")


@pytest.mark.slow
def test_ctrl_c_ends_the_desk_and_the_work(served, flown):
    with urlopen(served) as reply:
        assert b"Drop flight logs here" in reply.read()


@pytest.mark.slow
@pytest.mark.skipif(CHROMIUM is None, reason="no chromium on this machine")
def test_a_browser_drops_two_logs_and_reads_the_answer(served, flown, tmp_path):
    (tmp_path / "a.tlog").write_bytes(flown)
    with Browser() as browser:
        seen = browser.open(served, PHONE)
        assert seen.width <= PHONE[0]
        browser.value(
            "{const d = new DataTransfer(); d.items.add(new File(['no log'], 'notes.txt'));"
            "document.getElementById('zone').dispatchEvent(new DragEvent('drop', {dataTransfer: d}))}"
        )
        until(browser, "document.getElementById('refused').innerText.includes('is no log')")
        root = browser.ask("DOM.getDocument")["root"]["nodeId"]
        files = browser.ask("DOM.querySelector", nodeId=root, selector="#files")["nodeId"]
        browser.ask("DOM.setFileInputFiles", nodeId=files, files=[str(tmp_path / "a.tlog")])
        until(browser, "document.querySelector('.doing')")
        until(browser, "document.getElementById('answer')")
        assert browser.value("document.documentElement.scrollWidth") <= PHONE[0]
        assert "s in the air; can be judged: " in browser.value("document.body.innerText")
        messages = [
            e
            for e in browser._events
            if e.get("method") in ("Runtime.exceptionThrown", "Log.entryAdded")
        ]
        assert [m for m in messages if "415" not in json.dumps(m)] == []


@pytest.mark.slow
@pytest.mark.skipif(CHROMIUM is None, reason="no chromium on this machine")
def test_a_folder_is_a_season(served, flown, tmp_path):
    logs = tmp_path / "logs"
    (logs / "may").mkdir(parents=True)
    (logs / "may" / "a.tlog").write_bytes(flown)
    (logs / "notes.txt").write_text("windy")
    with Browser() as browser:
        browser.open(served)
        root = browser.ask("DOM.getDocument")["root"]["nodeId"]
        folder = browser.ask("DOM.querySelector", nodeId=root, selector="#folder")["nodeId"]
        browser.ask("DOM.setFileInputFiles", nodeId=folder, files=[str(logs)])
        until(browser, "document.getElementById('answer')")
        text = browser.value("document.body.innerText")
        assert "Each log by itself" in text
        assert "over time" in text


def until(browser: Browser, condition: str) -> None:
    end = time.monotonic() + PATIENCE_S
    while not browser.value(f"!!({condition})"):
        assert time.monotonic() < end, condition
        time.sleep(0.1)


def test_without_the_server_the_line_says_what_to_install(monkeypatch, capsys):
    monkeypatch.setitem(sys.modules, "uvicorn", None)
    assert main(["serve", ":0"]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert how_to_install("serve") in line

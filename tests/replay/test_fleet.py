"""Folders of logs: every log judged as by itself, bad ones said, nothing computed twice."""

import csv
import json
import os
import re
import subprocess
import sys

import pytest
from browser import CHROMIUM, DESKTOP, PHONE, Browser
from log_writers import flight, quad_flight, write_tlog
from pages import without_script
from patience import HANG_S

from companion.control.reasons import Reason
from companion.mavlink.wire_frames import cut
from companion.vehicles import QUAD
from replay.cli import main
from replay.fleet.jobs import Job, perform, work
from replay.fleet.page import common_effects, page
from replay.fleet.results import Answers, keep, known, logs_in, write_table
from replay.fleet.store import Store
from replay.fleet.workers import Place

DAY_US = 86_400_000_000


@pytest.fixture
def folder(tmp_path):
    logs = tmp_path / "season"
    (logs / "may").mkdir(parents=True)
    write_tlog(logs / "a.tlog", flight(3.0))
    write_tlog(logs / "may" / "b.tlog", flight(4.0, arrival_us=1_767_225_600_000_000 + 3 * DAY_US))
    (logs / "bad.tlog").write_bytes(b"\x00" * 500)
    (logs / "notes.txt").write_text("windy")
    (logs / "c.tlog.gz").write_bytes(b"\x1f\x8b")
    return logs


@pytest.mark.slow
def test_every_log_is_judged_as_by_itself_and_a_bad_one_stops_nothing(folder, tmp_path, capsys):
    out = tmp_path / "out"
    assert main(["run", str(folder), "--out", str(out), "--workers", "2", "--json", "-"]) == 0
    told = capsys.readouterr()
    answers = {os.path.basename(a["log"]): a for a in json.loads(told.out)["logs"]}
    assert set(answers) == {"a.tlog", "b.tlog", "bad.tlog"}
    assert "error" in answers["bad.tlog"]
    errors = told.err.strip().splitlines()
    assert [line for line in errors if "bad.tlog" in line]
    assert [line for line in errors if "c.tlog.gz" in line and "unpack" in line]
    main(["run", str(folder / "a.tlog"), "--json", "-"])
    alone = json.loads(capsys.readouterr().out)
    assert {k: answers["a.tlog"][k] for k in alone if k != "log"} == {
        k: v for k, v in alone.items() if k != "log"
    }
    assert answers["b.tlog"]["date"].startswith("2026-01-04")
    assert answers["b.tlog"]["date_from"] == "log"


def test_table_and_page_hold_every_log(folder, tmp_path):
    out = tmp_path / "out"
    assert main(["run", str(folder), "--out", str(out), "--workers", "1", "--quiet"]) == 0
    with (out / "table.csv").open(encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    assert len(rows) == 3
    assert [bool(r["error"]) for r in rows].count(True) == 1
    assert max(float(r["duration_s"]) for r in rows if r["duration_s"]) == pytest.approx(
        3.98, abs=0.05
    )
    page = (out / "report.html").read_text()
    assert all(name in page for name in ("a.tlog", "b.tlog", "bad.tlog"))
    assert "http" not in without_script(page)
    assert "<script" not in without_script(page)


@pytest.mark.slow
def test_the_page_of_replays_names_what_to_mend_in_words(tmp_path):
    logs = tmp_path / "logs"
    logs.mkdir()
    for day, name in enumerate(("a", "b")):
        arrival_us = 1_767_225_600_000_000 + day * DAY_US
        messages = [m for m in flight(20.0, arrival_us=arrival_us) if cut(m[1], 0).id != 132]
        write_tlog(logs / f"{name}.tlog", messages)
    out = ["--out", str(tmp_path / "out"), "--workers", "1", "--quiet"]
    assert main(["run", str(logs), "--vehicle", "tandem", *out]) == 0
    page = (tmp_path / "out" / "report.html").read_text()
    assert f"correct the main reason for no offset: {Reason.RANGE_MISSING.value}" in page
    assert page.count(f"{Reason.RANGE_MISSING.value}, 20 s") == 2
    assert "40 s in all" in page


@pytest.mark.slow
def test_what_is_known_is_not_computed_again_until_it_changes(folder, tmp_path, capsys):
    out = tmp_path / "out"
    arguments = ["run", str(folder), "--out", str(out), "--workers", "1"]
    assert main(arguments) == 0
    first = {p.name: p.stat().st_mtime_ns for p in (out / "results").iterdir()}
    capsys.readouterr()
    assert main(arguments) == 0
    assert "3 of them known from before" in capsys.readouterr().out
    assert {p.name: p.stat().st_mtime_ns for p in (out / "results").iterdir()} == first
    write_tlog(folder / "a.tlog", flight(5.0))
    assert main(arguments) == 0
    assert "2 of them known from before" in capsys.readouterr().out
    assert main([*arguments, "--param", "GUID_OPTIONS=8"]) == 0
    assert "known from before" not in capsys.readouterr().out


@pytest.mark.slow
def test_folder_of_diagnoses(tmp_path, capsys):
    logs = tmp_path / "logs"
    logs.mkdir()
    write_tlog(logs / "heavy.tlog", quad_flight(40.0, mass_kg=3.6))
    out = tmp_path / "out"
    arguments = [
        "diagnose",
        str(logs),
        "--vehicle",
        str(QUAD),
        "--model",
        "none",
        "--out",
        str(out),
        "--json",
        "-",
    ]
    assert main(arguments) == 0
    (answer,) = json.loads(capsys.readouterr().out)["logs"]
    main(
        [
            "diagnose",
            str(logs / "heavy.tlog"),
            "--vehicle",
            str(QUAD),
            "--model",
            "none",
            "--json",
            "-",
        ]
    )
    alone = json.loads(capsys.readouterr().out)
    assert answer["verdict"] == alone["verdict"]
    assert answer["effects"] == alone["effects"]
    page = (out / "report.html").read_text()
    assert answer["effects"][0]["name"].replace("_", " ") in page
    assert page.index("Next: ") < page.index("Every log")


@pytest.mark.slow
def test_report_of_a_folder_is_one_page_of_all_that_leads_to_one_of_every_log(tmp_path, capsys):
    logs, report = tmp_path / "logs", tmp_path / "report"
    logs.mkdir()
    for k in range(2):
        write_tlog(logs / f"heavy{k}.tlog", quad_flight(40.0, mass_kg=3.6, seed=k))
    (logs / "bad.tlog").write_bytes(b"\x00" * 500)
    arguments = [
        "diagnose",
        str(logs),
        "--vehicle",
        str(QUAD),
        "--model",
        "none",
        "--out",
        str(tmp_path / "out"),
    ]
    assert main([*arguments, "--report", str(report), "--quiet"]) == 0
    page = (report / "report.html").read_text()
    assert "Most logs show the same effect" in page
    assert page.index("Most logs show") < page.index("Next: ") < page.index("Every log")
    links = re.findall(r'href="(logs/[\w-]+/report\.html)"', page)
    assert len(links) == 2
    for link in links:
        assert "Error of the model" in (report / link).read_text()
    assert str(tmp_path) not in page.split("<table>")[-1].replace(str(logs), ""), (
        "the folder may be moved"
    )
    # A page that was deleted is made again; the others are known from before.
    (report / links[0]).unlink()
    capsys.readouterr()
    assert main([*arguments, "--report", str(report)]) == 0
    assert "2 of them known from before" in capsys.readouterr().out
    assert (report / links[0]).is_file()
    assert main([*arguments, "--save-model", str(tmp_path / "m")]) == 2
    (line,) = capsys.readouterr().err.strip().splitlines()
    assert "--save-model" in line
    assert f"replay diagnose {logs}/*.tlog --save-model" in line, "what to type instead"


def test_what_logs_cannot_tell_apart_counts_as_one():
    def log(name, *aliases):
        return {
            "verdict": "explained",
            "effects": [{"name": name}],
            "aliases": [[name, *aliases]] if aliases else [],
        }

    assert common_effects([log("payload", "thrust_scale"), log("thrust_scale", "payload")]) == [
        ["payload", "thrust_scale"]
    ]
    assert common_effects([log("payload"), log("wind"), log("ceiling")]) == []
    assert common_effects([log("wind"), log("wind"), log("payload")]) == [["wind"]]


def test_vehicles_are_never_pooled():
    def log(vehicle, name):
        return {
            "log": "a.tlog",
            "page": None,
            "date": "",
            "identity": {"vehicle": vehicle},
            "verdict": "explained",
            "duration_s": 60.0,
            "effects": [{"name": name}],
            "aliases": [],
        }

    twice = [log("board-A", "payload"), log("board-A", "payload")]
    assert "Most logs show the same effect: payload" in page("season", twice)
    others = [log("board-B", "wind"), log("board-B", "payload"), log("", "payload")]
    assert "1 of 3 vehicles show an effect on most of their logs" in page(
        "season", [*twice, *others]
    )


@pytest.mark.slow
def test_table_and_page_come_as_it_goes(folder, tmp_path, monkeypatch):
    monkeypatch.setattr("replay.fleet.folder.WRITE_EVERY_S", 0.0)
    written = []
    real = write_table

    def seen(target, answers):
        written.append(len(answers))
        return real(target, answers)

    monkeypatch.setattr("replay.fleet.folder.write_table", seen)
    monkeypatch.setattr("replay.fleet.folder.time.monotonic", iter(range(1000)).__next__)
    assert main(["run", str(folder), "--out", str(tmp_path / "out"), "--quiet"]) == 0
    assert written[0] == 1
    assert written[-1] == 3


@pytest.mark.slow
def test_what_cannot_be_judged_says_what_to_set(tmp_path):
    log = tmp_path / "a.tlog"
    write_tlog(log, quad_flight(30.0, imu=False))
    answer = perform(Job.of("diagnose", log, {"--model": "none", "--vehicle": QUAD}))
    assert re.search(
        "accelerometer.*; for the next log set .*(HIGHRES_IMU|RAW_SENS)", answer["error"]
    )
    write_tlog(log, quad_flight(30.0, parked=True))
    answer = perform(Job.of("diagnose", log, {"--model": "none", "--vehicle": QUAD}))
    assert "for the next log" not in answer["error"], "nothing that could be set"


@pytest.mark.slow
def test_two_runs_at_once_share_a_store(tmp_path):
    logs = tmp_path / "logs"
    logs.mkdir()
    for seed in range(3):
        write_tlog(logs / f"{seed}.tlog", quad_flight(30.0, seed=seed))
    out = tmp_path / "out"
    command = [sys.executable, "-m", "replay", "diagnose", str(logs), "--model=none"]
    both = [subprocess.Popen([*command, f"--out={out}", "--workers=1"]) for _ in range(2)]
    assert [one.wait(HANG_S) for one in both] == [0, 0]
    with Store.open(out) as store:
        (row,) = store.rows("SELECT count(*) AS n, count(DISTINCT sha256) AS logs FROM logs")
    assert (row["n"], row["logs"]) == (3, 3)


@pytest.mark.slow
@pytest.mark.skipif(CHROMIUM is None, reason="no chromium on this machine")
def test_a_real_browser_shows_the_page_of_a_folder(folder, tmp_path):
    out = tmp_path / "out"
    assert main(["run", str(folder), "--out", str(out), "--workers", "2", "--quiet"]) == 0
    with Browser() as browser:
        for size in (PHONE, DESKTOP):
            seen = browser.open((out / "report.html").as_uri(), size)
            assert seen.width <= size[0]
            assert (seen.cut_cells, seen.outside, seen.console, seen.requests) == (0, (), (), ())


def test_a_process_that_dies_is_one_line(tmp_path, monkeypatch):
    write_tlog(tmp_path / "a.tlog", flight(2.0))
    jobs = [
        Job.of("run", tmp_path / "a.tlog", {"--model": model}) for model in ("/no/such/model", None)
    ]
    answers = dict(work(jobs, Place(workers=2, most_s=HANG_S)))
    assert "/no/such/model" in answers[jobs[0]]["error"]
    assert answers[jobs[1]]["decisions"] > 0
    # A python that cannot even start: the process dies, and says so.
    dies = tmp_path / "python"
    dies.write_text("#!/bin/sh\nkill -9 $$\n")
    dies.chmod(0o700)
    monkeypatch.setattr(sys, "executable", str(dies))
    (answer,) = [a for _, a in work(jobs[1:], Place(workers=1, most_s=HANG_S))]
    assert "process died (signal 9)" in answer["error"]


def test_bad_arguments(folder, tmp_path, capsys):
    (tmp_path / "empty").mkdir()
    assert main(["run", str(tmp_path / "empty")]) == 3
    assert main(["run", str(folder), "--workers", "0"]) == 2
    assert main(["run", str(folder), "--scheduler", "nowhere"]) == 2
    assert main(["run", str(folder), "--model", str(tmp_path / "none")]) == 2
    assert main(["diagnose", str(folder), str(folder / "a.tlog")]) == 2
    assert main(["diagnose", str(folder), "--save-model", str(tmp_path / "m")]) == 2
    assert len(capsys.readouterr().err.strip().splitlines()) == 6


def test_a_cell_of_the_table_is_empty_where_a_log_lacks_it(tmp_path):
    answers = [
        {"log": "a", "error": "bad"},
        {"log": "b", "duration_s": 2.0, "refusals_s": {"landed": 1.0}},
    ]
    assert write_table(tmp_path / "table.csv", answers).read_text().splitlines() == [
        "log,error,duration_s,refusals_s.landed",
        "a,bad,,",
        "b,,2.0,1.0",
    ]


def test_interrupted_folder_keeps_what_was_done(folder, tmp_path):
    jobs = [Job.of("run", p, {}) for p in logs_in(folder)[0]]
    keep(tmp_path, jobs[0], perform(jobs[0]))
    (tmp_path / "results" / "x.part").write_text('{"half')
    assert known(tmp_path, jobs[0])["decisions"] > 0
    assert known(tmp_path, jobs[1]) is None


def test_answers_are_read_when_they_are_looked_at(folder, tmp_path):
    jobs = [Job.of("run", p, {}) for p in logs_in(folder)[0]]
    answers = Answers(tmp_path, jobs)
    for number, job in enumerate(jobs):
        keep(tmp_path, job, {"log": "where it was", "duration_s": float(number)})
    assert [a["duration_s"] for a in answers] == [0.0, 1.0, 2.0]
    assert answers[1]["log"] == str(jobs[1].log), "where it lies today"
    keep(tmp_path, jobs[1], {"log": "", "duration_s": 7.0})
    assert [a["duration_s"] for a in answers[1:]] == [7.0, 2.0], "none is held in memory"
    (tmp_path / "results" / f"{jobs[2].name}.json").unlink()
    assert answers[2]["error"] == "its answer is gone"
    assert len(write_table(tmp_path / "table.csv", answers).read_text().splitlines()) == 4


def test_dask_does_the_same_work(folder, tmp_path, capsys):
    distributed = pytest.importorskip(
        "distributed", reason="distributed is not installed (extra: cluster)"
    )
    with distributed.LocalCluster(
        n_workers=1, threads_per_worker=1, processes=False, dashboard_address=None
    ) as cluster:
        out = tmp_path / "out"
        code = main(
            [
                "run",
                str(folder),
                "--out",
                str(out),
                "--scheduler",
                cluster.scheduler_address,
                "--json",
                "-",
            ]
        )
    assert code == 0
    answers = json.loads(capsys.readouterr().out)["logs"]
    assert sorted("error" in a for a in answers) == [False, False, True]


@pytest.mark.slow
def test_as_a_command(folder, tmp_path):
    done = subprocess.run(
        [
            sys.executable,
            "-m",
            "replay",
            "run",
            folder,
            "--out",
            tmp_path / "out",
            "--workers",
            "2",
        ],
        capture_output=True,
        text=True,
        timeout=HANG_S,
    )
    assert done.returncode == 0
    assert "2 of 3 logs" in done.stdout


def test_stamps_of_another_millennium_and_joined_logs_are_no_hindrance(tmp_path):
    joined, future = tmp_path / "joined.tlog", tmp_path / "future.tlog"
    data = write_tlog(tmp_path / "a.tlog", flight(3.0))
    joined.write_bytes(data + data)
    write_tlog(future, flight(3.0, arrival_us=25_970_000_000_000_000))
    for path, date_from in ((joined, "log"), (future, "file")):
        answer = perform(Job.of("run", path, {}))
        assert answer["decisions"] > 100
        assert answer["date_from"] == date_from
        assert answer["date"].startswith("20")


@pytest.mark.slow
def test_a_log_that_takes_too_long_fails_for_a_passing_reason(folder, tmp_path, capsys):
    out = tmp_path / "out"
    asked = ["run", str(folder), "--out", str(out), "--json", "-"]
    assert main([*asked, "--log-minutes", "0.001"]) == 3
    answers = json.loads(capsys.readouterr().out)["logs"]
    assert [a["passing"] for a in answers] == [True] * 3
    assert all("took more than 0.001 min" in a["error"] for a in answers)
    assert main(asked) == 3, "known from before"
    capsys.readouterr()
    assert main([*asked, "--retry"]) == 0
    answers = json.loads(capsys.readouterr().out)["logs"]
    assert sorted("error" in a for a in answers) == [False, False, True]


def test_a_log_that_needs_more_memory_than_its_share_fails_for_a_passing_reason(folder):
    small = Place(workers=1, most_s=HANG_S, most_bytes=50e6)
    ((_, answer),) = work([Job.of("run", folder / "a.tlog", {})], small)
    assert answer["passing"]
    assert "memory" in answer["error"]


def test_options_without_effect_and_limits_that_are_none_are_refused(folder, capsys):
    log = str(folder / "a.tlog")
    assert main(["run", str(folder), "--scheduler", "tcp://a:1", "--workers", "2"]) == 2
    assert "--workers: is of this machine" in capsys.readouterr().err
    for option in (["--log-minutes", "0"], ["--log-gb", "-1"], ["--log-gb", "nan"]):
        assert main(["run", str(folder), *option]) == 2
        assert option[0] in capsys.readouterr().err
    for command in ("run", "diagnose"):
        for option in (["--workers", "0"], ["--retry"], ["--scheduler", "tcp://a:1"]):
            assert main([command, log, *option]) == 2
            assert f"{option[0]}: is of a folder of logs" in capsys.readouterr().err

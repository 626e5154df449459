"""A fleet's store: how long questions take, what a season costs, and whether changes are found.

    python tests/benchmarks speed.fleet [--answers 10000] [--vehicles 50] [--result FILE]

The answers of the store are made up: one size that varies from flight to flight, and on every fifth
vehicle a step in the middle of its season. So what is found can be judged.
"""

from __future__ import annotations

import resource
import tempfile
import time
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import command_line
import numpy as np
from browser import CHROMIUM, DESKTOP, Browser
from result_file import add_option, counted, figure, write_result

from replay.fleet.season import Season, season
from replay.fleet.season_page import page
from replay.fleet.store import NAME, Store

STEP_EVERY = 5
STEP = 0.06
SPREAD = 0.01
"""Every fifth vehicle changes by six standard deviations of what flights differ by."""
QUESTIONS = {
    "verdicts": "SELECT verdict, count(*) FROM logs GROUP BY verdict",
    "vehicles by effect": "SELECT effect, count(DISTINCT vehicle) FROM effects JOIN logs USING (sha256, question) "
    "GROUP BY effect",
    "one vehicle's thrust": "SELECT date, value, low, high FROM logs JOIN effects USING (sha256, question) "
    "WHERE vehicle = (SELECT max(vehicle) FROM logs) AND effect = 'thrust_scale' ORDER BY date",
    "logs that cannot be judged": "SELECT error, count(*) FROM logs WHERE error IS NOT NULL GROUP BY error",
    "vehicles drifted since June": "SELECT vehicle, avg(value) FROM logs JOIN effects USING (sha256, question) "
    "WHERE effect = 'thrust_scale' AND date >= '2026-06' GROUP BY vehicle HAVING abs(avg(value)) > 0.03",
}

LOADED_MS = """
new Promise(done => requestAnimationFrame(() => requestAnimationFrame(() => done(Math.max(
    performance.getEntriesByType('navigation')[0].loadEventEnd,
    performance.getEntriesByName('first-contentful-paint')[0].startTime)))))
"""
"""From the start until the page is loaded and drawn."""


def made_up(vehicle: int, flight: int, flights: int, rng: np.random.Generator) -> dict[str, Any]:
    """The answer to one log."""
    stepped = vehicle % STEP_EVERY == 0 and flight >= flights // 2
    value = SPREAD * float(rng.standard_normal()) + (STEP if stepped else 0.0)
    months, day = divmod(flight, 28)
    years, month = divmod(months, 12)
    answer: dict[str, Any] = {
        "sha256": f"{vehicle:03d}-{flight:06d}",
        "log": f"/archive/{vehicle}/{flight}.BIN",
        "date": f"{2026 + years}-{month + 1:02d}-{day + 1:02d}T08:00:00Z",
        "date_from": "log",
        "identity": {"vehicle": f"board-{vehicle}", "board": str(vehicle), "firmware": "made up", "frame": "quad-x"},
        "verdict": "explained",
        "duration_s": 300.0,
        "axes": {"Fx": {}, "Fy": {}, "Fz": {}},
        "version": "made up",
        "wall_s": 3.0,
        "effects": [],
    }  # fmt: skip
    size = {"value": value, "ci95": [value - 0.01, value + 0.01], "unit": "1"}
    answer["effects"] = [
        {
            "name": "thrust_scale",
            "parameters": {"scale": size},
            "probability": 0.98,
            "explains": 0.4,
            "kept": True,
        }
    ]
    if rng.random() < 0.02:
        answer |= {"error": "no accelerometer", "effects": []}
    return answer


@contextmanager
def timed(times: dict[str, float], name: str) -> Iterator[None]:
    """Seconds of a block."""
    start = time.perf_counter()
    yield
    times[name] = time.perf_counter() - start


def fill(store: Store, vehicles: int, flights: int) -> None:
    """Made-up answers of all vehicles."""
    rng = np.random.default_rng(0)
    for flight in range(flights):
        for vehicle in range(vehicles):
            store.add("made up", made_up(vehicle, flight, flights, rng))


def judged(found: Season, flights: int) -> tuple[list[bool], list[bool]]:
    """Of vehicles that changed: found within two flights of the change; of the others: no change told."""
    right = []
    silent = []
    for v in found.vehicles:
        number = int(v.vehicle.removeprefix("board-"))
        if number % STEP_EVERY:
            silent.append(not v.changed)
            continue
        since = [int(Path(c.change.since).stem) for c in v.changed if c.change is not None]
        right.append(any(abs(s - flights // 2) <= 2 for s in since))
    return right, silent


def asked(store: Store, times: dict[str, float]) -> tuple[int, float]:
    """Five questions and the season; bytes of its page, and the most memory [MiB] of this process."""
    for text, question in QUESTIONS.items():
        with timed(times, f"question: {text}"):
            store.rows(question)
    with timed(times, "season"):
        found = season(store)
    with timed(times, "its page"):
        text = page(found)
    if CHROMIUM is not None:
        times["the page opens"] = opened_s(text)
    return len(text), resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024.0


def opened_s(text: str) -> float:
    """Until a browser has loaded and drawn a page."""
    with tempfile.TemporaryDirectory() as name, Browser() as browser:
        file = Path(name) / "page.html"
        file.write_text(text, encoding="utf-8")
        browser.open(file.as_uri(), DESKTOP)
        return float(browser.value(LOADED_MS)) / 1000.0


def asked_figures(
    times: Mapping[str, float], answers: str, size: int, peak: float
) -> list[dict[str, Any]]:
    """Of ``asked``."""
    slowest = max(t for text, t in times.items() if text.startswith("question"))
    whole = times["season"] + times["its page"]
    return [
        figure("slowest of five questions", f"{slowest:.2f} s", answers, "1 s", slowest <= 1.0),
        figure(
            "season and its page", f"{whole:.2f} s", f"{size / 1e6:.1f} MB", "2 s", whole <= 2.0
        ),
        figure("memory of all that", f"{peak:.0f} MiB"),
        *opened_figure(times.get("the page opens")),
    ]


def opened_figure(seconds: float | None) -> list[dict[str, Any]]:
    """Empty without a browser on this machine."""
    if seconds is None:
        return []
    return [figure("the page opens in Chromium", f"{seconds:.2f} s", "", "2 s", seconds <= 2.0)]


def main(argv: list[str] | None = None) -> int:
    """Exit code 1 where a goal is missed."""
    p = command_line.parser(__doc__)
    p.add_argument("--answers", type=int, default=10_000)
    p.add_argument("--vehicles", type=int, default=50)
    add_option(p)
    a = p.parse_args(argv)
    flights = a.answers // a.vehicles
    times: dict[str, float] = {}
    with tempfile.TemporaryDirectory() as name, Store.open(Path(name) / NAME, make=True) as store:
        with timed(times, "answers put into the store"):
            fill(store, a.vehicles, flights)
        size, peak = asked(store, times)
        right, silent = judged(season(store), flights)
    figures = [
        *asked_figures(times, f"{a.answers} answers", size, peak),
        counted("vehicles that changed: found within two flights", right, least=0.9),
        counted("vehicles that did not change: nothing told", silent, least=0.98),
        figure("answers put into the store a second", f"{a.answers / times['answers put into the store']:.0f}"),
    ]  # fmt: skip
    for text, seconds in times.items():
        print(f"{text}: {seconds:.3f} s")
    for one in figures:
        print(f"{one['what']}: {one['value']} {one.get('detail', '')}")
    write_result(a, figures, seeds="made up, seed 0", simulated=True)
    return int(any(one.get("met") is False for one in figures))


if __name__ == "__main__":
    raise SystemExit(main())

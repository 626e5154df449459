"""The same log, the same answer on any processor: diagnosed under several linear-algebra kernels. Simulated."""

from __future__ import annotations

from pathlib import Path

import pytest
from diagnosis.one_answer import Asked
from log_writers import quad_flight, write_tlog
from regression import kernels
from regression.kernels import Job, Kernel

from companion.vehicles import QUAD

FLIGHTS: dict[str, dict[str, float]] = {
    "heavy_short": {"seconds": 30.0, "mass_kg": 3.3},
    "heavy_long": {"seconds": 60.0, "mass_kg": 3.3, "seed": 3},
    "nothing_missing": {"seconds": 40.0, "seed": 5},
    "gust": {"seconds": 40.0, "gust_n": 1.5, "seed": 7},
}
TOGETHER = ("heavy_short", "heavy_long")


@pytest.fixture(scope="module")
def usable() -> tuple[Kernel, ...]:
    found = kernels.usable()
    if len(found) < 2:
        pytest.skip(
            f"this processor runs {len(found)} of the kernels {', '.join(k.name for k in kernels.KERNELS)}"
        )
    return found


@pytest.mark.slow
@pytest.mark.timeout(900)
def test_names_and_sizes_do_not_depend_on_the_kernel(
    usable: tuple[Kernel, ...], tmp_path: Path
) -> None:
    for name, options in FLIGHTS.items():
        write_tlog(tmp_path / f"{name}.tlog", quad_flight(**options))
    jobs = [Job(name, (tmp_path / f"{name}.tlog",), Path(str(QUAD))) for name in FLIGHTS]
    jobs.append(
        Job("together", tuple(tmp_path / f"{name}.tlog" for name in TOGETHER), Path(str(QUAD)))
    )
    answers = kernels.run(jobs, usable, at_a_time=2, timeout_s=600.0)
    assert {a.exit_code for of_job in answers.values() for a in of_job.values()} == {0}
    assert {
        name: unlike for name, of_job in answers.items() if (unlike := kernels.differences(of_job))
    } == {}


def asked(*names: str, value: float = 1.0, verdict: str = "explained") -> Asked:
    effects = [
        {"name": n, "parameters": {"gain": {"value": value, "ci95": [0.9, 1.1], "unit": "1"}}}
        for n in names
    ]
    return Asked({"verdict": verdict, "effects": effects, "aliases": []}, 0, "", 0.0)


def test_another_name_another_verdict_or_another_size_is_a_difference() -> None:
    one = asked("wind")
    assert not kernels.differences({"Haswell": one, "SkylakeX": asked("wind", value=1.0005)})
    for other in (asked("payload"), asked("wind", "payload"), asked("wind", verdict="unexplained")):
        assert kernels.differences({"Haswell": one, "SkylakeX": other})
    (unlike,) = kernels.differences({"Haswell": one, "SkylakeX": asked("wind", value=1.05)})
    assert "wind.gain 1.05" in unlike


def test_a_refusal_under_one_kernel_alone_is_a_difference() -> None:
    assert kernels.differences(
        {"Haswell": asked("wind"), "SkylakeX": Asked(None, 3, "too short", 0.0)}
    )
    refused = Asked(None, 3, "too short", 0.0)
    assert not kernels.differences({"Haswell": refused, "SkylakeX": refused})

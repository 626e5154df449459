"""Log formats of other packages: found by suffix, and named where they are broken."""

from __future__ import annotations

import os
import re
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest

from models.common.errors import LogError
from replay.logs.formats import known_suffixes, load
from replay.logs.plugins import GROUP

ROOT = Path(__file__).resolve().parents[2]
EXAMPLES = ROOT / "docs" / "examples"


def install(site: Path, name: str, entries: dict[str, str]) -> None:
    """What pip writes of a package with these entry points."""
    info = site / f"{name.replace('-', '_')}-1.0.dist-info"
    info.mkdir()
    (info / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {name}\nVersion: 1.0\n")
    lines = [f"[{GROUP}]", *(f"{suffix} = {target}" for suffix, target in entries.items())]
    (info / "entry_points.txt").write_text("\n".join(lines) + "\n")


@pytest.fixture
def site(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    folder = tmp_path / "site"
    folder.mkdir()
    monkeypatch.syspath_prepend(str(folder))
    return folder


@pytest.fixture
def log(tmp_path: Path) -> Path:
    rows = ["t_s,qw,qx,qy,qz,ax,ay,az,p,q,r"]
    for k in range(100):
        rows.append(f"{0.02 * k:.2f},1,0,0,0,0,0,-9.81,0,0,0")
    path = tmp_path / "flight.MYCSV"
    path.write_text("\n".join(rows) + "\n")
    return path


def test_the_package_of_the_manual_reads_its_log_in_every_command(site: Path, log: Path) -> None:
    page = (ROOT / "docs" / "library.md").read_text()
    (block,) = re.findall(r"```toml\n(.*?)```", page, re.S)
    project = tomllib.loads(block)["project"]
    install(site, project["name"], project["entry-points"][GROUP])
    places = [str(site), str(EXAMPLES), str(ROOT)]
    done = subprocess.run(
        [sys.executable, "-m", "replay", "info", str(log)],
        env={**os.environ, "PYTHONPATH": os.pathsep.join(places)},
        capture_output=True,
        text=True,
    )
    assert done.returncode == 0, done.stderr
    assert "flight.MYCSV" in done.stdout


def test_a_flight_is_loaded_and_its_suffix_known(
    site: Path, log: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.syspath_prepend(str(EXAMPLES))
    install(site, "my-logs", {"mycsv": "own_log_format:read", "bin": "own_log_format:read"})
    assert known_suffixes() == (".tlog", ".bin", ".ulg", ".mycsv")
    (flight,) = load(log)
    assert flight.attitude is not None
    assert len(flight.attitude) == 100
    log.write_text("another table\n")
    with pytest.raises(LogError, match="its first line is not"):
        load(log)


@pytest.mark.parametrize(
    ("module", "words"),
    [
        ("import no_such_library", "cannot be loaded .ModuleNotFoundError.*no_such_library"),
        ("", "cannot be loaded .AttributeError"),
        ("def read(path):\n    return 1 / 0", "broke .ZeroDivisionError: division by zero"),
        ("def read(path):\n    return ['a flight']", "gave no FlightLog"),
        ("def read(path):\n    return []", "gave no FlightLog"),
    ],
)
def test_a_broken_package_is_one_line_with_its_name(
    site: Path, log: Path, module: str, words: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    (site / "broken_reader.py").write_text(module + "\n")
    monkeypatch.delitem(sys.modules, "broken_reader", raising=False)
    install(site, "broken-logs", {"mycsv": "broken_reader:read"})
    with pytest.raises(LogError, match=words) as caught:
        load(log)
    assert "broken-logs" in str(caught.value)
    assert "\n" not in str(caught.value)


def test_two_packages_for_one_suffix_are_both_named(site: Path, log: Path) -> None:
    for name in ("one-log", "other-log"):
        install(site, name, {"mycsv": f"{name}:read"})
    with pytest.raises(LogError, match="one-log and other-log"):
        load(log)

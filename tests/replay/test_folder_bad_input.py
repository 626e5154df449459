"""Folders as they are found: full disks, files of others, links in circles, many of one name, logs that still grow."""

from __future__ import annotations

import io
import os
import re
import resource
import tempfile
from collections.abc import Callable, Iterator
from contextlib import redirect_stderr
from pathlib import Path
from typing import Any

import pytest
from log_writers import quad_flight, write_tlog

from companion.vehicles import QUAD
from models.common.errors import ConfigError
from models.common.pages.document import write_document
from models.common.text_file import replaced
from replay.cli import main
from replay.fleet import page as folder_page
from replay.fleet.contents import contents
from replay.fleet.page import page
from replay.fleet.results import logs_in, write_table
from replay.fleet.store import NAME, Store

NOBODY = 65534


@pytest.fixture
def full_disk() -> Iterator[None]:
    """No file may grow above 1 kB."""
    limits = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (1000, limits[1]))
    yield
    resource.setrlimit(resource.RLIMIT_FSIZE, limits)


@pytest.mark.usefixtures("full_disk")
def test_a_full_disk_leaves_the_old_table_and_page_whole(tmp_path: Path) -> None:
    table = write_table(tmp_path / "table.csv", [{"log": "old"}])
    document = write_document("--report", tmp_path / "report.html", "old")
    with pytest.raises(ConfigError, match=r"--out .*table\.csv: cannot be written"):
        write_table(table, [{"log": "new" * 100, "date": str(i)} for i in range(100)])
    with pytest.raises(ConfigError, match=r"--report .*report\.html: cannot be written"):
        write_document("--report", document, "new" * 1000)
    assert table.read_text() == "log\nold\n"
    assert document.read_text() == "old"
    assert sorted(os.listdir(tmp_path)) == ["report.html", "table.csv"], "and no other file"


@pytest.mark.usefixtures("full_disk")
def test_a_full_disk_is_one_line_of_the_store(tmp_path: Path) -> None:
    with (
        pytest.raises(ConfigError, match=NAME),
        Store.open(tmp_path / NAME, make=True),
    ):
        pass


def test_a_device_is_written_directly() -> None:
    with replaced("--csv", Path("/dev/null")) as part:
        part.write_text("rows")
    assert Path("/dev/null").is_char_device()


def test_a_link_stays_a_link(tmp_path: Path) -> None:
    (tmp_path / "elsewhere.csv").write_text("old")
    (tmp_path / "link.csv").symlink_to(tmp_path / "elsewhere.csv")
    with replaced("--csv", tmp_path / "link.csv") as part:
        part.write_text("new")
    assert (tmp_path / "link.csv").is_symlink()
    assert (tmp_path / "elsewhere.csv").read_text() == "new"


def test_links_in_circles_are_met_once(tmp_path: Path) -> None:
    logs = tmp_path / "logs"
    logs.mkdir()
    (logs / "a.tlog").write_bytes(b"a")
    (logs / "back").symlink_to(logs)
    (logs / "one.tlog").symlink_to(logs / "other.tlog")
    (logs / "other.tlog").symlink_to(logs / "one.tlog")
    assert logs_in(logs) == ([logs / "a.tlog"], [])


def test_ten_logs_of_one_name_are_ten_logs(tmp_path: Path) -> None:
    paths = [tmp_path / str(day) / "flight.tlog" for day in range(10)]
    for path in paths:
        path.parent.mkdir()
        path.write_bytes(str(path).encode())
    assert len(contents(paths, None).logs) == 10
    text = page("season", [failed(path, "") for path in paths])
    assert all(f"<td>{day}/flight.tlog<br>" in text for day in range(10))


def failed(log: Path, date: str) -> dict[str, Any]:
    return {"log": str(log), "error": "bad", "date": date, "page": None}


def test_the_page_of_many_logs_has_rows_of_the_latest(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(folder_page, "MOST_ROWS", 2)
    answers = [failed(tmp_path / f"{day}.tlog", f"2026-05-{day:02d}") for day in (12, 10, 11)]
    text = page("season", answers)
    assert re.findall(r"<td>(\d+)\.tlog<br>", text) == ["12", "11"]
    assert "The latest 2 of 3 logs; all are in table.csv." in text


def as_nobody(work: Callable[[], str]) -> str:
    """What a function returns in a process of another user."""
    to_read, to_write = os.pipe()
    child = os.fork()
    if child == 0:
        os.setgid(NOBODY)
        os.setuid(NOBODY)
        os.write(to_write, work().encode())
        os._exit(0)
    os.close(to_write)
    with os.fdopen(to_read, encoding="utf-8") as said:
        text = said.read()
    os.waitpid(child, 0)
    return text


@pytest.fixture
def open_folder() -> Iterator[Path]:
    """For everybody."""
    with tempfile.TemporaryDirectory() as name:
        Path(name).chmod(0o755)
        yield Path(name)


@pytest.mark.skipif(os.getuid() != 0, reason="only root can become another user")
def test_what_may_not_be_read_is_one_line_each(open_folder: Path) -> None:
    (open_folder / "closed").mkdir(mode=0o700)
    (open_folder / "closed" / "b.tlog").write_bytes(b"b")
    (open_folder / "a.tlog").write_bytes(b"a")
    (open_folder / "secret.tlog").write_bytes(b"secret")
    (open_folder / "secret.tlog").chmod(0o600)

    def work() -> str:
        with redirect_stderr(io.StringIO()) as said:
            paths, notes = logs_in(open_folder)
            found = contents(paths, None).logs.values()
        return "\n".join([*(path.name for path in found), *notes, said.getvalue().strip()])

    assert as_nobody(work).splitlines() == [
        "a.tlog",
        f"{open_folder / 'closed'}: Permission denied",
        f"replay: {open_folder / 'secret.tlog'}: Permission denied",
    ]


def test_a_log_that_grew_is_told_from_one_that_was_replaced(tmp_path: Path) -> None:
    log = tmp_path / "a.tlog"
    with Store.open(tmp_path / NAME, make=True) as store:
        log.write_bytes(b"first half")
        (half,) = contents([log], store).logs
        log.write_bytes(b"first half, second half")
        found = contents([log], store)
        assert found.grown == ((log, half),)
        log.write_bytes(b"something else, which is longer")
        assert contents([log], store).grown == ()
        copy = tmp_path / "copy.tlog"
        copy.write_bytes(log.read_bytes())
        log.write_bytes(log.read_bytes() + b" and grows")
        assert contents([copy, log], store).grown == (), "there is still a log that ends there"


@pytest.mark.slow
def test_a_log_that_is_still_written_is_one_log_in_the_end(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    logs = tmp_path / "logs"
    logs.mkdir()
    log = logs / "a.tlog"
    write_tlog(log, quad_flight(40.0, seed=1))
    whole = log.read_bytes()
    log.write_bytes(whole[: len(whole) // 2])
    out = tmp_path / "out"
    options = ["--vehicle", str(QUAD), "--model", "none", "--workers", "1", "--out", str(out)]
    assert main(["diagnose", str(logs), *options]) == 0
    log.write_bytes(whole)
    capsys.readouterr()
    assert main(["diagnose", str(logs), *options]) == 0
    assert "a.tlog: has grown since it was answered" in capsys.readouterr().err
    with Store.open(out) as store:
        (row,) = store.rows("SELECT judged_s FROM logs")
    assert row["judged_s"] > 25.0

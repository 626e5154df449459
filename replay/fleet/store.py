"""The store of a folder's answers: one SQLite file that anybody can query.

SQLite, since it is part of Python, is one file, and lets several runs write in turn. A log is known by its content
(sha256), so that a copy or a moved archive is no new log. Tables and columns: docs/formats.md.
"""

from __future__ import annotations

import sqlite3
from collections.abc import Iterator, Mapping, Sequence
from contextlib import closing, contextmanager
from pathlib import Path
from typing import Any

from models.common.errors import ConfigError

Row = sqlite3.Row
NAME = "store.sqlite"
SCHEMA = 1
WAIT_S = 60.0
"""So long a run waits for another one that writes."""
_TABLES = """
CREATE TABLE IF NOT EXISTS meta (key TEXT PRIMARY KEY, value TEXT NOT NULL);
CREATE TABLE IF NOT EXISTS logs (
    sha256 TEXT NOT NULL, question TEXT NOT NULL, path TEXT NOT NULL,
    vehicle TEXT, board TEXT, firmware TEXT, frame TEXT, parameters TEXT,
    date TEXT, date_from TEXT, verdict TEXT, judged_s REAL, axes TEXT,
    error TEXT, passing INTEGER NOT NULL, version TEXT, wall_s REAL,
    PRIMARY KEY (sha256, question)
);
CREATE TABLE IF NOT EXISTS effects (
    sha256 TEXT NOT NULL, question TEXT NOT NULL, effect TEXT NOT NULL, parameter TEXT NOT NULL,
    value REAL, low REAL, high REAL, unit TEXT, probability REAL, explains REAL, kept INTEGER,
    since_s REAL
);
CREATE TABLE IF NOT EXISTS faults (
    sha256 TEXT NOT NULL, question TEXT NOT NULL, channel TEXT NOT NULL, what TEXT NOT NULL
);
CREATE TABLE IF NOT EXISTS files (
    path TEXT PRIMARY KEY, bytes INTEGER NOT NULL, changed_ns INTEGER NOT NULL, sha256 TEXT NOT NULL
);
CREATE TABLE IF NOT EXISTS identities (
    sha256 TEXT PRIMARY KEY, vehicle TEXT NOT NULL, board TEXT NOT NULL, firmware TEXT NOT NULL,
    frame TEXT NOT NULL, parameters TEXT NOT NULL
);
CREATE TABLE IF NOT EXISTS drafts (
    name TEXT PRIMARY KEY, logs INTEGER NOT NULL, given TEXT NOT NULL, facts TEXT NOT NULL
);
CREATE INDEX IF NOT EXISTS effects_of_log ON effects (sha256, question);
CREATE INDEX IF NOT EXISTS faults_of_log ON faults (sha256, question);
CREATE INDEX IF NOT EXISTS logs_of_vehicle ON logs (vehicle, date);
"""


class Store:
    """Answers on disk; every answer is written whole or not at all."""

    def __init__(self, path: Path, connection: sqlite3.Connection) -> None:
        self.path = path
        self._connection = connection

    @classmethod
    @contextmanager
    def open(cls, path: Path, *, make: bool = False) -> Iterator[Store]:
        """The store in a file, or in the folder of one. Raises ConfigError where it is none, or of another schema."""
        file = path / NAME if path.is_dir() else path
        if not make and not file.is_file():
            raise ConfigError(f"{path}: holds no {NAME}; replay diagnose FOLDER writes one")
        try:
            with closing(sqlite3.connect(file, timeout=WAIT_S)) as connection:
                connection.row_factory = sqlite3.Row
                _prepare(file, connection)
                yield cls(file, connection)
        except sqlite3.Error as error:
            raise ConfigError(f"{file}: {error}") from None

    @classmethod
    @contextmanager
    def look(cls, path: Path) -> Iterator[Store]:
        """Only to read, beside a run that writes. Raises ConfigError where there is none yet."""
        file = path / NAME
        try:
            with closing(sqlite3.connect(f"{file.as_uri()}?mode=ro", uri=True)) as connection:
                connection.row_factory = sqlite3.Row
                yield cls(file, connection)
        except sqlite3.Error as error:
            raise ConfigError(f"{file}: {error}") from None

    def last(self) -> int:
        """A number that grows with every answer that is put in."""
        (row,) = self.rows("SELECT coalesce(max(rowid), 0) AS last FROM logs")
        return int(row["last"])

    def add(self, question: str, answer: Mapping[str, Any]) -> None:
        """Put an answer in place of an older one to the same question about the same log."""
        key = (answer["sha256"], question)
        row = log_row(question, answer)
        marks = ", ".join("?" * len(row))
        with self._connection as c:
            for table in ("effects", "faults"):
                c.execute(f"DELETE FROM {table} WHERE sha256 = ? AND question = ?", key)
            c.execute(
                f"INSERT OR REPLACE INTO logs ({', '.join(row)}) VALUES ({marks})",
                tuple(row.values()),
            )
            for effect in answer.get("effects", ()):
                for numbers in effect_rows(effect):
                    c.execute(
                        "INSERT INTO effects VALUES (?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?)",
                        (*key, *numbers),
                    )
            for fault in answer.get("log_faults", ()):
                c.execute(
                    "INSERT INTO faults VALUES (?, ?, ?, ?)",
                    (*key, fault["channel"], fault["what"]),
                )

    def forget(self, sha256: str) -> None:
        """All that is known of a log: it was the beginning of another one."""
        with self._connection as c:
            for table in ("logs", "effects", "faults", "identities"):
                c.execute(f"DELETE FROM {table} WHERE sha256 = ?", (sha256,))

    def put(self, table: str, rows: Sequence[tuple[Any, ...]]) -> None:
        """Whole rows of a table, in place of older ones of the same key."""
        if not rows:
            return
        marks = ", ".join("?" * len(rows[0]))
        with self._connection as c:
            c.executemany(f"INSERT OR REPLACE INTO {table} VALUES ({marks})", rows)

    def rows(
        self, query: str, values: tuple[Any, ...] | Mapping[str, Any] = ()
    ) -> list[sqlite3.Row]:
        """What a query finds."""
        return self._connection.execute(query, values).fetchall()


def _prepare(file: Path, connection: sqlite3.Connection) -> None:
    """Tables of a new store; one of another schema is left as it is."""
    tables = "SELECT count(*) AS count FROM sqlite_master WHERE type = 'table'"
    if connection.execute(tables).fetchone()["count"]:
        found = connection.execute("SELECT value FROM meta WHERE key = 'schema'").fetchone()
        schema = None if found is None else found["value"]
        if schema != str(SCHEMA):
            raise ConfigError(
                f"{file}: is a store of schema {schema}, and this version writes {SCHEMA}; give "
                "another --out"
            )
    connection.execute("PRAGMA journal_mode = WAL")
    # A kill loses nothing; a power cut may lose the last answers, which their files still hold.
    connection.execute("PRAGMA synchronous = NORMAL")
    connection.executescript(_TABLES)
    with connection:
        connection.execute("INSERT OR IGNORE INTO meta VALUES ('schema', ?)", (str(SCHEMA),))


def log_row(question: str, answer: Mapping[str, Any]) -> dict[str, Any]:
    """The row of a log, by column."""
    identity = answer.get("identity", {})
    return {
        "sha256": answer["sha256"],
        "question": question,
        "path": answer["log"],
        "vehicle": identity.get("vehicle"),
        "board": identity.get("board"),
        "firmware": identity.get("firmware"),
        "frame": identity.get("frame"),
        "parameters": identity.get("parameters"),
        "date": answer.get("date"),
        "date_from": answer.get("date_from"),
        "verdict": answer.get("verdict"),
        "judged_s": answer.get("duration_s"),
        "axes": " ".join(answer.get("axes", ())),
        "error": answer.get("error"),
        "passing": int(bool(answer.get("passing"))),
        "version": answer.get("version"),
        "wall_s": answer.get("wall_s"),
    }


def effect_rows(effect: Mapping[str, Any]) -> Iterator[tuple[Any, ...]]:
    """A row for every parameter of an effect; one without a number where it has none."""
    common = (
        effect.get("probability"),
        effect.get("explains"),
        int(bool(effect.get("kept"))),
        effect.get("since_s"),
    )
    parameters = effect.get("parameters") or {"": {}}
    for name, number in parameters.items():
        low, high = number.get("ci95") or (None, None)
        yield (
            effect["name"],
            name,
            number.get("value"),
            low,
            high,
            number.get("unit"),
            *common,
        )

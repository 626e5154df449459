"""The work on one log of a folder, as a function of plain values: it runs in any process on any machine."""

from __future__ import annotations

import hashlib
import json
import struct
import time
from dataclasses import asdict, dataclass, field, replace
from datetime import UTC, datetime
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Any

from models.errors import UserError
from models.vehicle import Vehicle
from models.version import installed_version
from replay.vehicle.draft import Given

if TYPE_CHECKING:
    from replay.diagnosis.answer import Diagnosis

_EARLIEST_US, _LATEST_US = 1_100_000_000_000_000, 4_000_000_000_000_000
"""2004 and 2096: receiver stamps outside are no date."""


class Kind(StrEnum):
    """What is asked of every log."""

    RUN = "run"
    DIAGNOSE = "diagnose"


@dataclass(frozen=True)
class Job:
    """One log and everything that its answer depends on."""

    kind: Kind
    path: str
    vehicle: str | None
    model: str | None
    target_system: int | None = None
    setpoint: str = "hold"
    assumed: tuple[tuple[str, float], ...] = ()
    adapt: str = "off"
    given: Given = field(default_factory=Given)
    """What is known of a vehicle that is drafted."""
    pages: str | None = None
    """Folder for the page of this log; None: no page."""

    @classmethod
    def of(cls, kind: Kind, path: Path, vehicle: Path | None, model: str | None, **options: Any) -> Job:
        """A job that any process can do: places are absolute."""
        file = None if vehicle is None else str(vehicle.resolve())
        folder = str(Path(model).resolve()) if model is not None and Path(model).is_dir() else model
        return cls(kind, str(path), file, folder, **options)

    def key(self) -> str:
        """Changes with log, vehicle file, model, options and program: an old answer is then void."""
        stat = Path(self.path).stat()
        question = {
            **asdict(self),
            "version": installed_version(),
            "size": stat.st_size,
            "changed_ns": stat.st_mtime_ns,
        }
        digest = hashlib.sha256(json.dumps(question, sort_keys=True).encode())
        for name in (self.vehicle, *(f"{self.model}/{f}" for f in ("model.json", "weights.npz") if self.model)):
            if name is not None and Path(name).is_file():
                digest.update(Path(name).read_bytes())
        return digest.hexdigest()[:20]


def perform(job: Job) -> dict[str, Any]:
    """The answer on one log as JSON; a log that cannot be used gives ``error`` instead. Never raises for a bad log."""
    start = time.monotonic()
    head = {"log": job.path, **recorded(Path(job.path))}
    try:
        answer = _answer(job)
    except UserError as error:
        answer = {"error": str(error).removeprefix(f"{job.path}: ")}
    except MemoryError:
        answer = {"error": "needs more memory than there is: cut it, or use another machine"}
    except Exception as error:  # a log that breaks the reader must not stop the others
        answer = {"error": f"the program failed ({type(error).__name__}: {error}); please report it"}
    return {**head, **answer, "wall_s": round(time.monotonic() - start, 2)}


def _answer(job: Job) -> dict[str, Any]:
    from replay.command import declared, of_logs

    if job.kind == Kind.DIAGNOSE:
        from replay.diagnosis.diagnose import diagnose

        vehicle, chosen, draft = of_logs(job.vehicle, job.model, [Path(job.path)], job.given, job.target_system)
        answer = diagnose([Path(job.path)], vehicle, chosen.judged, target_system=job.target_system)
        answer = replace(answer, notes=(*(draft.notes if draft else ()), *answer.notes))
        page = {} if job.pages is None else {"page": _write_page(job, answer, vehicle)}
        return {"vehicle": vehicle.name, "system": answer.records[0].system, **answer.as_json(None), **page}
    vehicle, chosen = declared(job.vehicle, job.model)
    from companion.adapt_options import Adapt
    from companion.config import Base, PipelineConfig
    from replay.rerun.report import run

    base = Base.HOLD if job.setpoint == "hold" else Base.UPSTREAM
    config = PipelineConfig(vehicle=vehicle, model=chosen.model, base=base, dry_run=True, adapt=Adapt(job.adapt))
    return run(Path(job.path), config, chosen.name, job.target_system, dict(job.assumed)).as_json()


def _write_page(job: Job, answer: Diagnosis, vehicle: Vehicle) -> str:
    """The log's own page; its name carries the job's key, as logs of several folders may have one name."""
    from models.pages.document import write_document
    from replay.diagnosis.html_report import page

    assert job.pages is not None
    target = Path(job.pages) / f"{Path(job.path).stem}-{job.key()}.html"
    return str(write_document("--report", target, page(answer, vehicle)))


def recorded(path: Path) -> dict[str, str]:
    """When the log was recorded: the first receiver stamp of a .tlog, else when the file was last changed."""
    stamp = None
    try:
        if path.suffix.lower() == ".tlog":
            with path.open("rb") as file:
                head = file.read(8)
            stamp = struct.unpack(">Q", head)[0] if len(head) == 8 else None
        if stamp is None or not _EARLIEST_US < stamp < _LATEST_US:
            return {"date": _text(path.stat().st_mtime), "date_from": "file"}
    except OSError:
        return {"date": "", "date_from": "unknown"}
    return {"date": _text(stamp / 1e6), "date_from": "log"}


def _text(epoch_s: float) -> str:
    return datetime.fromtimestamp(epoch_s, UTC).strftime("%Y-%m-%dT%H:%M:%SZ")

"""Log formats of other packages: entry points of the group ``corner.log_formats``.

The name of an entry point is the suffix without its dot, its value a function ``read(path) -> list[FlightLog]``.
"""

from __future__ import annotations

from importlib.metadata import EntryPoint, entry_points
from pathlib import Path
from typing import Any, Protocol

from models.common.errors import LogError, UserError
from replay.flightlog import FlightLog

GROUP = "corner.log_formats"


class LogReader(Protocol):
    """What an entry point ``corner.log_formats`` names: a function that reads a log format.

    Examples
    --------
    The entry point ``mycsv = "own_log_format:read"`` of a package reads ``flight.mycsv``:

    >>> from pathlib import Path
    >>> import numpy as np
    >>> from replay import FlightLog
    >>> from replay.flightlog import Series
    >>> def read(path: Path) -> list[FlightLog]:
    ...     t_s = np.arange(3.0)
    ...     level = Series(t_s, np.tile([1.0, 0.0, 0.0, 0.0], (3, 1)))
    ...     return [FlightLog(path=path, system=1, boot=0, start_s=0.0, end_s=2.0, attitude=level)]
    >>> read(Path("flight.mycsv"))[0].duration_s
    2.0
    """

    def __call__(self, path: Path, /) -> list[FlightLog]:
        """Read one file.

        Parameters
        ----------
        path : Path
            The log.

        Returns
        -------
        list of FlightLog
            One for each boot, at least one: SI, world NED, body FRD.

        Raises
        ------
        LogError
            It cannot be read. Any other exception becomes one that names the package.
        """


def plugin_suffixes() -> tuple[str, ...]:
    """Suffixes that installed packages read, in lower case and in order."""
    return tuple(sorted({_suffix(entry) for entry in entry_points(group=GROUP)}))


def plugin_reader(suffix: str) -> LogReader | None:
    """The reader of a suffix, None where no package has one.

    Raises LogError, which names the package, where two have one or it cannot be loaded.
    """
    entries = [entry for entry in entry_points(group=GROUP) if _suffix(entry) == suffix]
    if not entries:
        return None
    if len(entries) > 1:
        packages = " and ".join(sorted(map(_package, entries)))
        raise LogError(f"{suffix} is read by {packages}: remove all but one of them")
    (entry,) = entries
    try:
        read = entry.load()
    except Exception as error:
        raise LogError(
            f"the package {_package(entry)}, which reads {suffix}, cannot be loaded "
            f"({_said(error)}): mend or remove it"
        ) from error
    return _guarded(read, _package(entry))


def _guarded(read: Any, package: str) -> LogReader:
    """The same reader; what goes wrong in it is one line with the package's name."""

    def guarded(path: Path, /) -> list[FlightLog]:
        try:
            logs = list(read(path))
        except (UserError, MemoryError):
            raise
        except Exception as error:
            raise LogError(
                f"{path}: the reader of the package {package} broke ({_said(error)})"
            ) from error
        if not logs or not all(isinstance(log, FlightLog) for log in logs):
            raise LogError(f"{path}: the reader of the package {package} gave no FlightLog")
        return logs

    return guarded


def _suffix(entry: EntryPoint) -> str:
    return "." + entry.name.lower().lstrip(".")


def _package(entry: EntryPoint) -> str:
    if entry.dist is None:
        return entry.value
    return entry.dist.name


def _said(error: Exception) -> str:
    """An error on one line."""
    return " ".join(f"{type(error).__name__}: {error}".split())

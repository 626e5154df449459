"""How much memory a log may take: what the machine has free, and what the process may use."""

from __future__ import annotations

import os
import resource
from pathlib import Path

_MEMORY = Path("/proc/meminfo")
_GROUP = Path("/sys/fs/cgroup")
"""Of Linux: what is free, and what a container may use."""


def free_bytes() -> float:
    """Bytes that can be used without swapping: of the machine, of the container, and of the process."""
    page_bytes = os.sysconf("SC_PAGE_SIZE")
    free = float(page_bytes * os.sysconf("SC_PHYS_PAGES"))
    # Memory that caches files is free for the asking.
    available = _numbers(_MEMORY).get("MemAvailable:")
    if available is not None:
        free = min(free, 1024.0 * available)
    limit, _ = resource.getrlimit(resource.RLIMIT_DATA)
    if limit != resource.RLIM_INFINITY:
        free = min(free, float(limit))
    return min(free, _free_in_container())


def _free_in_container() -> float:
    """Bytes left of the limit of this control group; infinite without one."""
    try:
        limit = float((_GROUP / "memory.max").read_text())
        used = float((_GROUP / "memory.current").read_text())
    except (OSError, ValueError):
        return float("inf")
    cached = _numbers(_GROUP / "memory.stat").get("inactive_file", 0.0)
    return max(limit - used + cached, 0.0)


def _numbers(path: Path) -> dict[str, float]:
    """First words and numbers of the lines of a file; nothing where there is no such file."""
    try:
        lines = [line.split() for line in path.read_text().splitlines()]
    except OSError:
        return {}
    return {words[0]: float(words[1]) for words in lines if len(words) > 1 and words[1].isdigit()}

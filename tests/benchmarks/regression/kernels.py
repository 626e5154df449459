"""Diagnose the same flights under the linear-algebra kernels of several processors: is the answer the same?

``python tests/benchmarks regression.kernels --vehicle FILE.toml LOG...`` (``--model none``), or ``--measured`` for the
measured flights of ``measured/flights.toml``. OpenBLAS picks its kernel by the processor; OPENBLAS_CORETYPE makes it
take another one, so that one computer stands for several. Kernels that this processor cannot run are left out and said.
Names, verdict and aliases have to be the same, and sizes within a hundredth of their 95 % interval's width (or of the
size, where that is wider). Exit code 1 where they are not.
"""

from __future__ import annotations

import argparse
import os
import platform
import subprocess
import sys
from collections.abc import Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import command_line
from diagnosis.one_answer import Asked
from measured.answers import DATA, ask
from measured.known import read
from tqdm import tqdm

SIZE_TOLERANCE = 0.01


@dataclass(frozen=True)
class Kernel:
    """One kernel of OpenBLAS, and the processor flags that it needs."""

    name: str
    flags: frozenset[str]
    numpy_off: str = ""
    """Instruction sets that numpy's own loops do without, too, as on a processor that lacks them."""
    also_called: str = ""
    """Another name under which OpenBLAS reports the same kernel."""

    @property
    def environment(self) -> dict[str, str]:
        """What makes a program run so. One thread: the number of threads is no matter of the processor's kind."""
        out = {"OPENBLAS_CORETYPE": self.name, "OPENBLAS_NUM_THREADS": "1"}
        return out | ({"NPY_DISABLE_CPU_FEATURES": self.numpy_off} if self.numpy_off else {})


KERNELS = (
    Kernel(
        "Prescott", frozenset({"pni"}), "X86_V3 X86_V4 AVX512_ICL AVX512_SPR", also_called="Katmai"
    ),
    Kernel("Haswell", frozenset({"avx2", "fma"}), "X86_V4 AVX512_ICL AVX512_SPR"),
    Kernel("SkylakeX", frozenset({"avx512f", "avx512bw", "avx512dq", "avx512vl"})),
)


@dataclass(frozen=True)
class Job:
    """One diagnosis: one flight or several together."""

    name: str
    logs: tuple[Path, ...]
    vehicle: Path
    model: str = "none"


def processor_flags() -> frozenset[str]:
    """What this processor can do; empty where it is not an x86 or does not say."""
    if platform.machine() not in ("x86_64", "AMD64"):
        return frozenset()
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
    except OSError:
        return frozenset()
    return frozenset(
        next((line.partition(":")[2].split() for line in lines if line.startswith("flags")), [])
    )


def usable() -> tuple[Kernel, ...]:
    """The kernels that this processor can run and that numpy's OpenBLAS takes when asked."""
    flags = processor_flags()
    return tuple(k for k in KERNELS if k.flags <= flags and _taken(k) in (k.name, k.also_called))


def _taken(kernel: Kernel) -> str:
    """The kernel that numpy runs with when asked for this one."""
    program = (
        "import numpy; from threadpoolctl import threadpool_info as found;"
        "print(next((i['architecture'] for i in found() if i['internal_api'] == 'openblas'), ''))"
    )
    done = subprocess.run(
        [sys.executable, "-c", program], capture_output=True, text=True, check=False,
        env={**os.environ, **kernel.environment},
    )  # fmt: skip
    return done.stdout.strip()


def differences(answers: Mapping[str, Asked]) -> list[str]:
    """In what the answers of the kernels differ from the first one's."""
    (first, one), *others = answers.items()
    out = []
    for name, other in others:
        if (one.answer is None) != (other.answer is None) or one.exit_code != other.exit_code:
            out.append(f"{first}: exit code {one.exit_code}, {name}: exit code {other.exit_code}")
        elif one.answer is not None and other.answer is not None:
            out += [f"{first} {a} | {name} {b}" for a, b in _compared(one.answer, other.answer)]
    return out


def _compared(one: Mapping[str, Any], other: Mapping[str, Any]) -> list[tuple[str, str]]:
    if _said(one) != _said(other):
        return [(_said(one), _said(other))]
    out = []
    for a, b in zip(one["effects"], other["effects"], strict=True):
        for key, p in a.get("parameters", {}).items():
            q = b.get("parameters", {}).get(key)
            # What is not determined has no value.
            undetermined = q is not None and p["value"] is None and q["value"] is None
            if undetermined:
                continue
            if q is None or None in (p["value"], q["value"]) or _apart(p, q):
                what = f"{a['name']}.{key}"
                out.append(
                    (
                        f"{what} {p['value']}",
                        f"{what} {q['value']}" if q else f"{what} is missing",
                    )
                )
    return out


def _said(answer: Mapping[str, Any]) -> str:
    """What a person acts on: verdict, names in their order, aliases."""
    names = ", ".join(str(e["name"]) for e in answer["effects"])
    aliases = "; ".join(sorted("/".join(sorted(map(str, a))) for a in answer.get("aliases", [])))
    return f"{answer['verdict']}: {names or 'no name'}" + (
        f" (aliases {aliases})" if aliases else ""
    )


def _apart(one: Mapping[str, Any], other: Mapping[str, Any]) -> bool:
    return bool(abs(one["value"] - other["value"]) > _tolerance(one))


def _tolerance(parameter: Mapping[str, Any]) -> float:
    low, high = parameter.get("ci95") or (0.0, 0.0)
    return SIZE_TOLERANCE * max(abs(high - low), abs(parameter["value"])) + 1e-12


def run(
    jobs: Sequence[Job], kernels: Sequence[Kernel], at_a_time: int = 1, timeout_s: float = 300.0
) -> dict[str, dict[str, Asked]]:
    """Answers by job and kernel."""
    with ThreadPoolExecutor(at_a_time) as pool:
        futures = {
            (job.name, k.name): pool.submit(
                ask, list(job.logs), job.vehicle, job.model, timeout_s, k.environment
            )
            for job in jobs
            for k in kernels
        }
        shown = tqdm(
            futures.items(), unit="diagnosis", file=sys.stderr, disable=not sys.stderr.isatty()
        )
        answers = {key: future.result() for key, future in shown}
    return {job.name: {k.name: answers[job.name, k.name] for k in kernels} for job in jobs}


def main(argv: Sequence[str] | None = None) -> int:
    p = command_line.parser(__doc__)
    p.add_argument("logs", nargs="*", type=Path, metavar="LOG", help="each diagnosed alone")
    p.add_argument("--vehicle", type=Path, metavar="FILE.toml", help="of the logs")
    p.add_argument(
        "--measured", action="store_true", help="the measured flights, as far as they are there"
    )
    p.add_argument(
        "--data", type=Path, default=DATA, metavar="DIR", help=f"their folder (default: {DATA})"
    )
    p.add_argument(
        "--source", nargs="*", default=[], metavar="NAME", help="only these sources of them"
    )
    p.add_argument("--jobs", type=int, default=1, metavar="N", help="diagnoses at a time")
    p.add_argument("--timeout", type=float, default=300.0, metavar="S", help="of one diagnosis")
    args = p.parse_args(argv)
    if bool(args.logs) == args.measured or (args.logs and args.vehicle is None):
        p.error("name logs with their --vehicle, or --measured")
    kernels = usable()
    print(f"kernels: {', '.join(k.name for k in kernels) or 'none'}; left out: "
          + (", ".join(k.name for k in KERNELS if k not in kernels) or "none"))  # fmt: skip
    if len(kernels) < 2:
        print("this processor runs fewer than two of them: nothing to compare")
        return 0
    jobs = [Job(log.stem, (log,), args.vehicle) for log in args.logs] or _measured(args)
    found = {
        name: differences(answers)
        for name, answers in run(jobs, kernels, args.jobs, args.timeout).items()
    }
    for name, unlike in found.items():
        print(f"{'--' if unlike else 'ok'}  {name}" + "".join(f"\n      {line}" for line in unlike))
    others = sum(bool(unlike) for unlike in found.values())
    print(f"{others} of {len(jobs)} flights are answered otherwise under another kernel")
    return 1 if others else 0


def _measured(args: argparse.Namespace) -> list[Job]:
    return [
        Job(f.name, (args.data / f.log,), args.data / f.vehicle)
        for f in read().flights
        if not f.again
        and not f.table
        and not f.missing(args.data)
        and (not args.source or f.source in args.source)
    ]


if __name__ == "__main__":
    sys.exit(main())

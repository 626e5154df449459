"""Replaces the flow solver's programs: writes the files they write, with a wrench that settles as ``behave`` says.

Called by the name of the program it replaces. The file ``behave`` beside it says how: ``steady``; ``diverge``
(ends with the solver's error); ``killed`` (kills itself once per case); ``cycle`` (never settles in iterations);
``swing`` (nor in time); ``slow`` (takes half a second for each part);
``drift`` (goes slowly on until iteration 300).
"""

import math
import os
import re
import signal
import struct
import sys
import time
from pathlib import Path

CELLS = 6
LIFT_SURFACE, LIFT_CELL = 5.0, 1.0


def field(name: str, values: list[float], width: int) -> None:
    """A binary field of the cells."""
    kind = "vector" if width == 3 else "scalar"
    head = f"FoamFile {{ format binary; }}\ninternalField nonuniform List<{kind}> {len(values) // width}("
    path = Path(name)
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(head.encode() + struct.pack(f"<{len(values)}d", *values) + b");\n")


def march(program: str, behave: str) -> None:
    """Write states up to the end time and the loads of every step."""
    text = Path("system/controlDict").read_text()
    end, step, every = (
        float(re.search(rf"{k} ([\d.e+-]+);", text)[1])
        for k in ("endTime", "deltaT", "writeInterval")
    )
    states = [float(p.name) for p in Path().iterdir() if re.fullmatch(r"[\d.]+", p.name)]
    start = max(states)
    if behave == "diverge":
        print("--> FOAM FATAL ERROR:\nmaximum number of iterations exceeded\n\n")
        sys.exit(1)
    if behave == "killed" and not Path("was_killed").exists():
        Path("was_killed").touch()
        os.kill(os.getpid(), signal.SIGKILL)
    if behave == "slow":
        Path("running").write_text(str(os.getpid()))
        time.sleep(0.5)
    loads = Path(f"postProcessing/loads/{start:.10g}")
    loads.mkdir(parents=True)
    names = re.findall(r"^(\w+\d[pn])$", Path("constant/fvOptions").read_text(), re.M)
    force, moment = [], []
    for n in range(1, round((end - start) / step) + 1):
        at = start + n * step
        steady = program == "simpleFoam"
        wave = math.sin(at / 7.0) if behave in ("cycle", "swing") and steady else 0.0
        if behave == "swing" and not steady:
            wave = math.sin(at / 0.0085) * (1 + 0.2 * math.sin(at / 0.05))
        slow = 0.0013 * min(at, 300.0) if behave == "drift" else 0.0
        lift = LIFT_SURFACE * (1 + 0.5 * math.exp(-at / 8)) + wave + slow
        force.append(f"{at:.10g} (0.25 7 {lift}) (0 0 0) (0 0 0)")
        moment.append(f"{at:.10g} (7 0.01 7) (0 0 0) (0 0 0)")
        if n % round(every) == 0:
            for name in ("U", "p", "k", "omega", "nut", "phi"):
                width = 3 if name == "U" else 1
                field(f"{at:.10g}/{name}", [1.0] * CELLS * width, width)
            for name in names:
                # Each source acts on one cell of volume 1.
                field(
                    f"{at:.10g}/{name}:rotorForce",
                    [0.0, 0.0, LIFT_CELL / 1.225] + [0.0] * 3 * (CELLS - 1),
                    3,
                )
    for name, lines in (("force", force), ("moment", moment)):
        (loads / f"{name}.dat").write_text("# Time\n" + "\n".join(lines) + "\n")


def main() -> None:
    """One program of the solver."""
    program = Path(sys.argv[0]).name
    behave = (Path(sys.argv[0]).parent / "behave").read_text().strip()
    if program == "postProcess":
        if "writeCellVolumes" in sys.argv:
            field("0/V", [1.0] * CELLS, 1)
        else:
            field("0/C", [0.0] * 3 * CELLS, 3)
    elif program in ("simpleFoam", "pimpleFoam"):
        march(program, behave)
    elif program == "mapFields":
        Path("mapped_from").write_text(sys.argv[1])


main()

"""Take real ArduCopter logs of a quadcopter with a shortened propeller out of their repository, with a vehicle file.

``python tests/benchmarks/cut_propeller_logs.py CLONE OUT``: CLONE is a clone of
github.com/srikanthgoli1/rrc_fault_tolerant_control, of which the dataflash logs of commit 21636b9 are copied as they
are, under short names (``25mm_hover_1.BIN``); they stay the authors'. Then judge with

    python tests/benchmarks/measured_flights.py --table tests/benchmarks/measured/cut_propeller.toml --data OUT

Of the vehicle the logs know the frame (quad X), the throttle's range (RC3_MIN, RC3_MAX, as MOT_PWM_MIN is 0) and its
bend (MOT_THST_EXPO). Mass, span and propeller are stated nowhere: 1.5 kg, 0.45 m and 10 inch are guesses of what such a
vehicle with three cells and 3 Ah is. Forces scale with the mass, moments with mass and span, on both sides.
"""

from __future__ import annotations

import sys
from pathlib import Path, PurePosixPath

from snapshot import git

COMMIT, FOLDER = "21636b9651f3258eea88d885ad91f7157e114929", "dist/prototype-set-1"
MASS_KG, ARM_M, INERTIA, RADIUS_M = 1.5, 0.1591, (0.0156, 0.0156, 0.0305), 0.127
"""Guesses; inertia as ``models vehicle`` estimates it from mass and span."""
PWM_US, EXPO = (999.0, 2000.0), 0.65
MAX_THRUST_N, VOLTAGE_V, HOVER = 8.322, 10.95, 0.351
"""What ``replay vehicle`` measures in the three hovers with good propellers together, at this mass."""


def main() -> int:
    if len(sys.argv) != 3:
        print(__doc__, file=sys.stderr)
        return 2
    clone, out = Path(sys.argv[1]), Path(sys.argv[2])
    out.mkdir(parents=True, exist_ok=True)
    listed = git(clone, "ls-tree", "-r", "-z", "--name-only", COMMIT, f"{FOLDER}/").decode().split("\0")
    logs = [path for path in listed if path.endswith(".BIN")]
    for path in logs:
        (out / f"{_short(path)}.BIN").write_bytes(git(clone, "show", f"{COMMIT}:{path}"))
    (out / "cut_propeller.toml").write_text(_vehicle(), encoding="utf-8")
    print(f"{len(logs)} logs and cut_propeller.toml in {out}")
    return 0


def _short(path: str) -> str:
    """``10 mm cut_straight line 2.BIN`` as ``10mm_line_2``."""
    name = PurePosixPath(path).stem.replace(" mm cut", "mm").replace("good prop", "good")
    return name.replace("straight line", "line").replace(" ", "_")


def _vehicle() -> str:
    places = ((1, 1, "ccw"), (-1, -1, "ccw"), (1, -1, "cw"), (-1, 1, "cw"))
    fans = [
        f"\n[[fan]]\nposition_m = [{x * ARM_M}, {y * ARM_M}, -0.05]\nlip_radius_m = {RADIUS_M}\n"
        f'rotors = [{{ servo = {k}, spin = "{spin}" }}]\n'
        for k, (x, y, spin) in enumerate(places, 1)
    ]
    head = (
        f'name = "quadcopter with a shortened propeller"\nmass_kg = {MASS_KG}\ninertia_kgm2 = {list(INERTIA)}\n'
        f"hover_thrust = {HOVER}\nrotor_radius_m = {RADIUS_M}\n"
    )
    throttle = (
        f"\n[throttle]\nmax_thrust_n = {MAX_THRUST_N}\nexpo = {EXPO}\nvoltage_v = {VOLTAGE_V}\n"
        f"pwm_min_us = {PWM_US[0]}\npwm_max_us = {PWM_US[1]}\n"
    )
    limits = "\n[limits]\nthrust = 0.10\ntilt_deg = 8.0\nslew_thrust_per_s = 0.5\nslew_tilt_deg_per_s = 60.0\n"
    return head + "".join(fans) + throttle + limits


if __name__ == "__main__":
    sys.exit(main())

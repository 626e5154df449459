"""Thrust of rotor pairs near the ground: the catalogue's law of ground effect beside the classic one.

``python tests/benchmarks tables.rotor_pairs CLONE``: CLONE is a clone of
github.com/AmbarGarofano-Soldado/Ground-effect-results, with thrust measured over height and tilt (Garofano-Soldado et
al., *Aerodynamic interactions of non-planar rotor pairs and model derivation in ground approach*). The exponential law
is ``ground_effect`` of the catalogue. It is fitted to the coplanar pair, and told with every height left out in turn;
the pairs that lean are told by the same numbers, and by numbers fitted to all of them. Cheeseman & Bennett 1955, ARC
R&M 3021, has nothing to fit.
"""

from __future__ import annotations

import re
import sys
from collections.abc import Callable

import command_line
import numpy as np
from result_file import add_option, figure, write_result
from scipy.optimize import curve_fit
from sources.clone import read

from models.common.frames import Array

COMMIT = "aba4d8a"
FILE = "data_nonplanar_rotors.m"
HEIGHTS = np.array([0.6, 0.75, 1.0, 1.5, 2.0, 2.5, 3.0, 3.5, 4.0, 5.0])
"""In rotor radii."""
FARTHEST = 5.0
WITHOUT_ONE = np.delete(HEIGHTS, 3)
"""Of the curve that lacks a height."""
COPLANAR = "Fz0"
KNOWN_BENNETT = 0.0153
"""RMSE of the law of Cheeseman and Bennett on the coplanar pair."""
ALLOWED = 0.02
Law = Callable[..., Array]
Curve = tuple[Array, Array]
"""Heights (n,) in radii, and thrust (n,) over that of the largest height."""


def exponential(height: Array, gain: float, decay: float) -> Array:
    """``ground_effect`` of the catalogue: 1 + g exp(-z / L), with decay = R / L."""
    return np.asarray(1.0 + gain * np.exp(-decay * height))


def bennett(height: Array) -> Array:
    """Cheeseman & Bennett, 1 / (1 - (R / 4z)^2), over its value at the largest height."""
    return np.asarray((1.0 - (0.25 / FARTHEST) ** 2) / (1.0 - (0.25 / height) ** 2))


def displaced(height: Array, strength: float, higher: float) -> Array:
    """Cheeseman & Bennett with an image of another strength under rotors that stand higher: 1 / (1 - s / (z + c)^2)."""
    ends = [1.0 - strength / (z + higher) ** 2 for z in (FARTHEST, height)]
    return np.asarray(ends[0] / ends[1])


def floor(heights: Array, ratios: Array) -> float:
    """RMSE of the mean over curves at each height: no law of height alone is nearer."""
    errors = ratios.copy()
    for height in np.unique(heights):
        here = heights == height
        errors[here] -= ratios[here].mean()
    return rmse(errors)


def curves(text: str) -> dict[str, Curve]:
    """The curves of the authors' file by their names there."""
    out = {}
    for name, numbers in re.findall(r"^(Fz\w+)\s*=\s*\[([^\]]*)\]", text, re.M):
        thrust = np.array(numbers.split(), dtype=float)
        height = HEIGHTS if len(thrust) == len(HEIGHTS) else WITHOUT_ONE
        out[name] = height, thrust / thrust[-1]
    return out


def rmse(errors: Array) -> float:
    """Root of the mean square (n,)."""
    return float(np.sqrt((errors**2).mean()))


def fitted(height: Array, ratio: Array, law: Law = exponential) -> tuple[float, float]:
    """The two numbers of a law."""
    found, _ = curve_fit(law, height, ratio, p0=STARTS[law])
    return float(found[0]), float(found[1])


def left_out(height: Array, ratio: Array, law: Law = exponential) -> Array:
    """Errors (n,) at every height of a law fitted to the others."""
    out = []
    for k in range(len(height)):
        numbers = fitted(np.delete(height, k), np.delete(ratio, k), law)
        out.append(float(law(height[k], *numbers) - ratio[k]))
    return np.array(out)


STARTS: dict[Law, tuple[float, float]] = {exponential: (0.5, 1.5), displaced: (0.06, 0.1)}


def main() -> int:
    parser = command_line.of_clone(__doc__)
    add_option(parser)
    a = parser.parse_args()
    every = curves(read(a.clone, COMMIT, FILE).decode())
    height, ratio = every[COPLANAR]
    classic = rmse(bennett(height) - ratio)
    if abs(classic - KNOWN_BENNETT) > ALLOWED * KNOWN_BENNETT:
        raise SystemExit(f"refused: Cheeseman and Bennett: {classic:.4f}, known {KNOWN_BENNETT}")
    law = fitted(height, ratio)
    flat = rmse(exponential(height, *law) - ratio)
    without = rmse(left_out(height, ratio))
    heights = np.concatenate([z for z, _ in every.values()])
    ratios = np.concatenate([r for _, r in every.values()])
    frozen = rmse(exponential(heights, *law) - ratios)
    one = rmse(exponential(heights, *fitted(heights, ratios)) - ratios)
    leaning = rmse(bennett(heights) - ratios)
    print(f"{len(every)} curves; law 1 + {law[0]:.3f} exp(-{law[1]:.3f} z/R)")
    print("| law | coplanar | a height left out | all curves |\n|---|---|---|---|")
    print(f"| no ground effect | {rmse(1.0 - ratio):.4f} | | {rmse(1.0 - ratios):.4f} |")
    print(f"| Cheeseman and Bennett | {classic:.4f} | | {leaning:.4f} |")
    print(f"| ground_effect, of the coplanar pair | {flat:.4f} | {without:.4f} | {frozen:.4f} |")
    print(f"| ground_effect, of all curves | | | {one:.4f} |")
    moved = fitted(height, ratio, displaced)
    image = rmse(displaced(height, *moved) - ratio)
    held = rmse(left_out(height, ratio, displaced))
    told = rmse(displaced(heights, *moved) - ratios)
    least = floor(heights, ratios)
    print(f"| displaced image, of the coplanar pair | {image:.4f} | {held:.4f} | {told:.4f} |")
    print(f"| any law of height alone | | | at least {least:.4f} |")
    if a.result:
        detail = f"Cheeseman and Bennett {classic:.4f}"
        figures = [
            figure("rotor pairs: coplanar", f"{flat:.4f}", detail, "0.006", met=flat <= 0.006),
            figure("rotor pairs: all curves, one law", f"{one:.4f}", "", "0.015", met=one <= 0.015),
            figure(
                "rotor pairs: coplanar, a displaced image",
                f"{image:.4f}",
                f"a height left out {held:.4f}",
            ),
            figure("rotor pairs: all curves, any law of height", f"at least {least:.4f}"),
        ]
        write_result(a, figures, seeds=f"{len(every)} curves", repeatable=True)
    return 0


if __name__ == "__main__":
    sys.exit(main())

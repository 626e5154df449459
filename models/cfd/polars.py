"""Blade forces as the solver's rotor disc needs them, from section polars at the blade's own Reynolds number.

The disc looks a section up by its angle of attack alone, puts the "lift" along the axis and the "drag" against the
rotation. Both are tilted by the inflow angle phi in truth; at one radius phi = pitch - alpha, so the tilt can be put
into that radius's table exactly: axial = Cl cos phi - Cd sin phi, tangential = Cl sin phi + Cd cos phi.
A disc that turns backwards is looked up at -alpha by the solver and needs the mirrored table: axial(-a) and
-tangential(-a).
"""

from __future__ import annotations

import math
import warnings
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache

import numpy as np

from models.cfd.config import Setup
from models.common.errors import ConfigError
from models.common.extras import how_to_install
from models.common.frames import Array

Section = Callable[[Array, float], tuple[Array, Array]]
"""Angle of attack [deg] (n,) and Reynolds number -> Cl (n,), Cd (n,)."""

# Fine where sections fly and stall, coarse behind.
ANGLES_DEG = np.concatenate(
    [np.arange(-180.0, -30.0, 5.0), np.arange(-30.0, 40.0, 1.0), np.arange(40.0, 181.0, 5.0)]
)
# A polar has kinks that a disc of cells cannot follow: the angle of attack is averaged over this width.
SMOOTHING_DEG = 2.0
# The inflow of a hovering fan over its tip speed, for the Reynolds number only.
INFLOW_RATIO = 0.17


@dataclass(frozen=True, kw_only=True)
class Station:
    """One radius of the blade: ``axial`` and ``tangential`` coefficients over ``ANGLES_DEG``."""

    radius_m: float
    chord_m: float
    pitch_deg: float
    reynolds: float
    axial: Array
    tangential: Array


Blades = tuple[tuple[Station, ...], tuple[Station, ...]]
"""Tables of the upper and of the lower disc."""


@cache
def blades(setup: Setup, rpm: float, section: Section, *, swirl: bool) -> Blades:
    """Tables of both discs for one rotor speed; with swirl each has its own pitch."""
    rotor = setup.rotor
    upper, lower = rotor.swirl_tip_pitch_deg if swirl else (rotor.tip_pitch_deg,) * 2
    return stations(setup, rpm, section, upper), stations(setup, rpm, section, lower)


def stations(
    setup: Setup, rpm: float, section: Section, tip_pitch_deg: float
) -> tuple[Station, ...]:
    """Tables of one disc for one rotor speed, from hub to tip."""
    rotor = setup.rotor
    radius_m = setup.fan.radius_m
    tip_speed = rpm * 2 * math.pi / 60 * radius_m
    ends = (rotor.root_radius, rotor.tip_radius)
    out = []
    for x in np.linspace(*ends, rotor.stations):
        pitch = float(np.interp(x, ends, (rotor.root_pitch_deg, tip_pitch_deg)))
        reynolds = (
            tip_speed * math.hypot(x, INFLOW_RATIO) * rotor.chord_m / setup.air.viscosity_m2_s
        )
        cl, cd = _smooth(section, reynolds)
        phi = np.radians(pitch - ANGLES_DEG)
        axial = cl * np.cos(phi) - cd * np.sin(phi)
        tangential = cl * np.sin(phi) + cd * np.cos(phi)
        out.append(
            Station(
                radius_m=x * radius_m,
                chord_m=rotor.chord_m,
                pitch_deg=pitch,
                reynolds=reynolds,
                axial=axial,
                tangential=tangential,
            )
        )
    return tuple(out)


def _smooth(section: Section, reynolds: float) -> tuple[Array, Array]:
    fine = np.arange(-190.0, 190.25, 0.25)
    wrapped = (fine + 180.0) % 360.0 - 180.0
    cl, cd = section(wrapped, reynolds)
    width = max(1, round(SMOOTHING_DEG / 0.25))
    window = np.hanning(2 * width + 1)
    window /= window.sum()
    smooth = [np.interp(ANGLES_DEG, fine, np.convolve(c, window, mode="same")) for c in (cl, cd)]
    return smooth[0], smooth[1]


@cache
def neural_section(name: str) -> Section:
    """The named section from a neural network trained on XFOIL, with its post-stall extension to +-180 deg."""
    try:
        import aerosandbox
    except ImportError:
        raise ConfigError(f"blade polars need neuralfoil: {how_to_install('cfd')}") from None
    with warnings.catch_warnings():
        # It warns where it should refuse; refused below.
        warnings.simplefilter("ignore")
        airfoil = aerosandbox.Airfoil(name)
    if airfoil.coordinates is None:
        raise ConfigError(
            f"[rotor] section '{name}': unknown; use a NACA number or a name of the UIUC data base"
        )

    def section(angle_deg: Array, reynolds: float) -> tuple[Array, Array]:
        aero = airfoil.get_aero_from_neuralfoil(
            alpha=angle_deg, Re=reynolds, mach=0.0, model_size="large"
        )
        return np.asarray(aero["CL"], dtype=float), np.asarray(aero["CD"], dtype=float)

    return section


def foam_table(station: Station, backwards: bool) -> str:
    """The station as the solver's list (angle [deg], drag, lift)."""
    angles = ANGLES_DEG
    lift = station.axial
    drag = station.tangential
    if backwards:
        angles = -angles[::-1]
        lift = lift[::-1]
        drag = -drag[::-1]
    return "\n".join(
        f"({a:.3f} {d:.6f} {c:.6f})" for a, d, c in zip(angles, drag, lift, strict=True)
    )

"""Declared models for the corner: right and wrong ones, made of the shipped ones, as model directories."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import models
from models.surrogate.domain import Domain
from models.surrogate.fan_identity import identity
from models.surrogate.fan_surrogate import FanSurrogate
from models.surrogate.net_ensemble import NetEnsemble
from models.surrogate.store import save_model
from models.vehicle import Vehicle

KINDS = ("none", "default", "corner_cfd", "mirrored", "quarter", "other_fan")


def declared(kind: str, vehicle: Vehicle, folder: Path) -> str:
    """What ``--model`` is given: ``none``, a shipped name, or a directory written below ``folder``.

    ``mirrored``, ``quarter``: what the shipped default says of ground and wall times -1 and 0.25; ``other_fan``: times
    1.5, at 0.6 of the distance. For another fan than the paper's, ``default`` and all made of it are the shipped laws
    in radii and shares of that fan's lift.
    """
    if kind == "none":
        return kind
    base = models.load("corner_cfd" if kind == "corner_cfd" else None)
    gain, nearer = {"mirrored": (-1.0, 1.0), "quarter": (0.25, 1.0), "other_fan": (1.5, 0.6)}.get(
        kind, (1.0, 1.0)
    )
    out = folder / f"{kind}_{vehicle.rotor_radius_m:g}"
    if not (out / "model.json").exists():
        save_model(out, scaled(base, vehicle, gain, nearer))
    return str(out)


def scaled(model: FanSurrogate, vehicle: Vehicle, gain: float, nearer: float) -> FanSurrogate:
    """The model of this vehicle's fan: increments times ``gain``, distances in its radii over ``nearer``."""
    nets = model.regressor
    law = model.free_air_law
    assert isinstance(nets, NetEnsemble)
    radius = model.info["fan"]["radius_m"]
    size = vehicle.rotor_radius_m / radius
    far = size / nearer
    arms = [1.0, 1.0, 1.0, size, size, size]
    c = model.coordinates
    d = model.domain
    k = model.calibration
    if size != 1.0:
        lift = models.choice.choose(vehicle, "none").model.free_air_law
        law = replace(law, lift_n=lift.lift_n, rpm_ref=lift.rpm_ref, exponent=0.0, share=lift.share)
    mine = identity(law, vehicle.rotor_radius_m, vehicle.fans[0].lip_radius_m)
    speeds = (c.rpm_low, c.rpm_high) if size == 1.0 else (500.0, 20000.0)
    each = [abs(gain) * a for a in arms]
    return FanSurrogate(
        free_air_law=law,
        coordinates=replace(c, h_near=c.h_near * far, h_far=c.h_far * far, d_near=c.d_near * far, d_far=c.d_far * far),
        regressor=NetEnsemble(
            nets.w1, nets.b1, nets.w2 * gain * _row(arms, 3), nets.b2 * gain * _row(arms, 2)
        ),
        calibration=replace(k, floor=_times(k.floor, each), size=_times(k.size, each)),
        domain=Domain(d.map, d.h_near * far, d.d_near * far, *speeds),
        info={**model.info, "fan": mine.as_info(), "method": f"{model.info['method']}, made wrong on purpose"},
    )  # fmt: skip


def _row(values: list[float], dims: int) -> object:
    import numpy as np

    return np.array(values).reshape((1, 6) + (1,) * (dims - 2))


def _times(values: tuple[float, ...], by: list[float]) -> tuple[float, ...]:
    return tuple(v * b for v, b in zip(values, by, strict=True))

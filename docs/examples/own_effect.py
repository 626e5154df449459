"""Ask for an effect of one's own beside the catalogue: a pull to the north, as of a magnet or a cable.

python docs/examples/own_effect.py LOG VEHICLE.toml
"""

import sys
from pathlib import Path

import numpy as np

from models.effects import catalogue
from models.effects.coefficient import Coefficient
from models.effects.context import Context
from models.effects.effect import Effect
from models.vehicle import load_vehicle
from replay.diagnosis.diagnose import conclude, read_records


def wrenches(ctx: Context, shape: tuple[float, ...]) -> tuple[np.ndarray, ...]:
    """A newton to the north, seen from the body, (..., 6)."""
    north = ctx.state.rotation[..., 0, :]
    out = np.zeros((*north.shape[:-1], 6))
    out[..., :3] = north
    return (out,)


PULL = Effect(
    name="pull_north",
    equation="dF = f north",
    sign="f > 0: to the north",
    axes=("Fx", "Fy"),
    channels=("yaw_rad",),
    excite="turn by 180 degrees",
    coefficients=(Coefficient(name="force", unit="N", low=-5.0, high=5.0, typical=0.5),),
    wrenches=wrenches,
)
if len(sys.argv) < 3:
    sys.exit(__doc__)
log, vehicle = sys.argv[1:]
records, _ = read_records([Path(log)], load_vehicle(vehicle), None, None)
answer = conclude(records, effects=[*catalogue(), PULL])
print(answer.as_text())

"""The hold on slow loops and late positions: a corner approach on a small vehicle model, margins beside what was flown.

``python tests/benchmarks safety.hold_margin [--speed 0.5 1 2] [--hz 50 10 5] [--late 20 80 150] [--slope 0.7 1 1.3]
[--seeds 2] [--stiff] [--json FILE]``

Everything is simulated, and the vehicle is cheap on purpose: a point mass, an attitude of two equal lags and a dead
time, thrust with a lag, ground and wall air as exponentials of the distance. The flight program's own ``step`` flies
it and is given nothing of the loop: it reads no parameter and has to measure the attitude's answer. Offsets are off.
``full``: the same with the full gains whatever the margin is, and no swing detector; ``stiff``: full gains that only
the swing detector softens. ``refused``: the hold let go, or did not engage. ``rest``: RMS tilt about its mean while the
vehicle is to stand still: noise and gusts alone make some 1 degree, a swing 2.6 and more. ``soft``: how often the
swing detector softened the gains.
"""

from __future__ import annotations

import argparse
import json
import math
import sys
from collections import deque
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from unittest import mock

import command_line
import numpy as np
from tqdm import tqdm

from companion import refusals, settle
from companion.config import PipelineConfig
from companion.control import plant as hold_plant
from companion.control import swing_detector
from companion.control.plant import Margin
from companion.mavlink.samples import (
    Attitude,
    AttitudeTarget,
    Heartbeat,
    LandedState,
    LocalPosition,
    Parameter,
    Sample,
    SetPositionTarget,
)
from companion.mavlink.setpoints import AttitudeCommand
from companion.pipeline import initial_state, step
from companion.vehicles import QUAD
from models.common.frames import GRAVITY, quaternion_from_euler
from models.surrogate.empty import empty_model
from models.vehicle import load_vehicle

DT = 0.005
HOVER = 0.42
THRUST_LAG_S = 0.06
TAU_S = 0.07
DELAY_S = 0.10
"""The attitude loop at speed 1: fitted to a recording of ArduCopter 4.6.3 with its default parameters."""
GROUND_SHARE = 0.10
GROUND_M = 0.15
"""Lift gained at touch-down, as a share of the weight, and its e-fold."""
WALL_SHARE = 0.06
WALL_M = 0.17
WALL_AT_M = 1.2
"""Pull at the wall, its e-fold, and where the wall is north of the start (from the vehicle's own edge)."""
PATH = ((0.0, 0.0, 1.0), (4.0, 0.0, 1.0), (7.0, 0.0, 0.15), (10.0, 0.0, 0.15), (13.0, 0.0, 1.0), (16.0, 0.0, 1.0),
        (19.5, 1.05, 1.0), (22.5, 1.05, 1.0), (25.5, 1.05, 0.15), (28.5, 1.05, 0.15), (32.0, 0.0, 0.15),
        (36.0, 0.0, 1.0), (39.0, 0.0, 1.0))  # fmt: skip
"""Time [s], metres towards the wall, height [m]: 0.3 m/s down and back, to the wall, down into the corner, back."""
RESTS = ((8.5, 10.0), (14.5, 16.0), (24.0, 25.5), (30.0, 31.7), (37.5, 39.0))
"""Path time [s] in which it stands still, settled."""
ROUNDING_S = 0.6
START_S = 12.0
"""Of flight before the path begins: take-over and settling."""


@dataclass(frozen=True)
class Plant:
    """Speed of the attitude loop, rate [Hz] and lateness [s] of positions, and how steep thrust is."""

    speed: float
    position_hz: float
    late_s: float
    thrust_slope: float = 1.0
    """Change of lift per change of thrust about hover, over what the flight program believes."""


@dataclass(frozen=True)
class Flown:
    """Errors on the path: RMS and peak [mm], level and in height; margin at its end; what touched."""

    rms_mm: float
    peak_mm: float
    height_rms_mm: float
    height_peak_mm: float
    tilt_deg: float
    rest_deg: float
    softened: int
    contact_s: float
    gain_margin: float
    phase_margin_deg: float
    share: float
    lag_s: float
    loop_from: str
    engaged_share: float


def reference(t: float) -> tuple[np.ndarray, np.ndarray]:
    """Position and velocity NED on the rounded path."""
    times, towards, heights = np.array(PATH).T
    sweep = np.linspace(t - ROUNDING_S / 2, t + ROUNDING_S / 2, 9)
    north, up = (
        float(np.mean(np.interp(sweep, times, towards))),
        float(np.mean(np.interp(sweep, times, heights))),
    )
    vn = (
        float(np.interp(sweep[-1], times, towards) - np.interp(sweep[0], times, towards))
        / ROUNDING_S
    )
    vu = (
        float(np.interp(sweep[-1], times, heights) - np.interp(sweep[0], times, heights))
        / ROUNDING_S
    )
    return np.array([north, 0.0, -up]), np.array([vn, 0.0, -vu])


class Craft:
    """The vehicle: state, and the messages that it sends."""

    def __init__(self, plant: Plant, seed: int) -> None:
        self.plant = plant
        self.rng = np.random.default_rng(seed)
        self.position = np.array([0.0, 0.0, -1.0])
        self.velocity = np.zeros(3)
        self.first = np.zeros(2)
        self.tilt = np.zeros(2)
        self.thrust = HOVER
        self.delay_s = DELAY_S / plant.speed
        self.tau_s = TAU_S / plant.speed
        depth = 1 + round(self.delay_s / DT)
        self.commands = deque([np.zeros(2)] * depth, maxlen=depth)
        self.wanted = np.zeros(2)
        self.wanted_thrust = HOVER
        self.gust = np.zeros(3)
        self.contact_s = 0.0
        self.waiting: deque[tuple[float, LocalPosition]] = deque()

    def step(self) -> None:
        """One physics step."""
        self.commands.append(self.wanted)
        share = 1.0 - math.exp(-DT / self.tau_s)
        self.first = self.first + share * (self.commands[0] - self.first)
        self.tilt = self.tilt + share * (self.first - self.tilt)
        self.thrust += DT / THRUST_LAG_S * (self.wanted_thrust - self.thrust)
        self.gust += DT / 2.0 * (-self.gust) + math.sqrt(DT) * 0.05 * self.rng.normal(size=3)
        height = max(-self.position[2], 0.0)
        gap = max(WALL_AT_M - self.position[0], 0.0)
        lift = (1.0 + self.plant.thrust_slope * (self.thrust / HOVER - 1.0)) * (
            1.0 + GROUND_SHARE * math.exp(-height / GROUND_M)
        )
        force = np.array([
            -math.tan(self.tilt[1]) + WALL_SHARE * math.exp(-gap / WALL_M), math.tan(self.tilt[0]), 1.0 - lift,
        ])  # fmt: skip
        self.velocity = self.velocity + DT * (GRAVITY * force - 0.15 * self.velocity + self.gust)
        self.position = self.position + DT * self.velocity
        touching = self.position > [WALL_AT_M, np.inf, 0.0]
        if touching.any():
            self.contact_s += DT
            self.position = np.minimum(self.position, [WALL_AT_M, np.inf, 0.0])
            self.velocity = np.where(touching, np.minimum(self.velocity, 0.0), self.velocity)

    def messages(self, k: int, t: float) -> list[Sample]:
        """What arrives now."""
        out: list[Sample] = []
        if k % round(1.0 / DT / 5.0) == 0:
            mode = 5 if t < 5.0 else 4
            out += [Heartbeat(t, 1, 1, True, mode, 3, 2), LandedState(t, 1, 1, 2)]
        if t < 5.0 and k % 10 == 0:
            out.append(AttitudeTarget(t, 1, 1, (1.0, 0.0, 0.0, 0.0), HOVER))
        if k % round(1.0 / DT / self.plant.position_hz) == 0:
            noisy = (
                self.position + 0.004 * self.rng.normal(size=3),
                self.velocity + 0.015 * self.rng.normal(size=3),
            )
            place = LocalPosition(
                t, 1, 1, tuple(noisy[0]), tuple(noisy[1]), late_s=self.plant.late_s
            )
            self.waiting.append((t + self.plant.late_s, place))
        while self.waiting and self.waiting[0][0] <= t + 1e-9:
            out.append(self.waiting.popleft()[1])
        if k % 4 == 0:
            noise = 0.002 * self.rng.normal(size=2)
            q = quaternion_from_euler(self.tilt[0] + noise[0], self.tilt[1] + noise[1], 0.0)
            out.append(Attitude(t, 1, 1, q, (0.0, 0.0, 0.0), "ATTITUDE_QUATERNION"))
        return out


@contextmanager
def flown_with(gains: str) -> Iterator[None]:
    """``chosen`` as it flies, ``full`` and ``stiff`` as the head of this file says."""
    any_margin = Margin(-1e9, -1e9)
    with ExitStack() as stack:
        if gains != "chosen":
            stack.enter_context(
                mock.patch.multiple(hold_plant, _WANTED=any_margin, _WANTED_CLIMB=any_margin)
            )
            stack.enter_context(
                mock.patch.multiple(refusals, _LEAST=any_margin, _LEAST_SHARE=0.0, _KEPT_SHARE=0.0)
            )
        if gains == "full":
            stack.enter_context(mock.patch.object(settle, "_SOFTER", 1.0))
            for module in (refusals, swing_detector):
                stack.enter_context(mock.patch.object(module, "SWING_LEVELS", 10**6))
        hold_plant._tuned.cache_clear()
        yield
    hold_plant._tuned.cache_clear()


def fly(plant: Plant, seed: int) -> Flown:
    """One approach."""
    vehicle = replace(load_vehicle(QUAD), rangefinders=())
    config = PipelineConfig(vehicle=vehicle, model=empty_model(vehicle), offsets=False)
    state = initial_state(config)
    craft = Craft(plant, seed)
    # Thrust over weight is proportional here: spin-min 0 and no expo say so to the thrust map.
    for name, value in (("GUID_OPTIONS", 8.0), ("MOT_SPIN_MIN", 0.0), ("MOT_THST_EXPO", 0.0)):
        state, _ = step(state, Parameter(0.0, 1, 1, name, value), config)
    errors = []
    tilts = []
    engaged = []
    decision = None
    last = None
    softened = 0
    end_s = START_S + PATH[-1][0]
    for k in range(round(end_s / DT)):
        t = k * DT
        for sample in craft.messages(k, t):
            state, decision = step(state, sample, config)
            if decision is not None and isinstance(decision.command, AttitudeCommand):
                w, x, y, z = decision.command.q_ned_frd
                roll = math.atan2(2.0 * (w * x + y * z), 1.0 - 2.0 * (x * x + y * y))
                craft.wanted = np.array(
                    [roll, math.asin(min(max(2.0 * (w * y - z * x), -1.0), 1.0))]
                )
                craft.wanted_thrust = decision.command.thrust
            last = decision or last
        if t > 7.0 and k % 10 == 0:
            place, speed = reference(t - START_S)
            state, _ = step(state, SetPositionTarget(t, 255, 190, 0x1C0 | 0xC00, 1, tuple(place), tuple(speed),
                                                     (0.0,) * 3, 0.0, 1, 191), config)  # fmt: skip
        craft.step()
        if t >= START_S and state.held.hold is None:
            break  # refused: from here on the autopilot would fly, and there is none
        if t >= START_S:
            errors.append(craft.position - reference(t - START_S)[0])
            tilts.append(craft.tilt.copy())
            softened = max(softened, state.plant.swing.level)
            engaged.append(state.held.hold is not None)
    assert last is not None
    assert last.tuned is not None
    if t < end_s - 1.0:
        errors = [np.full(3, np.nan)]
        engaged = [False]
    e = 1e3 * np.array(errors)
    level = np.hypot(e[:, 0], e[:, 1])
    return Flown(
        float(np.sqrt(np.mean(level**2))), float(level.max()), float(np.sqrt(np.mean(e[:, 2] ** 2))),
        float(np.abs(e[:, 2]).max()), math.degrees(max((math.hypot(*tilt) for tilt in tilts), default=math.nan)),
        rest_tilt_deg(tilts), softened, craft.contact_s,
        last.tuned.margin.gain, last.tuned.margin.phase_deg, last.tuned.share, last.tuned.loop.lag_s,
        last.tuned.loop.source.value,
        float(np.mean(engaged)) if engaged else 0.0,
    )  # fmt: skip


def rest_tilt_deg(tilts: list[np.ndarray]) -> float:
    """RMS of the tilt about its mean while the path stands still; the largest of the rests."""
    out = []
    for begin, end in RESTS:
        part = np.array(tilts[round(begin / DT) : round(end / DT)])
        if len(part) == round(end / DT) - round(begin / DT):
            out.append(float(np.sqrt(np.mean(np.sum((part - part.mean(axis=0)) ** 2, axis=1)))))
    return math.degrees(max(out, default=math.nan))


def as_line(plant: Plant, gains: str, m: dict[str, float], refused: bool) -> str:
    """One row of the table."""
    head = f"{plant.speed:5.1f} {plant.position_hz:4.0f} {1e3 * plant.late_s:4.0f} {plant.thrust_slope:5.2f} {gains:>6}"
    if refused:
        return f"{head} refused"
    return (
        f"{head} {m['share']:5.2f} {m['gain_margin']:4.1f} {m['phase_margin_deg']:4.0f}° {m['lag_s']:6.2f} "
        f"{m['rms_mm']:6.0f} {m['peak_mm']:7.0f} {m['height_rms_mm']:6.0f} {m['height_peak_mm']:7.0f} "
        f"{m['tilt_deg']:5.1f} {m['rest_deg']:5.1f} {m['softened']:4.0f} {m['contact_s']:6.1f} s"
    )


def parser() -> argparse.ArgumentParser:
    """The options of this command."""
    p = command_line.parser(__doc__.splitlines()[0])
    p.add_argument(
        "--speed", type=float, nargs="+", default=[0.5, 1.0, 2.0], help="of the attitude loop"
    )
    p.add_argument("--hz", type=float, nargs="+", default=[50.0, 10.0, 5.0], help="of positions")
    p.add_argument(
        "--late", type=float, nargs="+", default=[20.0, 80.0, 150.0], help="of positions [ms]"
    )
    p.add_argument(
        "--slope",
        type=float,
        nargs="+",
        default=[1.0],
        help="of thrust about hover, over the believed one",
    )
    p.add_argument("--seeds", type=int, default=1)
    p.add_argument(
        "--full", action="store_true", help="the full gains as well, whatever their margin"
    )
    p.add_argument(
        "--stiff",
        action="store_true",
        help="full gains that only the swing detector softens, as well",
    )
    p.add_argument("--json", type=Path)
    return p


def main() -> int:
    """Fly the grid and print it."""
    a = parser().parse_args()
    plants = [
        Plant(s, hz, late / 1e3, k)
        for s in a.speed
        for hz in a.hz
        for late in a.late
        for k in a.slope
    ]
    ways = ["chosen", *(["full"] if a.full else []), *(["stiff"] if a.stiff else [])]
    jobs = [(plant, gains) for plant in plants for gains in ways]
    print("simulated; offsets off; RMS / peak in mm, level and height")
    print(f"{'speed':>5} {'Hz':>4} {'late':>4} {'slope':>5} {'gains':>6} {'share':>5} {'margin':>11} {'lag':>6} "
          f"{'level':>14} {'height':>14} {'tilt':>5} {'rest':>5} {'soft':>4} {'contact':>8}")  # fmt: skip
    rows = []
    for plant, gains in tqdm(jobs, file=sys.stderr, disable=not sys.stderr.isatty()):
        with flown_with(gains):
            flights = [fly(plant, seed) for seed in range(a.seeds)]
        mean = {
            k: float(np.mean([asdict(f)[k] for f in flights]))
            for k in asdict(flights[0])
            if k != "loop_from"
        }
        mean["peak_mm"] = max(f.peak_mm for f in flights)
        mean["softened"] = max(f.softened for f in flights)
        refused = mean["engaged_share"] < 1.0
        rows.append(
            {
                **asdict(plant),
                "gains": gains,
                **mean,
                "loop_from": flights[0].loop_from,
                "refused": refused,
            }
        )
        print(as_line(plant, gains, mean, refused), flush=True)
    if a.json is not None:
        a.json.write_text(
            json.dumps({"simulated": True, "flights": rows}, indent=2), encoding="utf-8"
        )
    return 0


if __name__ == "__main__":
    sys.exit(main())

"""A loss of thrust has to explain what follows it."""

from __future__ import annotations

import numpy as np

from models.common.frames import Array
from replay.residual.failed_motor import GAIN_SD
from replay.residual.motor_loss import GAINS, Loss, loss_that_explains
from replay.residual.motor_signals import Noise, Signals

STEP_S = 0.1
BEGIN = 30
END = 180
SIDE = float(np.sqrt(0.5))
ARMS = SIDE * np.array([[1.0, 1.0], [-1.0, -1.0], [1.0, -1.0], [-1.0, 1.0]])
"""Of a quadcopter, over the lever: front right, rear left, front left, rear right."""
UNSTEADY = Noise(fast=np.array([0.02, 0.02, 0.05]), slow=np.array([0.03, 0.05, 0.1]))
STEADY = Noise(fast=np.array([0.01, 0.01, 0.03]), slow=np.array([0.004, 0.004, 0.01]))
PRIOR = -0.5 * (np.log(GAINS) / GAIN_SD) ** 2


def signals(roll: Array, pitch: Array, lost: float) -> Signals:
    """A hover whose rotors declare these moments (n,); its front left motor loses this share from ``BEGIN`` on."""
    count = len(roll)
    rng = np.random.default_rng(3)
    effect = np.stack([-ARMS[:, 1], ARMS[:, 0], np.ones(4)], axis=1)
    thrust = 0.25 - roll[:, None] * ARMS[:, 1] / 2.0 + pitch[:, None] * ARMS[:, 0] / 2.0
    by_fan = thrust[:, :, None] * effect
    gone = np.where(np.arange(count) >= BEGIN, lost, 0.0)
    declared = by_fan.sum(axis=1)
    measured = declared - gone[:, None] * by_fan[:, 2]
    measured += rng.normal(size=(count, 3)) * (0.005, 0.005, 0.02)
    nothing = np.zeros(count, bool)
    return Signals(
        time_s=STEP_S * np.arange(count),
        step_s=STEP_S,
        measured=measured,
        by_fan=by_fan,
        declared=declared,
        doubt=np.full((count, 3), 0.01),
        velocity=np.zeros((count, 3)),
        good=np.ones(count, bool),
        struck=nothing,
        over=nothing,
        flying=np.ones(count, bool),
    )


def loss_of(flight: Signals, noise: Noise, motor: int) -> Loss | None:
    """What is said of this motor."""
    return loss_that_explains(
        signals=flight, noise=noise, prior=PRIOR, start=0, begin=BEGIN, end=END, motor=motor
    )


def test_a_loss_that_explains_little_is_none() -> None:
    """After a take-off the rotors lean against a moment that no loss makes."""
    count = 200
    rng = np.random.default_rng(1)
    leans = np.where(np.arange(count) < BEGIN, 0.03, -0.05)
    flight = signals(0.0 * leans, 0.0 * leans, lost=0.0)
    noisy = leans[:, None] + rng.normal(size=(count, 2)) * 0.035
    leaning = signals(noisy[:, 0], noisy[:, 1], lost=0.0)
    # What is declared to lean is not measured: the vehicle stays level.
    level = Signals(**{**vars(leaning), "measured": flight.measured})
    assert [loss_of(level, UNSTEADY, motor) for motor in range(4)] == [None] * 4


def test_a_loss_that_explains_what_follows_stands() -> None:
    still = np.zeros(200)
    loss = loss_of(signals(still, still, lost=0.6), STEADY, 2)
    assert loss is not None
    assert abs(loss.share - 0.6) < 3.0 * loss.share_sd
    assert loss.explains > 0.9

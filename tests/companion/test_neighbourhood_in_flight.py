"""A hover is answered by a polynomial about its place: the offsets are those of the surrogate, with its pass saved."""

from __future__ import annotations

import math

import pytest
from flying import bench

import models
from companion.control import disturbance as push

SECONDS = 6.0


def hover(monkeypatch, always_in_full: bool):
    """Slow waves of height, wall distance and rotor speed, then a jump; what is decided, and passes of the model."""
    model = models.load()
    b, passes, decisions = bench(model=model, height=0.35, wall=0.5), [0], []

    def asked(*arguments):
        passes[0] += 1
        return in_full(*arguments)

    in_full = push._by_surrogate
    with monkeypatch.context() as m:
        m.setattr(push, "_by_surrogate", asked)
        if always_in_full:
            m.setattr(push, "_stays", lambda *_: False)
        for k in range(round(SECONDS / 0.02)):
            t = 0.02 * k
            b.height = 0.35 + 0.03 * math.sin(t)
            b.wall = 0.5 + 0.04 * math.sin(0.7 * t) + (0.1 if t > 0.8 * SECONDS else 0.0)
            b.rpm = 4000.0 * (1.0 + 0.01 * math.sin(3.0 * t))
            decisions.append(b.tick())
    return decisions, passes[0]


def test_offsets_are_those_of_the_surrogate_within_a_hundredth_and_a_twentieth_of_a_degree(monkeypatch):
    exact, every = hover(monkeypatch, always_in_full=True)
    quick, few = hover(monkeypatch, always_in_full=False)
    assert few < 0.2 * every
    largest = max(abs(d.offset.thrust) for d in exact)
    assert largest > 0.01
    for a, b in zip(exact, quick, strict=True):
        assert b.reasons == a.reasons
        assert b.authority == a.authority
        assert b.offset.thrust == pytest.approx(a.offset.thrust, abs=0.01 * largest)
        assert math.degrees(b.offset.roll) == pytest.approx(math.degrees(a.offset.roll), abs=0.05)
        assert math.degrees(b.offset.pitch) == pytest.approx(math.degrees(a.offset.pitch), abs=0.05)

"""The second-order form about a point: as good as the surrogate within its reach, and none where that has kinks."""

from __future__ import annotations

import math

import numpy as np
import pytest

import models
from models.surrogate.neighbourhood import REACH_M, SPEED_REACH, TRUST, expand

SHARE = 4e-3
"""Of the free-air lift: the largest difference anywhere, met where the data's rotor speeds end."""
USUAL_SHARE = 4e-4
"""In 98 of 100 places."""


def places(model, rng, count):
    """Speeds, heights and wall distances of one fan all over the data, every fourth without a wall."""
    c = model.coordinates
    rpm = rng.uniform(0.9 * c.rpm_low, 1.1 * c.rpm_high, count)
    h, d = rng.uniform(c.h_near, c.h_far, count), rng.uniform(c.d_near, c.d_far, count)
    return zip(rpm.tolist(), h.tolist(), np.where(rng.random(count) < 0.25, math.inf, d).tolist(), strict=True)


@pytest.mark.parametrize("name", ["default", "corner_cfd", "corner_cfd_half"])
def test_the_form_differs_from_the_surrogate_by_little_anywhere_within_its_reach(name):
    model, rng = models.load(name), np.random.default_rng(5)
    apart, trusts, smooth = [], [], 0
    for rpm, h, d in places(model, rng, 600):
        near = expand(model, [rpm], [h], [d])
        if not near.forms:
            continue
        smooth += 1
        x, y = rng.uniform(-REACH_M, REACH_M, 2)
        speed = rpm * (1.0 + rng.uniform(-SPEED_REACH, SPEED_REACH))
        offsets = near.offsets([speed], ([h + x], [d + y]))
        exact = model.query(h + x, d + y, speed)
        shares = exact.wrench / model.free_air_law.lift(speed)
        apart.append([abs(near.values(c, offsets[0])[0] - shares[c]) for c in range(6)])
        trusts.append(abs(near.values(TRUST, offsets[0])[0] * model.domain.at_speed(speed) - exact.trust))
        (further,) = near.values(0, offsets[0], 0.02)
        wanted = model.query(h + x, d + y + 0.02, speed).wrench[0] / model.free_air_law.lift(speed)
        assert further == pytest.approx(wanted, abs=SHARE)
    assert smooth > 300
    assert np.max(apart) < SHARE
    assert np.percentile(np.max(apart, axis=1), 98) < USUAL_SHARE
    assert np.percentile(trusts, 98) < 0.02


def test_the_centre_is_the_surrogate_itself():
    model = models.load()
    near = expand(model, [4000.0, 4100.0], [0.4, 0.5], [0.5, math.inf])
    (offsets,) = near.offsets([4000.0, 4100.0], ([0.4, 0.5], [0.5, math.inf]))
    exact = model.query(np.array([0.4, 0.5]), np.array([0.5, math.inf]), np.array([4000.0, 4100.0]))
    lift = model.free_air_law.lift([4000.0, 4100.0])
    values = np.array([near.values(c, offsets) for c in range(6)]).T
    np.testing.assert_allclose(values, exact.wrench / lift[:, None], atol=1e-12)
    np.testing.assert_allclose(near.values(TRUST, offsets), exact.trust, atol=1e-12)


@pytest.mark.parametrize(
    ("rpm", "h", "d"),
    [(4000.0, 0.4 + 2 * REACH_M, 0.5), (4000.0, 0.4, 0.5 - 2 * REACH_M), (4300.0, 0.4, 0.5), (4000.0, 0.4, math.inf),
     (4000.0, math.nan, 0.5), (math.nan, 0.4, 0.5)],
)  # fmt: skip
def test_what_is_out_of_reach_is_said_to_be(rpm, h, d):
    near = expand(models.load(), [4000.0], [0.4], [0.5])
    assert near.forms
    assert near.offsets([rpm], ([h], [d])) is None


def test_there_is_no_form_where_the_data_end_or_the_rotors_stand_still():
    model = models.load()
    c = model.coordinates
    for rpm, h, d in (
        (4000.0, c.h_near + 0.01, 0.5),
        (4000.0, 0.4, c.d_near),
        (2.0 * c.rpm_high, 0.4, 0.5),
        (4000.0, 0.0, 0.5),
        (0.0, 0.4, 0.5),
    ):
        near = expand(model, [rpm], [h], [d])
        assert not near.forms
        assert near.offsets([rpm], ([h], [d])) is not None, "so that it is not tried again at once"

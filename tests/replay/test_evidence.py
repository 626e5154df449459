"""Evidence of a set of terms: the posterior and its log marginal likelihood against the plain formulas."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from made_up import BIAS_M_S2, biased, some

from models.effects import get
from replay.search.evidence import Evidence, Fit
from replay.search.library import Library
from replay.search.noise import Noise
from replay.search.terms import Term
from replay.search.thresholds import TRUST


@pytest.fixture(scope="module")
def evidence() -> Evidence:
    return Evidence(Library([biased()], some("imu_bias", "wind", "rotor_drag")))


@pytest.fixture(scope="module")
def noise(evidence: Evidence) -> Noise:
    return evidence.noises.unfitted


def term(evidence: Evidence, name: str) -> Term:
    return next(t for t in evidence.library.terms if t.name == name)


def log_marginal(fit: Fit, centre: np.ndarray) -> float:
    """Of a Gaussian model with prior N(c, 1), up to a constant of the noise: 1/2 (b^T S^-1 b - c^T c + log det S)."""
    precision = np.linalg.inv(fit.cov)
    return 0.5 * float(fit.b @ precision @ fit.b - centre @ centre + np.linalg.slogdet(fit.cov)[1])


def test_the_wrench_of_an_effect_is_found(evidence: Evidence, noise: Noise) -> None:
    """Its size need not be: an offset of the accelerometer and a tilt of the rotors do nearly the same."""
    library, bias = evidence.library, term(evidence, "imu_bias")
    fit = evidence.fit([bias], noise)
    place = np.searchsorted(bias.columns, bias.places[0])
    wrench = library.wrenches(bias, 0)[0] @ (fit.b[place] * bias.scale[place])
    mass = library.records[0].context.vehicle.mass_kg
    assert wrench[:, 0].mean() == pytest.approx(BIAS_M_S2 * mass, rel=0.1)
    assert abs(wrench[:, 1].mean()) < 0.05 * BIAS_M_S2 * mass


def test_screening_is_the_gain_of_the_log_marginal_likelihood_beside_kept_noise(
    evidence: Evidence, noise: Noise
) -> None:
    library, wind = evidence.library, term(evidence, "wind")
    trims = np.zeros(len(library.trim))
    less = evidence.refit([wind], noise)
    screened = evidence.screen(less)
    for name in ("imu_bias", "rotor_drag"):
        more = term(evidence, name)
        both = evidence.refit([wind, more], noise)
        gain = log_marginal(both, np.concatenate([wind.centre, more.centre, trims])) - log_marginal(
            less, np.concatenate([wind.centre, trims])
        )
        assert screened[library.terms.index(more)] == pytest.approx(gain, rel=1e-6, abs=1e-6)


def test_a_key_screens_its_own_terms_only(evidence: Evidence, noise: Noise) -> None:
    wind = term(evidence, "wind")
    empty = evidence.refit([], noise)
    some_only = evidence.screen(empty, wind.key)
    known = [i for i, t in enumerate(evidence.library.terms) if t.key == wind.key]
    assert np.flatnonzero(np.isfinite(some_only)).tolist() == known
    np.testing.assert_allclose(some_only[known], evidence.screen(empty)[known])


def test_without_any_row_the_posterior_is_the_prior(evidence: Evidence, noise: Noise) -> None:
    drag = term(evidence, "rotor_drag")
    every = np.ones(len(evidence.library.channels[0].run), bool)
    fit = evidence.refit([drag], noise, {0: every})
    part = fit.part(drag)
    np.testing.assert_allclose(fit.b[part], drag.centre, atol=1e-9)
    np.testing.assert_allclose(np.diag(fit.cov)[part], 1.0, atol=1e-9)


def test_the_score_is_the_sum_of_its_parts(evidence: Evidence, noise: Noise) -> None:
    fit = evidence.fit([term(evidence, "imu_bias")], noise)
    assert fit.score == pytest.approx(
        TRUST * fit.evidence + fit.log_in_bounds + fit.significance + fit.prior
    )
    assert fit.score_at_any_size == pytest.approx(fit.score - fit.significance)


def test_the_prior_is_the_effects_chance_spread_over_its_shapes(evidence: Evidence) -> None:
    shapes = [t for t in evidence.library.terms if t.name == "wind"]
    odds = math.log(0.05 / 0.95)
    assert get("wind").search.log_odds(evidence.library.records[0].context) == pytest.approx(odds)
    assert sum(math.exp(t.prior - odds) for t in shapes) == pytest.approx(1.0)


def test_a_set_that_was_fitted_is_not_fitted_again(evidence: Evidence, noise: Noise) -> None:
    terms = [term(evidence, "imu_bias")]
    assert evidence.fit(terms, noise) is evidence.fit(list(terms), noise)


def test_what_is_beyond_its_bounds_is_held_there_and_the_others_follow() -> None:
    """With P = S^-1 the others are m_o - P_oo^-1 P_ob (bound - m_b), and as sure as P_oo^-1."""
    evidence = Evidence(Library([biased()], some("imu_bias", "wind", "rotor_drag")))
    fit = evidence.fit([term(evidence, "wind")], evidence.noises.unfitted)
    (wind,) = fit.terms
    of_wind = len(wind.low)
    within = np.clip(fit.b[:of_wind], wind.low, wind.high)
    inside = replace(fit, b=np.concatenate([within, fit.b[of_wind:]]))
    assert evidence.held_at_bounds(inside) is None
    beyond = inside.b.copy()
    beyond[0] = wind.high[0] + 3.0
    held = evidence.held_at_bounds(replace(fit, b=beyond))
    assert held is not None
    assert held.b[0] == pytest.approx(wind.high[0])
    precision = np.linalg.inv(fit.cov)
    shift = np.linalg.solve(precision[1:, 1:], precision[1:, 0] * -3.0)
    np.testing.assert_allclose(held.b[1:], beyond[1:] - shift, rtol=1e-6, atol=1e-9)
    np.testing.assert_allclose(held.cov[0], 0.0, atol=1e-12)
    np.testing.assert_allclose(
        held.cov[1:, 1:], np.linalg.inv(precision[1:, 1:]), rtol=1e-5, atol=1e-9
    )

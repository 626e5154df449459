"""Inner products of a channel's rows: the same whenever and in whatever order they are asked for."""

from __future__ import annotations

import numpy as np
import pytest

from replay.search.channel import ResidualChannel, Whitened
from replay.search.noise_spectra import spectra, valid_before
from replay.search.terms import STEP_S

SAMPLES = 80
SPECTRUM = spectra(STEP_S)[5]


@pytest.fixture
def rng() -> np.random.Generator:
    return np.random.default_rng(3)


def made(rng: np.random.Generator, *widths: int) -> ResidualChannel:
    """A channel with a gap and blocks of so many columns; column 0 does not act."""
    valid = np.arange(SAMPLES) % 31 > 2
    channel = ResidualChannel(0, 2, rng.standard_normal(SAMPLES), valid_before(valid), 1.0)
    first = 1
    for width in widths:
        channel.add(np.arange(first, first + width), rng.standard_normal((SAMPLES, width)))
        first += width
    return channel


def plain(channel: ResidualChannel) -> np.ndarray:
    """All inner products at once."""
    rows = SPECTRUM.whiten(channel.rows.T, channel.run).T
    return rows @ rows.T


def all_rows(channel: ResidualChannel) -> np.ndarray:
    return np.arange(len(channel.rows))


def test_products_are_the_same_in_whatever_order_they_are_asked_for(
    rng: np.random.Generator,
) -> None:
    channel = made(rng, 3, 2)
    white = Whitened(channel, SPECTRUM)
    expected = plain(channel)
    blocks = np.array([[1, 2, 3], [4, 5, -1]])
    within = white.within(blocks)
    np.testing.assert_allclose(within[0], expected[1:4, 1:4])
    np.testing.assert_allclose(within[1, :2, :2], expected[4:, 4:])
    assert (within[1, 2] == 0.0).all()
    some = np.array([0, 5, 2])
    others = np.array([1, -1, 4])
    np.testing.assert_allclose(
        white.between(some, others)[:, [0, 2]], expected[np.ix_(some, [1, 4])]
    )
    assert (white.between(some, others)[:, 1] == 0.0).all()
    np.testing.assert_allclose(white.between(all_rows(channel), all_rows(channel)), expected)


def test_columns_that_come_later_are_known_too(rng: np.random.Generator) -> None:
    channel = made(rng, 2)
    white = Whitened(channel, SPECTRUM)
    white.between(all_rows(channel), all_rows(channel))
    for first in range(3, 43, 4):
        channel.add(np.arange(first, first + 4), rng.standard_normal((SAMPLES, 4)))
        rows = all_rows(channel)
        np.testing.assert_allclose(white.between(rows, rows), plain(channel), rtol=1e-9)


def test_sums_of_columns_have_the_products_of_sums(rng: np.random.Generator) -> None:
    channel = made(rng, 3, 2)
    white = Whitened(channel, SPECTRUM)
    mixing = rng.standard_normal((4, 3))
    # Column 0 does not act: its share of the sums is nothing.
    channel.mix(np.arange(6, 9), np.array([1, 0, 3, 4]), mixing)
    np.testing.assert_allclose(channel.rows[6:], mixing[[0, 2, 3]].T @ channel.rows[[1, 3, 4]])
    rows = all_rows(channel)
    np.testing.assert_allclose(white.between(rows[::-1], rows)[::-1], plain(channel), atol=1e-9)


def test_what_is_forgotten_leaves_nothing_behind(rng: np.random.Generator) -> None:
    channel = made(rng, 3)
    white = Whitened(channel, SPECTRUM)
    of = np.array([1, 2, 3])
    for seed in (1, 2):
        fresh = np.arange(10 * seed, 10 * seed + 2)
        channel.mix(fresh, of, np.random.default_rng(seed).standard_normal((3, 2)))
        rows = all_rows(channel)
        np.testing.assert_allclose(white.between(rows, rows), plain(channel), atol=1e-9)
        channel.forget(fresh)
        white.forget()
        assert (channel.where[fresh] == -1).all()
    channel.add(np.array([30]), rng.standard_normal((SAMPLES, 1)))
    rows = all_rows(channel)
    np.testing.assert_allclose(white.between(rows, rows), plain(channel), atol=1e-9)


def test_what_does_not_act_has_no_products_with_what_takes_a_forgotten_place(
    rng: np.random.Generator,
) -> None:
    channel = made(rng, 3)
    white = Whitened(channel, SPECTRUM)
    white.between(all_rows(channel), all_rows(channel))
    channel.forget(np.array([2, 3]))
    white.forget()
    channel.add(np.array([4]), rng.standard_normal((SAMPLES, 1)))
    products = white.between(all_rows(channel), np.array([0, -1]))
    assert (products[:, 1] == 0.0).all()
    assert (white.between(np.array([-1]), all_rows(channel)) == 0.0).all()

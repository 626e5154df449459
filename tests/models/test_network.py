"""The stacked torch nets: errors, descent, populations, parity with what flies."""

from __future__ import annotations

import numpy as np
import pytest

from models.surrogate.net_ensemble import NetEnsemble

torch = pytest.importorskip("torch", reason="training extra not installed")
from models.training import network  # noqa: E402

HIDDEN = 9


def _batch(nets: int = 4, rows: int = 50) -> tuple[network.Batch, tuple[np.ndarray, ...]]:  # type: ignore[type-arg]
    rng = np.random.default_rng(0)
    x, gate = rng.uniform(-1, 1, (nets, rows, 3)), rng.uniform(0, 1, (nets, rows))
    y, weight = rng.normal(size=(nets, rows)), (rng.random((nets, rows)) < 0.8).astype(float)
    return network.Batch.of(x, gate, y, weight), (
        x,
        gate,
        y,
        weight / weight.sum(axis=1, keepdims=True),
    )


def _theta(nets: int = 4) -> np.ndarray:  # type: ignore[type-arg]
    return np.random.default_rng(1).uniform(-1, 1, (nets, network.genes(HIDDEN)))


def _error(theta, x, gate, y, weight):  # type: ignore[no-untyped-def]
    """The loss written plainly, for autograd."""
    w, b, v, o = theta[:, :27].reshape(-1, 3, 9), theta[:, 27:36], theta[:, 36:45], theta[:, 45]
    out = (torch.tanh(x @ w + b[:, None]) * v[:, None]).sum(-1) + o[:, None]
    return (weight * (gate * out - y) ** 2).sum(1)


def test_a_3_9_1_chromosome_has_46_genes() -> None:
    """Eq. 12."""
    assert network.genes(9) == 46


def test_errors_are_those_of_the_net_written_plainly() -> None:
    batch, arrays = _batch()
    error = _error(torch.as_tensor(_theta()), *(torch.as_tensor(a) for a in arrays))
    ours = network.errors(torch.as_tensor(_theta(), dtype=torch.float32), batch, HIDDEN)
    np.testing.assert_allclose(ours.numpy(), error.numpy(), rtol=1e-5)


def test_the_batched_population_is_the_loop_over_individuals() -> None:
    batch, arrays = _batch()
    population = np.random.default_rng(2).uniform(-1, 1, (4, 7, 46))
    batched = network.population_errors(population, batch, HIDDEN)
    plain = [torch.as_tensor(a) for a in arrays]
    for k in range(7):
        one = _error(torch.as_tensor(population[:, k]), *plain)
        np.testing.assert_allclose(batched[:, k], one.numpy(), rtol=1e-5)


def test_inputs_shared_by_all_nets_give_the_same_errors() -> None:
    _, (x, gate, y, weight) = _batch()
    shared = network.Batch.of(x[:1], gate, y, weight)
    apart = network.Batch.of(np.repeat(x[:1], 4, axis=0), gate, y, weight)
    theta = torch.as_tensor(_theta(), dtype=torch.float32)
    one, other = (network.errors(theta, batch, HIDDEN) for batch in (shared, apart))
    np.testing.assert_allclose(one.numpy(), other.numpy(), rtol=1e-4)
    population = np.random.default_rng(2).uniform(-1, 1, (4, 7, 46))
    one, other = (network.population_errors(population, batch, HIDDEN) for batch in (shared, apart))
    np.testing.assert_allclose(one, other, rtol=1e-5)


@pytest.mark.slow
def test_adam_is_that_of_the_paper() -> None:
    """Eqs. 5-10, lambda^t as a power with t from 1; the first step is the rate times the gradient's sign."""
    batch, _ = _batch()
    one = network.descend(_theta(), batch, HIDDEN, 1, adam_rate=0.01)
    np.testing.assert_allclose(np.abs(one - _theta()), 0.01, rtol=1e-2)


@pytest.mark.parametrize("adam_rate", [None, 0.01])
def test_descent_and_adam_lower_every_nets_error(adam_rate: float | None) -> None:
    batch, _ = _batch()
    after = network.descend(_theta(), batch, HIDDEN, 200, adam_rate=adam_rate)
    before, then = (
        network.errors(torch.as_tensor(t, dtype=torch.float32), batch, HIDDEN)
        for t in (_theta(), after)
    )
    assert bool((then < before).all())


def test_what_flies_is_what_was_trained() -> None:
    """Parity of the numpy forward pass with torch's, in double precision."""
    theta = np.random.default_rng(3).normal(size=(5 * 6, 46))
    w1, b1, w2, b2 = (a.reshape(5, 6, *a.shape[1:]) for a in network.unpack(theta, HIDDEN))
    nets = NetEnsemble(w1, b1, w2, b2)
    x = np.random.default_rng(4).uniform(-1, 1, (40, 3))
    t = torch.as_tensor(theta)
    w, b, v, o = t[:, :27].reshape(-1, 3, 9), t[:, 27:36], t[:, 36:45], t[:, 45]
    out = (torch.tanh(torch.as_tensor(x) @ w + b[:, None]) * v[:, None]).sum(-1) + o[:, None]
    expected = out.reshape(5, 6, 40).permute(0, 2, 1).numpy()
    np.testing.assert_allclose(nets.outputs(x), expected, atol=1e-12)
    mean, spread = nets.predict(x)
    np.testing.assert_allclose(mean, expected.mean(0), atol=1e-12)
    np.testing.assert_allclose(spread, expected.std(0, ddof=1), atol=1e-12)

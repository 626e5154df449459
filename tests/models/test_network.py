"""The stacked torch nets: gradient, Adam against torch's own, populations, parity with what flies."""

from __future__ import annotations

import numpy as np
import pytest

from models.surrogate.net_ensemble import NetEnsemble
from models.training.adam import Adam, Descent

torch = pytest.importorskip("torch", reason="training extra not installed")
from models.training import network  # noqa: E402

HIDDEN = 9


def _batch(nets: int = 4, rows: int = 50) -> tuple[network.Batch, tuple[np.ndarray, ...]]:  # type: ignore[type-arg]
    rng = np.random.default_rng(0)
    x, gate = rng.uniform(-1, 1, (nets, rows, 3)), rng.uniform(0, 1, (nets, rows))
    y, weight = rng.normal(size=(nets, rows)), (rng.random((nets, rows)) < 0.8).astype(float)
    return network.Batch.of(x, gate, y, weight), (x, gate, y, weight / weight.sum(axis=1, keepdims=True))


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


def test_the_gradient_is_autograds() -> None:
    batch, arrays = _batch()
    plain = [torch.as_tensor(a) for a in arrays]
    theta = torch.as_tensor(_theta()).requires_grad_()
    error = _error(theta, *plain)
    error.sum().backward()
    g, mse = network.gradient(torch.as_tensor(_theta(), dtype=torch.float32), batch, HIDDEN)
    np.testing.assert_allclose(g.numpy(), theta.grad.numpy(), rtol=1e-4, atol=1e-6)
    np.testing.assert_allclose(mse.numpy(), error.detach().numpy(), rtol=1e-5)


def test_the_batched_population_is_the_loop_over_individuals() -> None:
    batch, arrays = _batch()
    population = np.random.default_rng(2).uniform(-1, 1, (4, 7, 46))
    batched = network.PopulationError(batch, HIDDEN)(population)
    plain = [torch.as_tensor(a) for a in arrays]
    for k in range(7):
        one = _error(torch.as_tensor(population[:, k]), *plain)
        np.testing.assert_allclose(batched[:, k], one.numpy(), rtol=1e-5)


def test_units_kept_from_the_last_population_change_no_error() -> None:
    batch, _ = _batch()
    rng = np.random.default_rng(2)
    population = rng.uniform(-1, 1, (4, 7, 46))
    kept = network.PopulationError(batch, HIDDEN)
    kept(population)
    for share in (0.0, 0.02, 0.5, 1.0):
        population = np.where(rng.random(population.shape) < share, rng.uniform(-1, 1, population.shape), population)
        np.testing.assert_allclose(
            kept(population), network.PopulationError(batch, HIDDEN)(population), rtol=1e-5, err_msg=f"{share}"
        )


def test_inputs_shared_by_all_nets_give_the_same_errors_and_gradients() -> None:
    _, (x, gate, y, weight) = _batch()
    shared = network.Batch.of(x[:1], gate, y, weight)
    apart = network.Batch.of(np.repeat(x[:1], 4, axis=0), gate, y, weight)
    theta = torch.as_tensor(_theta(), dtype=torch.float32)
    for one, other in zip(network.gradient(theta, shared, HIDDEN), network.gradient(theta, apart, HIDDEN), strict=True):
        np.testing.assert_allclose(one.numpy(), other.numpy(), rtol=1e-4, atol=1e-5)
    population = np.random.default_rng(2).uniform(-1, 1, (4, 7, 46))
    one, other = (network.PopulationError(b, HIDDEN)(population) for b in (shared, apart))
    np.testing.assert_allclose(one, other, rtol=1e-5)


def test_adam_is_the_reference_adam() -> None:
    """Eqs. 5-10, lambda^t as a power with t from 1, against torch.optim.Adam."""
    start = torch.linspace(-1, 1, 11, dtype=torch.float64)
    ours, theirs = start.clone(), start.clone().requires_grad_()
    rule, reference = Adam(0.01, None), torch.optim.Adam([theirs], lr=0.01)
    for t in range(1, 200):
        rule.step(ours, 4 * ours**3 - ours, t, 200)
        reference.zero_grad()
        (theirs**4 - 0.5 * theirs**2).sum().backward()
        reference.step()
    np.testing.assert_allclose(ours.numpy(), theirs.detach().numpy(), atol=1e-10)


def test_adam_takes_numpy_too_and_its_rate_ends_small() -> None:
    theta, rule = np.array([1.0]), Adam(0.1, 1e-4)
    steps = []
    for t in range(1, 101):
        before = theta.copy()
        rule.step(theta, np.array([1.0]), t, 100)
        steps.append(float(before[0] - theta[0]))
    assert steps[0] == pytest.approx(0.1, rel=1e-6)
    assert steps[-1] < 0.001


def test_descent_and_adam_lower_every_nets_error() -> None:
    batch, _ = _batch()
    for rule in (Descent(), Adam()):
        before = network.gradient(torch.as_tensor(_theta(), dtype=torch.float32), batch, HIDDEN)[1]
        after = network.descend(_theta(), batch, HIDDEN, rule, 200)
        then = network.gradient(torch.as_tensor(after, dtype=torch.float32), batch, HIDDEN)[1]
        assert bool((then < before).all())


def test_masked_genes_stay_zero() -> None:
    batch, _ = _batch()
    mask = (np.arange(46) % 3 > 0).astype(float)[None].repeat(4, 0)
    theta = network.descend(_theta() * mask, batch, HIDDEN, Adam(), 20, mask=mask)
    assert np.all(theta[mask == 0.0] == 0.0)
    assert np.all(theta[mask == 1.0] != 0.0)


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

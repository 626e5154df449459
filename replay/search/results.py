"""What a search found in one record: sizes with intervals, aliases, and why the rest was rejected."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from models.effects import Effect
from models.frames import Array
from replay.residual.record import Record
from replay.search.free_curves import Channel, Leftover
from replay.search.gram import inverse
from replay.search.library import Candidate, columns_of, out_of_range, same_kind
from replay.search.noise import Noise
from replay.search.shapes import best_shape
from replay.search.workspace import ALIAS_BIC, ALIAS_OF_SCORE, CLASS_SHARE, THRUST_TO_MASS, Workspace

ALIAS_SHARE = 0.15
"""An alias takes as much off held-out time, less this share."""
OFFSET_AND_DRAG = ("imu_bias", "rotor_drag")
"""What a flight without a turn cannot tell from wind: a force fixed to the body, and drag on the own motion."""


@dataclass(frozen=True)
class Estimate:
    """One parameter with its 95 % interval."""

    name: str
    value: float
    ci95: tuple[float, float]
    unit: str


@dataclass(frozen=True)
class Found:
    """An effect that was adopted."""

    effect: Effect
    shape: tuple[float, ...]
    coefficients: Array
    estimates: tuple[Estimate, ...]
    axes: tuple[str, ...]
    explains: float
    q_value: float
    stability: float
    aliases: tuple[str, ...]

    @property
    def parameters(self) -> dict[str, float]:
        """As a model directory keeps them."""
        return self.effect.parameters(self.coefficients, self.shape)


@dataclass(frozen=True)
class Rejected:
    """An effect that was not adopted, and why; ``excited`` is False where the flight could not have shown it."""

    name: str
    reason: str
    excited: bool
    p: float | None = None


@dataclass(frozen=True)
class Trace:
    """What the search found in one record. ``before``, ``after``: residuals on held-out time (n, 6).

    ``leftover`` is what free curves find beside the effects, ``riddle`` its channels but for errors of form.
    """

    record: Record
    found: tuple[Found, ...]
    rejected: tuple[Rejected, ...]
    leftover: Leftover
    riddle: tuple[Channel, ...]
    before: Array
    after: Array
    noise: Noise

    def rms(self, residual: Array) -> Array:
        """RMS per axis over the judged time, (6,)."""
        out: Array = np.sqrt(np.mean(residual[self.record.valid] ** 2, axis=0))
        return out


def report(w: Workspace, chosen: list[Candidate], p_of: dict[str, float]) -> Trace:
    """What was found in the record, with everything that a reader needs to judge it."""
    record, gram = w.record, w.gram
    columns = columns_of(chosen)
    n = len(record.time_s)
    after = w.held_out(columns)
    empty = max(float(gram.held_out(np.empty(0, np.int64)).sum()), 1e-12)
    found = [
        _found(w, candidate, chosen, size, cost / empty, p_of[candidate.effect.name])
        for candidate, size, cost in zip(chosen, w.sizes(chosen), w.costs(chosen), strict=True)
    ]
    before6, after6 = np.zeros((n, 6)), np.zeros((n, 6))
    before6[:, list(record.axes)], after6[:, list(record.axes)] = w.y, after
    rejected = _rejected(w, chosen)
    return Trace(record, tuple(found), rejected, w.free(chosen), w.riddle(chosen), before6, after6, gram.noise)


def _bootstrap(w: Workspace, candidate: Candidate, chosen: list[Candidate], draws: int = 200) -> tuple[Array, Array]:
    """Coefficients (draws, k) and shapes (draws, s) of fits to blocks drawn with replacement.

    Every draw takes its own best shape, so that the interval of a coefficient holds what the shape leaves open.
    """
    rng = np.random.default_rng(w.seed + 1)
    count = len(w.gram.folds)
    weight = rng.multinomial(count, np.full(count, 1.0 / count), draws).astype(float)
    others = columns_of([c for c in chosen if c is not candidate])
    rivals = [candidate] if candidate.held else [c for c in w.library.candidates if same_kind(c, candidate)]
    columns = np.concatenate([others, columns_of(rivals)])
    r = np.tensordot(weight, w.gram.r[:, columns][:, :, columns], 1)
    ry = weight @ w.gram.ry[:, columns]
    most = np.full(draws, -np.inf)
    sizes = np.zeros((draws, len(candidate.columns)))
    shapes = np.tile(np.asarray(candidate.shape, dtype=float), (draws, 1))
    at = len(others)
    for rival in rivals:
        use = np.concatenate([np.arange(len(others)), np.arange(at, at + len(rival.columns))])
        at += len(rival.columns)
        block = r[:, use][:, :, use]
        # A draw may hold no block in which a rare effect acts: it then says nothing of it, not an error.
        fit = (np.linalg.pinv(block, rcond=1e-9, hermitian=True) @ ry[:, use, None])[..., 0]
        gain = (fit * ry[:, use]).sum(axis=1)
        own = fit[:, len(others) :] / w.library.scale[rival.columns]
        if rival is not candidate:
            gain[[out_of_range(rival, size) is not None for size in own]] = -np.inf
        better = gain > most
        most[better], sizes[better], shapes[better] = gain[better], own[better], np.asarray(rival.shape)
    return sizes, shapes


def _found(
    w: Workspace, candidate: Candidate, chosen: list[Candidate], coefficients: Array, explains: float, p: float
) -> Found:
    effect = candidate.effect
    spread, shapes = _bootstrap(w, candidate, chosen)
    low, high = np.percentile(spread, [2.5, 97.5], axis=0)
    estimates = [
        Estimate(c.name, float(v), (float(a), float(b)), c.unit)
        for c, v, a, b in zip(effect.coefficients, coefficients, low, high, strict=True)
    ]
    estimates += [
        Estimate(shape.name, value, _resolved(w, candidate, i, shapes[:, i]), shape.unit)
        for i, (shape, value) in enumerate(zip(effect.shapes, candidate.shape, strict=True))
    ]
    same = np.sign(spread) == np.sign(coefficients)
    return Found(
        effect=effect,
        shape=candidate.shape,
        coefficients=coefficients,
        estimates=tuple(estimates),
        axes=w.carries(candidate, coefficients),
        explains=explains,
        q_value=p,
        stability=float(same.mean(0).max()),
        aliases=_aliases(w, candidate, chosen),
    )


def _resolved(w: Workspace, candidate: Candidate, i: int, drawn: Array) -> tuple[float, float]:
    """95 % interval of a shape parameter; to half way to the next value tried, as a grid tells no more."""
    others = [c.shape[i] for c in w.library.candidates if same_kind(c, candidate)]
    tried = np.unique([candidate.shape[i], *others])
    edges = np.concatenate([tried[:1], (tried[1:] + tried[:-1]) / 2.0, tried[-1:]])
    low, high = np.percentile(drawn, [2.5, 97.5], method="nearest")
    low, high = min(low, candidate.shape[i]), max(high, candidate.shape[i])
    return float(edges[np.searchsorted(tried, low)]), float(edges[np.searchsorted(tried, high) + 1])


def _aliases(w: Workspace, candidate: Candidate, chosen: list[Candidate]) -> tuple[str, ...]:
    """Effects that would do as well in its place."""
    others = [c for c in chosen if c is not candidate]
    columns = columns_of(others)
    scores = w.scores(w.gram, columns, {c.effect.name for c in others})
    own = next((s.value for s in scores if s.candidate.effect.name == candidate.effect.name), None)
    if own is None:
        return ()
    limit = max(ALIAS_BIC, ALIAS_OF_SCORE * own)
    ratio = candidate.effect.name in THRUST_TO_MASS and w.from_start(candidate)
    without = w.gram.held_out(columns).sum()
    gain = without - w.gram.held_out(columns_of(chosen)).sum()
    out = []
    for score in scores:
        name = score.candidate.effect.name
        near = max(limit, CLASS_SHARE * own) if ratio and name in THRUST_TO_MASS else limit
        if name == candidate.effect.name or score.value < own - near:
            continue
        instead = columns_of([*others, score.candidate])
        if without - w.gram.held_out(instead).sum() < (1.0 - ALIAS_SHARE) * gain:
            continue
        coefficients = w.size_beside(score.candidate, others)
        if (
            out_of_range(score.candidate, coefficients) is None
            and (
                (name, candidate.effect.name) == ("imu_bias", "wind")  # velocity may come from that very IMU
                or w.kinematics(score.candidate, coefficients) is None
            )
            and w.core_large(score.candidate, coefficients)
        ):
            out.append(name)
    if candidate.effect.name == "wind":
        together = _together(w, OFFSET_AND_DRAG, others)
        if together and without - w.gram.held_out(columns_of([*others, *together])).sum() >= (
            (1.0 - ALIAS_SHARE) * gain
        ):
            out += [name for name in OFFSET_AND_DRAG if name not in out]
    return tuple(out)


def _together(w: Workspace, names: Sequence[str], others: list[Candidate]) -> list[Candidate]:
    """Candidates of these effects, each with its best shape beside those before it; empty where one is not fit."""
    out: list[Candidate] = []
    if {c.effect.name for c in others} & set(names):
        return out
    for name in names:
        best = best_shape(w, name, columns_of([*others, *out]), set())
        if best is None:
            return []
        out.append(best)
    return out


def _rejected(w: Workspace, chosen: list[Candidate]) -> tuple[Rejected, ...]:
    taken = {c.effect.name for c in chosen}
    out = [Rejected(name, reason, False) for name, reason in w.library.lacking.items()]
    for score in w.scores(w.gram, columns_of(chosen), taken):
        name = score.candidate.effect.name
        reason, p = w.reasons.get(name, ("no better than chance", None))
        floor = _detectable(w, score.candidate, chosen)
        if not floor:
            reason = "this flight hardly excites it: " + score.candidate.effect.excite
        out.append(Rejected(name, reason, floor, p))
    return tuple(out)


def _detectable(w: Workspace, candidate: Candidate, chosen: list[Candidate]) -> bool:
    """Whether an effect of the smallest size worth a name would have stood out (three standard errors)."""
    schur, _, _ = w.gram.project(columns_of(chosen))
    cov = inverse(schur, w.gram.total_w, candidate.columns)
    if not cov.any():
        return False
    error = np.sqrt(np.maximum(np.diag(cov), 0.0)) / w.library.scale[candidate.columns]
    for j in range(len(error)):
        unit = np.zeros(len(error))
        unit[j] = 3.0 * error[j]
        if error[j] > 0 and not w.large(0.34 * w.contribution(candidate, unit)):
            return True
    return False

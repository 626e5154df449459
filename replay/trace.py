"""Which effect of the catalogue carries a flight's residual: forward search with honest nulls (docs/diagnose.md)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from models.effects import Context, Effect, catalogue
from models.wrench import AXES, GRAVITY, Array
from replay.blocks import (
    FOLDS,
    Noise,
    block_numbers,
    embargo_blocks,
    fit_noise,
    fold_of_block,
    training_blocks,
    whiten,
)
from replay.residual import Record
from replay.shift_null import Chance, flips
from replay.unexplained import COMMANDED, Channel, Leftover, free_search

Columns = NDArray[np.int64]

ALPHA = 0.01
MOST_EFFECTS = 6
SMALLEST = 0.01
"""Smallest effect worth a name: 99th percentile of its force over the weight (of its moment over weight x lever)."""
SMALLEST_GAIN = 0.03
"""Smallest share of the energy of its axes that an effect must take off time that its fit never saw."""
FORM_TOLERANCE = 0.12
"""An addition below this share of what is already explained on its axes is taken for the form error of a term."""
FREE_CURVE_FACTOR = 1.5
BIAS_DOUBT = 0.3
"""Difference [m/s^2] from what velocity and attitude tell of the accelerometer's offset, along z."""
CONSTANT = 0.1
"""Share of an effect's energy that varies, below which it is a constant."""
MERGED = 0.9
"""One effect in place of two has to keep this much of what the smaller one adds."""
ALIAS_BIC = 10.0
ALIAS_SHARE = 0.15
"""An alias takes as much off held-out time, less this share."""
BLOCK_S = 1.5
LAG_DOUBT_S = 0.02
FEW_BLOCKS, FEW_SCORE = 6.0, 60.0
"""Evidence from so few blocks that chance has heavy tails in them has to be so strong."""
CARRIES = 0.25
"""An effect carries an axis where it is this strong beside its strongest axis, in units of the noise."""
WORSE = 0.1
"""Share by which the held-out energy of an axis may grow before it tells against what carries that axis."""
OFFSET_AND_DRAG = ("imu_bias", "rotor_drag")
"""What a flight without a turn cannot tell from wind: a force fixed to the body, and drag on the own motion."""
THRUST_TO_MASS = ("payload", "thrust_scale", "air_density")
SHAPE_BIC = 6.0
"""Evidence (BIC) from which on another shape than theory's is believed."""
AT_SHAPE = (0.8, 1.25)
"""Ratio of a length to the length at which it was linearised."""
CLASS_SHARE = 0.12
"""IMU and rotor speed see only the ratio of thrust to mass: members of that class within this share are aliases."""


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
    """What the search found in one record. ``before``, ``after``: residuals on held-out time (n, 6)."""

    record: Record
    found: tuple[Found, ...]
    rejected: tuple[Rejected, ...]
    leftover: Leftover
    before: Array
    after: Array
    noise: Noise

    def rms(self, residual: Array) -> Array:
        """RMS per axis over the judged time, (6,)."""
        out: Array = np.sqrt(np.mean(residual[self.record.valid] ** 2, axis=0))
        return out


@dataclass(frozen=True, eq=False)
class _Candidate:
    effect: Effect
    shape: tuple[float, ...]
    columns: Columns
    held: tuple[int, ...] = ()
    """Coefficients that are held at zero."""


class _NotMeant(str):
    """A reason that speaks against the effect itself, not for another one: weaker candidates stay in the race."""


class _Library:
    """Every candidate's regressors in one array (n, axes, K)."""

    def __init__(self, record: Record, effects: Sequence[Effect]) -> None:
        self.candidates: list[_Candidate] = []
        self.lacking: dict[str, str] = {}
        self.record = record
        self.x: Array = np.zeros((len(record.time_s), len(record.axes), 0))
        self.scale: Array = np.zeros(0)
        todo: list[tuple[Effect, tuple[float, ...]]] = []
        for effect in effects:
            reason = effect.lacking(record.context)
            if effect.needs_moments and 3 not in record.axes:
                reason = "this log cannot judge moments"
            forces = {AXES.index(a) for a in effect.axes} & {0, 1, 2}
            if forces and not forces & set(record.axes):
                reason = "this log cannot judge the force that it makes"
            if effect.name == "motor_lag" and record.delays and record.delays[0].correlation < COMMANDED:
                reason = "the thrust varied hardly more than it answers disturbances; " + effect.excite
            if reason is not None:
                self.lacking[effect.name] = reason
                continue
            todo += [(effect, shape) for shape in effect.shape_grid(record.context)]
        self.add(todo)
        # The vertical part of an accelerometer offset looks like a scale of the thrust: it may be held at zero.
        self.candidates += [self.without(c, 2) for c in self.candidates if c.effect.name == "imu_bias"]

    def add(self, todo: Sequence[tuple[Effect, tuple[float, ...]]]) -> None:
        """Candidates behind those there are."""
        count = len(self.scale)
        parts: list[Array] = []
        for effect, shape in todo:
            x = _evaluate(effect, self.record.context, shape)[:, list(self.record.axes)]
            parts.append(np.nan_to_num(x, posinf=0.0, neginf=0.0))
            width = x.shape[2]
            self.candidates.append(_Candidate(effect, shape, np.arange(count, count + width)))
            count += width
        if not parts:
            return
        x = np.concatenate(parts, axis=2)
        # One scale a column, so that Gram matrices are well conditioned; coefficients are scaled back at the end.
        # Axes differ in unit, so the scale is only a size.
        scale = np.sqrt(np.mean(x[self.record.valid] ** 2, axis=(0, 1)))
        scale[scale < 1e-12] = 1.0
        self.x = np.concatenate([self.x, x / scale], axis=2)
        self.scale = np.concatenate([self.scale, scale])

    def without(self, candidate: _Candidate, coefficient: int) -> _Candidate:
        """The candidate with one of its coefficients held at zero."""
        count = len(self.scale)
        keep = np.arange(len(candidate.columns)) != coefficient
        self.x = np.concatenate([self.x, self.x[:, :, candidate.columns] * keep], axis=2)
        self.scale = np.concatenate([self.scale, self.scale[candidate.columns]])
        held = (*candidate.held, coefficient)
        return replace(candidate, columns=np.arange(count, len(self.scale)), held=held)

    def finer(self, candidate: _Candidate, steps: int = 5) -> list[tuple[Effect, tuple[float, ...]]]:
        """Shapes between that of a candidate and its neighbours on the grid, one parameter at a time."""
        out = []
        effect = candidate.effect
        for i, (shape, value) in enumerate(zip(effect.shapes, candidate.shape, strict=True)):
            if not shape.continuous or value in shape.kinds:
                continue
            grid = sorted({c.shape[i] for c in self.candidates if c.effect is effect} - set(shape.kinds))
            at = grid.index(value)
            for near in (grid[at - 1 : at] or [value]) + (grid[at + 1 : at + 2] or [value]):
                between = np.linspace(value, near, steps + 1)[1:-1] if near != value else ()
                out += [(effect, (*candidate.shape[:i], float(v), *candidate.shape[i + 1 :])) for v in between]
        return out


def _evaluate(effect: Effect, ctx: Context, shape: tuple[float, ...]) -> Array:
    with np.errstate(invalid="ignore", over="ignore"):
        return effect.regressors(ctx, shape)


class _Gram:
    """Whitened and raw inner products of all columns, block by block; the search itself is small linear algebra."""

    def __init__(self, record: Record, x: Array, y: Array, noise: Noise) -> None:
        self.noise = noise
        valid = record.valid
        self.xw, _ = whiten(x, valid, noise)
        self.yw, _ = whiten(y, valid, noise)
        tau = float(np.max(noise.tau_s))
        self.block = block_numbers(valid, record.step_s, BLOCK_S)
        count = int(self.block.max()) + 1
        k = x.shape[2]
        coarse = self.block * min(count, 128) // count
        blocks = int(coarse.max()) + 1
        seconds = record.seconds / blocks
        self.folds = fold_of_block(blocks, seconds)
        self.embargo = embargo_blocks(float(np.median(noise.tau_s)), seconds)
        self.coarse = coarse
        self.w, self.wy = np.zeros((blocks, k, k)), np.zeros((blocks, k))
        self.r, self.ry, self.yy = np.zeros((blocks, k, k)), np.zeros((blocks, k)), np.zeros(blocks)
        sigma = noise.total
        for b in range(blocks):
            rows = coarse == b
            xb, yb = self.xw[rows].reshape(-1, k), self.yw[rows].reshape(-1)
            self.w[b], self.wy[b] = xb.T @ xb, xb.T @ yb
            use = rows & valid
            xr = (x[use] / sigma[:, None]).reshape(-1, k)
            yr = (y[use] / sigma).reshape(-1)
            self.r[b], self.ry[b], self.yy[b] = xr.T @ xr, xr.T @ yr, yr @ yr
        self.total_w, self.total_wy = self.w.sum(0), self.wy.sum(0)
        self.total_r, self.total_ry = self.r.sum(0), self.ry.sum(0)
        self.effective = max(record.seconds / tau, 10.0)

    def solve(self, columns: Columns, blocks: NDArray[np.bool_] | NDArray[np.int64] | None = None) -> Array:
        """Generalised least squares on (some of) the blocks."""
        if blocks is None:
            w, wy = self.total_w[np.ix_(columns, columns)], self.total_wy[columns]
        else:
            w, wy = self.w[blocks][:, columns][:, :, columns].sum(0), self.wy[blocks][:, columns].sum(0)
        out: Array = np.linalg.lstsq(w + 1e-9 * np.trace(w) / max(len(columns), 1) * np.eye(len(columns)), wy)[0]
        return out

    def size(self, columns: Columns, blocks: NDArray[np.bool_] | NDArray[np.int64] | None = None) -> Array:
        """Least squares weighted by axis only: sizes that errors of form in the fast part do not bend."""
        if not len(columns):
            return np.empty(0)
        if blocks is None:
            r, ry = self.total_r[np.ix_(columns, columns)], self.total_ry[columns]
        else:
            r, ry = self.r[blocks][:, columns][:, :, columns].sum(0), self.ry[blocks][:, columns].sum(0)
        out: Array = np.linalg.lstsq(r + 1e-9 * np.trace(r) / len(columns) * np.eye(len(columns)), ry)[0]
        return out

    def fold_coefficients(self, columns: Columns) -> list[Array]:
        """One fit a fold, each without the fold and its embargo."""
        return [self.size(columns, training_blocks(self.folds, f, self.embargo)) for f in range(FOLDS)]

    def held_out(self, columns: Columns) -> Array:
        """Energy left in every fold (FOLDS,) by fits that never saw it, in units of the noise."""
        energy = np.zeros(FOLDS)
        fits = self.fold_coefficients(columns) if len(columns) else [np.empty(0)] * FOLDS
        for f in range(FOLDS):
            rows = self.folds == f
            energy[f] = self.yy[rows].sum()
            if len(columns):
                b = fits[f]
                r = self.r[rows][:, columns][:, :, columns].sum(0)
                energy[f] += -2.0 * b @ self.ry[rows][:, columns].sum(0) + b @ r @ b
        return energy

    def project(self, selected: Columns, beside: Columns | None = None) -> tuple[Array, Array, Array]:
        """Schur complement of the selected columns (K, K), the map (s, K) to it, X^T e by flip block (blocks, K).

        ``e`` is what the selected columns leave of the residual, or, if given, the columns ``beside``.
        """
        count = int(self.block.max()) + 1
        taken = selected if beside is None else beside
        e = self.yw - (self.xw[:, :, taken] @ self.solve(taken) if len(taken) else 0.0)
        products = np.einsum("nak,na->nk", self.xw, e)
        parts = np.zeros((count, products.shape[1]))
        np.add.at(parts, self.block, products)
        if not len(selected):
            return self.total_w, np.zeros((0, products.shape[1])), parts
        ws = self.total_w[np.ix_(selected, selected)]
        cross = self.total_w[selected]
        mapping = np.linalg.solve(ws + 1e-9 * np.trace(ws) / len(selected) * np.eye(len(selected)), cross)
        return self.total_w - cross.T @ mapping, mapping, parts - parts[:, selected] @ mapping


@dataclass(frozen=True)
class _Score:
    candidate: _Candidate
    value: float


class _Search:
    """Forward search over one record."""

    def __init__(self, record: Record, effects: Sequence[Effect], seed: int) -> None:
        self.record = record
        self.seed = seed
        self.library = _Library(record, effects)
        self.y = np.nan_to_num(record.residual[:, list(record.axes)])
        self.lever = max(
            float(np.max([np.linalg.norm(f.position_m) for f in record.context.vehicle.fans])),
            record.context.vehicle.rotor_radius_m,
        )
        self.reasons: dict[str, tuple[str, float | None]] = {}
        self.best: Columns = np.empty(0, np.int64)
        self._searched: tuple[object, Leftover] | None = None
        self.gram = self._noise_model()

    # --- Noise ----

    def _noise_model(self, given: Sequence[_Candidate] = ()) -> _Gram:
        """Noise from what no combination of effects explains, so that a missing effect does not pass for noise."""
        x, y, valid, step = self.library.x, self.y, self.record.valid, self.record.step_s
        fast = fit_noise(np.diff(y, axis=0, prepend=y[:1]), valid, step)
        noise = replace(fast, ar=np.zeros_like(fast.ar), innovation=fast.total, total=fast.total)
        gram = _Gram(self.record, x, y, noise)
        per_sample = 15.0
        if given:
            noise = self.gram.noise
            gram = self.gram
        for penalty in (3.0,) if given else (3.0 * per_sample, 3.0, 3.0):
            chosen = self._greedy(gram, penalty * np.log(gram.effective), given)
            noise = fit_noise(self._rest(gram, chosen), valid, step)
            gram = _Gram(self.record, x, y, noise)
            self.best = chosen
        return gram

    def _rest(self, gram: _Gram, chosen: Columns) -> Array:
        fit = self.library.x[:, :, chosen] @ gram.size(chosen) if len(chosen) else 0.0
        rest: Array = self.y - fit
        return rest

    def _greedy(self, gram: _Gram, penalty: float, given: Sequence[_Candidate]) -> Columns:
        chosen: list[_Candidate] = list(given)
        for _ in range(MOST_EFFECTS):
            columns = _columns(chosen)
            scores = self._scores(gram, columns, {c.effect.name for c in chosen})
            if not scores or scores[0].value < penalty:
                break
            chosen.append(scores[0].candidate)
        return _columns(chosen)

    # --- Scores ----

    def _scores(self, gram: _Gram, selected: Columns, taken: set[str]) -> list[_Score]:
        """Best shape of every effect that is not taken, best effect first."""
        schur, _, parts = gram.project(selected)
        g = parts.sum(0)
        best: dict[str, _Score] = {}
        plain: dict[str, _Score] = {}
        for candidate in self.library.candidates:
            if candidate.effect.name in taken or self._ratio_again(candidate, taken):
                continue
            inverse = _inverse(schur, gram.total_w, candidate.columns)
            part = g[candidate.columns]
            value = float(part @ inverse @ part) - len(candidate.columns) * np.log(gram.effective)
            name = candidate.effect.name
            if name not in plain or value > plain[name].value:
                plain[name] = _Score(candidate, value)
            if (name not in best or value > best[name].value) and self._plausible(gram, selected, candidate):
                best[name] = _Score(candidate, value)
        return sorted((plain | best).values(), key=lambda s: -s.value)

    def _plausible(self, gram: _Gram, selected: Columns, candidate: _Candidate) -> bool:
        fit = gram.size(np.concatenate([selected, candidate.columns]))[len(selected) :]
        return self._implausible(candidate, fit / self.library.scale[candidate.columns]) is None

    def _implausible(self, candidate: _Candidate, coefficients: Array) -> str | None:
        """What speaks against these coefficients: their range, or for a vertical offset what velocity tells of it."""
        if candidate.effect.name == "imu_bias":
            bias = self.record.kinematic_bias[self.record.valid, 2]
            if np.isfinite(bias).any() and abs(float(coefficients[2] - np.nanmean(bias))) > BIAS_DOUBT:
                return f"velocity does not bear out an offset of {coefficients[2]:.2g} m/s^2 along z"
        return _implausible(candidate, coefficients)

    def _null(self, gram: _Gram, selected: Columns, taken: set[str]) -> Chance:
        """Scores by chance, in what the best combination of effects leaves: what is there is no noise."""
        schur, _, parts = gram.project(selected, np.union1d(selected, self.best))
        live = [c for c in self.library.candidates if c.effect.name not in taken]
        inverses = [_inverse(schur, gram.total_w, c.columns) for c in live]
        penalties = np.array([len(c.columns) * np.log(gram.effective) for c in live])
        names = [c.effect.name for c in live]
        return flips(parts, names, [c.columns for c in live], inverses, penalties, self.seed)

    # --- Search ----

    def run(self) -> Trace:
        chosen: list[_Candidate] = []
        p_of: dict[str, float] = {}
        for _ in range(MOST_EFFECTS):
            step = self._step(chosen)
            if step is None:
                break
            candidate, p = step
            p_of[candidate.effect.name] = p
            chosen = self._refined([*chosen, candidate])
            self.gram = self._noise_model(chosen)
        chosen = self._merged(self._sharpened(chosen), p_of)
        chosen = self._believed(self._sound(self._backward(chosen)))
        return self._trace(chosen, p_of)

    def _step(self, chosen: list[_Candidate]) -> tuple[_Candidate, float] | None:
        gram, selected = self.gram, _columns(chosen)
        taken = {c.effect.name for c in chosen}
        scores = self._scores(gram, selected, taken)
        if not scores:
            return None
        null = self._null(gram, selected, taken)
        before = gram.held_out(selected)
        failed: list[_Score] = []
        for score in scores:
            name = score.candidate.effect.name
            p = null.p(name, score.value)
            if p > ALPHA:
                self.reasons[name] = (f"no better than chance (p = {p:.2g})", p)
                continue
            same = next((f for f in failed if self._same(score, f, selected)), None)
            if same is not None:
                self.reasons[name] = (f"{same.candidate.effect.name} explains the same much better", p)
                continue
            problem = self._problem(score.candidate, chosen, before)
            if problem is None:
                return self._preferred(score, scores, chosen), p
            self.reasons[name] = (problem, p)
            if not isinstance(problem, _NotMeant):
                failed.append(score)
        return None

    def _same(self, score: _Score, stronger: _Score, selected: Columns) -> bool:
        """Whether little is left of a weak candidate beside a much stronger one."""
        if score.value >= 0.5 * stronger.value:
            return False
        schur, _, parts = self.gram.project(np.concatenate([selected, stronger.candidate.columns]))
        columns = score.candidate.columns
        part = parts.sum(0)[columns]
        left = float(part @ _inverse(schur, self.gram.total_w, columns) @ part)
        return bool(left - len(columns) * np.log(self.gram.effective) < 0.5 * score.value)

    def _free(self, chosen: Sequence[_Candidate]) -> Leftover:
        """What free curves find beside the chosen effects."""
        key = (self.gram, tuple(chosen))
        if self._searched is None or self._searched[0] != key:
            rest = self._rest(self.gram, _columns(chosen))
            self._searched = (key, free_search(self.record, rest, self.gram.noise, self.seed))
        return self._searched[1]

    def _preferred(self, best: _Score, scores: Sequence[_Score], chosen: list[_Candidate]) -> _Candidate:
        """Which member of the class of thrust to mass, where several would do.

        Density is known from pressure and temperature: where it would do, a free mass or scale is not fitted. A load
        less than none is a scale.
        """
        if best.candidate.effect.name not in THRUST_TO_MASS or not self._from_start(best.candidate):
            return best.candidate
        near = {s.candidate.effect.name: s.candidate for s in scores if s.value > (1.0 - CLASS_SHARE) * best.value}
        for name in ("air_density", "thrust_scale"):
            candidate = near.get(name)
            if candidate is None or (name == "thrust_scale" and self._beside_these(best.candidate, chosen)[0] >= 0.0):
                continue
            if _implausible(candidate, self._beside_these(candidate, chosen)) is None:
                return candidate
        return best.candidate

    def _beside_these(self, candidate: _Candidate, chosen: list[_Candidate]) -> Array:
        """Coefficients of a candidate fitted together with the chosen ones."""
        fit = self.gram.size(_columns([*chosen, candidate]))[-len(candidate.columns) :]
        return np.asarray(fit / self.library.scale[candidate.columns])

    @staticmethod
    def _from_start(candidate: _Candidate) -> bool:
        return candidate.effect.name != "payload" or candidate.shape[0] == 0.0

    def _ratio_again(self, candidate: _Candidate, taken: set[str]) -> bool:
        """Whether the ratio of thrust to mass, which one effect sets, has its name already."""
        ratio = candidate.effect.name in THRUST_TO_MASS and self._from_start(candidate)
        return ratio and bool((taken - {candidate.effect.name}) & set(THRUST_TO_MASS))

    def _problem(self, candidate: _Candidate, chosen: list[_Candidate], before: Array) -> str | None:
        """Why a significant candidate is not adopted, or None."""
        gram, selected = self.gram, _columns([*chosen, candidate])
        coefficients = gram.size(selected)[-len(candidate.columns) :] / self.library.scale[candidate.columns]
        bad = self._implausible(candidate, coefficients)
        if bad is not None:
            return _NotMeant(bad)
        late = self._late(candidate, coefficients)
        if late is not None:
            return _NotMeant(late)
        contribution = self._beside(candidate, coefficients, chosen)
        if not self._large(contribution):
            return _NotMeant("too small to matter")
        if not self._core_large(candidate, coefficients):
            return _NotMeant(f"its {' and '.join(candidate.effect.main)} are too small to matter")
        if self._core_share(candidate, coefficients) < FORM_TOLERANCE:
            return _NotMeant(
                f"its {' and '.join(candidate.effect.main)} are within the error of form of its other terms"
            )
        if chosen:
            own = contribution[self.record.valid]
            rest = self.library.x[:, :, _columns(chosen)] @ gram.size(selected)[: -len(candidate.columns)]
            strong = (own**2).mean(0) / gram.noise.total**2
            share = strong / np.maximum((rest[self.record.valid] ** 2).mean(0) / gram.noise.total**2, 1e-12)
            main = strong > 0.25 * strong.max()
            if share[main].min() < FORM_TOLERANCE**2:
                return "within the error of form of what is already adopted"
        if self._once(candidate, _columns(chosen)):
            return _NotMeant("seems to have happened only once, and not strongly: fly it again")
        after = gram.held_out(selected)
        gain = float(before.sum() - after.sum())
        energy = self._energy_on_axes_of(contribution, self._rest(gram, _columns(chosen)))
        if gain < SMALLEST_GAIN * energy:
            return f"takes {max(gain, 0.0) / energy:.1%} off its axes on held-out time: too little"
        problem = self._kinematics(candidate, coefficients)
        if problem is not None:
            return _NotMeant(problem)
        free = self._free(chosen)
        limit = FREE_CURVE_FACTOR * gain + 0.02 * float(before.sum())
        if free.significant and free.gain > limit:
            return f"a free curve in {free.channels[0].name} explains far more"
        return None

    def _once(self, candidate: _Candidate, selected: Columns) -> bool:
        """Whether weak evidence comes from a few blocks of time (their participation number)."""
        schur, _, parts = self.gram.project(selected)
        own = parts[:, candidate.columns]
        evidence = own @ _inverse(schur, self.gram.total_w, candidate.columns) @ own.sum(0)
        total = float(evidence.sum())
        return total < FEW_SCORE and total**2 < FEW_BLOCKS * float((evidence**2).sum())

    def _beside(self, candidate: _Candidate, coefficients: Array, chosen: list[_Candidate]) -> Array:
        """The part of a contribution (n, axes) that the chosen effects cannot take over."""
        out = self._contribution(candidate, coefficients)
        if not chosen:
            return out
        columns, r = _columns(chosen), self.gram.total_r
        own = r[np.ix_(columns, candidate.columns)] @ (coefficients * self.library.scale[candidate.columns])
        block = r[np.ix_(columns, columns)]
        taken = np.linalg.lstsq(block + 1e-9 * np.trace(block) / len(columns) * np.eye(len(columns)), own)[0]
        beside: Array = out - self.library.x[:, :, columns] @ taken
        return beside

    def _late(self, candidate: _Candidate, coefficients: Array) -> str | None:
        """A lag no longer than what the clock correction moved may be of its making (physics.md 6.3, no. 6)."""
        if candidate.effect.name != "motor_lag":
            return None
        moved = max((d.seconds for d in self.record.delays[:1] if d.corrected), default=0.0)
        if float(coefficients[0]) * candidate.shape[0] < moved + LAG_DOUBT_S:
            return f"not beyond the {moved:.2f} s by which the rotor speeds' clock was set right"
        return None

    def _kinematics(self, candidate: _Candidate, coefficients: Array) -> str | None:
        """Velocity and attitude tell an accelerometer offset from a force (physics.md 6.3, stationarity)."""
        bias = self.record.kinematic_bias[self.record.valid]
        if candidate.effect.name not in ("imu_bias", "wind") or not np.isfinite(bias).any():
            return None
        seen = np.nanmean(bias, axis=0)
        if candidate.effect.name == "imu_bias":
            size = float(np.linalg.norm(coefficients))
            if float(seen @ coefficients) / size < 0.4 * size:
                return "velocity and attitude agree with the accelerometer: it has no such offset"
            return None
        mass = self.record.context.vehicle.mass_kg
        push = self._contribution(candidate, coefficients)[self.record.valid][:, :2].mean(axis=0) / mass
        size = float(np.linalg.norm(push))
        if size > 0.02 and float(seen[:2] @ push) / size > 0.6 * size:
            return "velocity and attitude disagree with the accelerometer by as much: its offset, not wind"
        return None

    def _core(self, candidate: _Candidate, coefficients: Array) -> Array:
        """The contribution (n, axes) of the coefficients that make the effect what it is."""
        effect = candidate.effect
        pairs = zip(effect.coefficients, coefficients, strict=True)
        core = np.array([value if not effect.main or c.name in effect.main else 0.0 for c, value in pairs])
        return self._contribution(candidate, core)

    def _core_large(self, candidate: _Candidate, coefficients: Array) -> bool:
        """Whether the coefficients that make the effect what it is matter by themselves."""
        return not candidate.effect.main or self._large(self._core(candidate, coefficients))

    def _core_share(self, candidate: _Candidate, coefficients: Array) -> float:
        """RMS of what makes the effect what it is over that of the whole, on the axis where that is most."""
        valid, noise = self.record.valid, self.gram.noise.total
        core = np.sqrt((self._core(candidate, coefficients)[valid] ** 2).mean(axis=0)) / noise
        whole = np.sqrt((self._contribution(candidate, coefficients)[valid] ** 2).mean(axis=0)) / noise
        carried = core > CARRIES * core.max()
        return float((core[carried] / np.maximum(whole[carried], 1e-12)).max()) if carried.any() else 0.0

    def _contribution(self, candidate: _Candidate, coefficients: Array) -> Array:
        x = self.library.x[:, :, candidate.columns] * self.library.scale[candidate.columns]
        out: Array = x @ coefficients
        return out

    def _large(self, contribution: Array) -> bool:
        weight = self.record.context.vehicle.mass_kg * GRAVITY
        limits = np.array([SMALLEST * weight * (1.0 if a < 3 else self.lever) for a in self.record.axes])
        top = np.percentile(np.abs(contribution[self.record.valid]), 99, axis=0)
        return bool((top >= limits).any())

    def _refined(self, chosen: list[_Candidate]) -> list[_Candidate]:
        """Every shape parameter again, given the others: the one that leaves the least residual."""
        gram = self.gram
        for i, candidate in enumerate(chosen):
            others = _columns([c for j, c in enumerate(chosen) if j != i])
            taken = {c.effect.name for c in chosen}
            best, least = candidate, np.inf
            for other in self.library.candidates:
                if other.effect is not candidate.effect or self._ratio_again(other, taken):
                    continue
                if not self._plausible(gram, others, other):
                    continue
                columns = np.concatenate([others, other.columns])
                left = -float(gram.size(columns) @ gram.total_ry[columns])
                if left < least:
                    best, least = other, left
            chosen = [*chosen[:i], self._usual(best, others), *chosen[i + 1 :]]
        return chosen

    def _usual(self, best: _Candidate, others: Columns) -> _Candidate:
        """Theory's shape in place of the best one, unless that is clearly better."""
        usual = next(
            (c for c in self.library.candidates if c.effect is best.effect and c.shape == best.effect.usual), None
        )
        if usual is None or not self._plausible(self.gram, others, usual):
            return best
        likelihood = []
        for candidate in (best, usual):
            columns = np.concatenate([others, candidate.columns])
            likelihood.append(float(self.gram.solve(columns) @ self.gram.total_wy[columns]))
        bic = likelihood[0] - likelihood[1] - len(best.shape) * np.log(self.gram.effective)
        return best if bic >= SHAPE_BIC else usual

    def _sharpened(self, chosen: list[_Candidate]) -> list[_Candidate]:
        """The same effects with their shape parameters between the points of the grid."""
        finer = [f for candidate in chosen for f in self.library.finer(candidate)]
        if not finer:
            return chosen
        self.library.add(finer)
        self.gram = _Gram(self.record, self.library.x, self.y, self.gram.noise)
        return self._refined(chosen)

    def _merged(self, chosen: list[_Candidate], p_of: dict[str, float]) -> list[_Candidate]:
        """One effect in place of two where it does nearly as well: a drift is no scale with a step."""
        full = self.gram.held_out(_columns(chosen)).sum()
        names = {c.effect.name for c in chosen}
        for one, other in combinations(chosen, 2):
            rest = [c for c in chosen if c is not one and c is not other]
            columns = _columns(rest)
            costs = [self.gram.held_out(_columns([*rest, c])).sum() - full for c in (one, other)]
            for rival in self._scores(self.gram, columns, names - {one.effect.name, other.effect.name}):
                if rival.candidate.effect in (one.effect, other.effect):
                    continue
                instead = self._refined([*rest, rival.candidate])
                lost = float(self.gram.held_out(_columns(instead)).sum() - full)
                if lost >= (1.0 - MERGED) * min(costs):
                    continue
                size = self.gram.size(_columns(instead))[len(columns) :] / self.library.scale[instead[-1].columns]
                if self._kinematics(instead[-1], size) is None and self._sound(instead) == instead:
                    name = rival.candidate.effect.name
                    p_of[name] = max(p_of[c.effect.name] for c in (one, other))
                    for c in (one, other):
                        self.reasons[c.effect.name] = (f"{name} does what it and another did", None)
                    return self._merged(instead, p_of)
        return chosen

    def _backward(self, chosen: list[_Candidate]) -> list[_Candidate]:
        """Drop what takes too little off its axes on held-out time beside the others."""
        while chosen:
            full = self.gram.held_out(_columns(chosen)).sum()
            shares = []
            for candidate in chosen:
                others = _columns([c for c in chosen if c is not candidate])
                fit = self.gram.size(_columns(chosen))[_place(chosen, candidate)]
                own = self._contribution(candidate, fit / self.library.scale[candidate.columns])
                cost = float(self.gram.held_out(others).sum() - full)
                shares.append(cost / self._energy_on_axes_of(own, self._rest(self.gram, others)))
            i = int(np.argmin(shares))
            if shares[i] >= SMALLEST_GAIN:
                break
            self.reasons[chosen[i].effect.name] = ("the other effects do as well without it", None)
            chosen = [c for c in chosen if c is not chosen[i]]
        return chosen

    def _energy_on_axes_of(self, contribution: Array, rest: Array) -> float:
        """Energy of ``rest`` (n, axes), in units of the noise, on the axes that carry a contribution."""
        valid, noise = self.record.valid, self.gram.noise.total**2
        size = (contribution[valid] ** 2).sum(0) / noise
        return float(((rest[valid] ** 2).sum(0) / noise)[size > 0.1 * size.max()].sum())

    def _sound(self, chosen: list[_Candidate]) -> list[_Candidate]:
        """The final set, less what joint refits made implausible or what worsens an axis on held-out time."""
        while chosen:
            columns = _columns(chosen)
            sizes = [self.gram.size(columns)[_place(chosen, c)] / self.library.scale[c.columns] for c in chosen]
            bad: tuple[_Candidate, str] | None = None
            for candidate, size in zip(chosen, sizes, strict=True):
                reason = self._implausible(candidate, size)
                if reason is None and not self._core_large(candidate, size):
                    reason = f"its {' and '.join(candidate.effect.main)} are too small to matter"
                if reason is not None:
                    bad = (candidate, reason)
                    break
            if bad is None:
                valid = self.record.valid
                grown = (self._held_out(columns)[valid] ** 2).sum(axis=0) / (self.y[valid] ** 2).sum(axis=0)
                rms = np.array([self._strength(c, size) for c, size in zip(chosen, sizes, strict=True)])
                blamed = np.where(rms > CARRIES * rms.max(axis=1, keepdims=True), rms, 0.0)
                worst = np.where(blamed.any(axis=0), grown, 0.0)
                axis = int(worst.argmax())
                if worst[axis] < 1.0 + WORSE:
                    return chosen
                name = AXES[self.record.axes[axis]]
                bad = (chosen[int(blamed[:, axis].argmax())], f"makes {name} worse on held-out time")
                lighter = self._without_side_term(bad[0], sizes[chosen.index(bad[0])], axis)
                if lighter is not None:
                    chosen = [lighter if c is bad[0] else c for c in chosen]
                    continue
            self.reasons[bad[0].effect.name] = (bad[1], None)
            chosen = [c for c in chosen if c is not bad[0]]
        return chosen

    def _believed(self, chosen: list[_Candidate]) -> list[_Candidate]:
        """The set less what takes less off an axis than a free curve still finds there: a stand-in for a stranger."""
        while chosen:
            free, columns = self._free(chosen), _columns(chosen)
            if not free.significant:
                return chosen
            rest = self._rest(self.gram, columns)[self.record.valid]
            energy = ((rest - rest.mean(axis=0)) ** 2).sum(axis=0) / self.gram.noise.total**2
            full, fits = self.gram.held_out(columns).sum(), self.gram.size(columns)
            doubtful: list[tuple[float, _Candidate, Channel]] = []
            for candidate in chosen:
                cost = float(self.gram.held_out(_columns([c for c in chosen if c is not candidate])).sum() - full)
                size = fits[_place(chosen, candidate)] / self.library.scale[candidate.columns]
                own = self._contribution(candidate, size)[self.record.valid]
                strength = self._strength(candidate, size)
                for channel in free.channels:
                    axis = self.record.axes.index(AXES.index(channel.axis))
                    # Curves have no mean: they cannot stand for what hardly varies.
                    varies = own[:, axis].var() > CONSTANT * (own[:, axis] ** 2).mean()
                    carried = strength[axis] > CARRIES * strength.max()
                    if carried and varies and channel.score * energy[axis] > cost:
                        doubtful.append((cost, candidate, channel))
            if not doubtful:
                return chosen
            _, candidate, channel = min(doubtful, key=lambda d: d[0])
            reason = f"a free curve in {channel.name} finds more in {channel.axis} than it explains"
            self.reasons[candidate.effect.name] = (reason, None)
            chosen = [c for c in chosen if c is not candidate]
        return chosen

    def _strength(self, candidate: _Candidate, size: Array) -> Array:
        """RMS of a contribution on every axis (axes,), in units of its noise."""
        own = self._contribution(candidate, size)[self.record.valid]
        return np.asarray(np.sqrt((own**2).mean(axis=0)) / self.gram.noise.total)

    def _without_side_term(self, candidate: _Candidate, size: Array, axis: int) -> _Candidate | None:
        """The candidate without the side term that is strongest on an axis; None where it has none there."""
        effect = candidate.effect
        x = self.library.x[:, axis, candidate.columns][self.record.valid] * self.library.scale[candidate.columns]
        strength = np.mean((x * size) ** 2, axis=0)
        for i, coefficient in enumerate(effect.coefficients):
            if not effect.main or coefficient.name in effect.main:
                strength[i] = 0.0
        if not strength.any():
            return None
        lighter = self.library.without(candidate, int(strength.argmax()))
        self.gram = _Gram(self.record, self.library.x, self.y, self.gram.noise)
        return lighter

    def _held_out(self, columns: Columns) -> Array:
        """Residual (n, axes) with every run of time predicted by a fit that never saw it."""
        after = self.y.copy()
        if len(columns):
            for f, fit in enumerate(self.gram.fold_coefficients(columns)):
                rows = self.gram.folds[self.gram.coarse] == f
                after[rows] -= self.library.x[rows][:, :, columns] @ fit
        return after

    # --- Result ----

    def _trace(self, chosen: list[_Candidate], p_of: dict[str, float]) -> Trace:
        record, gram = self.record, self.gram
        columns = _columns(chosen)
        n = len(record.time_s)
        after = self._held_out(columns)
        empty = gram.held_out(np.empty(0, np.int64)).sum()
        found, done = [], empty
        coefficients = gram.size(columns)
        start = 0
        for i, candidate in enumerate(chosen):
            part = slice(start, start + len(candidate.columns))
            start = part.stop
            left = gram.held_out(_columns(chosen[: i + 1])).sum()
            scale = self.library.scale[candidate.columns]
            found.append(
                self._found(
                    candidate, chosen, coefficients[part] / scale,
                    float((done - left) / max(empty, 1e-12)), p_of[candidate.effect.name],
                )
            )  # fmt: skip
            done = left
        leftover = self._free(chosen)
        before6, after6 = np.zeros((n, 6)), np.zeros((n, 6))
        before6[:, list(record.axes)], after6[:, list(record.axes)] = self.y, after
        return Trace(record, tuple(found), self._rejected(chosen), leftover, before6, after6, gram.noise)

    def _bootstrap(self, candidate: _Candidate, chosen: list[_Candidate], draws: int = 200) -> tuple[Array, Array]:
        """Coefficients (draws, k) and shapes (draws, s) of fits to blocks drawn with replacement.

        Every draw takes its own best shape, so that the interval of a coefficient holds what the shape leaves open.
        """
        rng = np.random.default_rng(self.seed + 1)
        count = len(self.gram.folds)
        weight = rng.multinomial(count, np.full(count, 1.0 / count), draws).astype(float)
        others = _columns([c for c in chosen if c is not candidate])
        rivals = [candidate] if candidate.held else [c for c in self.library.candidates if _same_kind(c, candidate)]
        columns = np.concatenate([others, _columns(rivals)])
        r = np.tensordot(weight, self.gram.r[:, columns][:, :, columns], 1)
        ry = weight @ self.gram.ry[:, columns]
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
            own = fit[:, len(others) :] / self.library.scale[rival.columns]
            if rival is not candidate:
                gain[[_implausible(rival, size) is not None for size in own]] = -np.inf
            better = gain > most
            most[better], sizes[better], shapes[better] = gain[better], own[better], np.asarray(rival.shape)
        return sizes, shapes

    def _found(
        self, candidate: _Candidate, chosen: list[_Candidate], coefficients: Array, explains: float, p: float
    ) -> Found:
        effect = candidate.effect
        spread, shapes = self._bootstrap(candidate, chosen)
        low, high = np.percentile(spread, [2.5, 97.5], axis=0)
        estimates = [
            Estimate(c.name, float(v), (float(a), float(b)), c.unit)
            for c, v, a, b in zip(effect.coefficients, coefficients, low, high, strict=True)
        ]
        estimates += [
            Estimate(shape.name, value, self._resolved(candidate, i, shapes[:, i]), shape.unit)
            for i, (shape, value) in enumerate(zip(effect.shapes, candidate.shape, strict=True))
        ]
        strength = self._strength(candidate, coefficients)
        axes = tuple(AXES[a] for a, s in zip(self.record.axes, strength, strict=True) if s > CARRIES * strength.max())
        same = np.sign(spread) == np.sign(coefficients)
        return Found(
            effect=effect,
            shape=candidate.shape,
            coefficients=coefficients,
            estimates=tuple(estimates),
            axes=axes,
            explains=explains,
            q_value=p,
            stability=float(same.mean(0).max()),
            aliases=self._aliases(candidate, chosen),
        )

    def _resolved(self, candidate: _Candidate, i: int, drawn: Array) -> tuple[float, float]:
        """95 % interval of a shape parameter; to half way to the next value tried, as a grid tells no more."""
        others = [c.shape[i] for c in self.library.candidates if _same_kind(c, candidate)]
        tried = np.unique([candidate.shape[i], *others])
        edges = np.concatenate([tried[:1], (tried[1:] + tried[:-1]) / 2.0, tried[-1:]])
        low, high = np.percentile(drawn, [2.5, 97.5], method="nearest")
        low, high = min(low, candidate.shape[i]), max(high, candidate.shape[i])
        return float(edges[np.searchsorted(tried, low)]), float(edges[np.searchsorted(tried, high) + 1])

    def _aliases(self, candidate: _Candidate, chosen: list[_Candidate]) -> tuple[str, ...]:
        """Effects that would do as well in its place."""
        others = [c for c in chosen if c is not candidate]
        columns = _columns(others)
        scores = self._scores(self.gram, columns, {c.effect.name for c in others})
        own = next((s.value for s in scores if s.candidate.effect.name == candidate.effect.name), None)
        if own is None:
            return ()
        limit = max(ALIAS_BIC, 0.03 * own)
        ratio = candidate.effect.name in THRUST_TO_MASS and self._from_start(candidate)
        without = self.gram.held_out(columns).sum()
        gain = without - self.gram.held_out(_columns(chosen)).sum()
        out = []
        for score in scores:
            name = score.candidate.effect.name
            near = max(limit, CLASS_SHARE * own) if ratio and name in THRUST_TO_MASS else limit
            if name == candidate.effect.name or score.value < own - near:
                continue
            instead = _columns([*others, score.candidate])
            if without - self.gram.held_out(instead).sum() < (1.0 - ALIAS_SHARE) * gain:
                continue
            fit = self.gram.size(instead)[-len(score.candidate.columns) :]
            coefficients = fit / self.library.scale[score.candidate.columns]
            if (
                _implausible(score.candidate, coefficients) is None
                and (
                    (name, candidate.effect.name) == ("imu_bias", "wind")  # velocity may come from that very IMU
                    or self._kinematics(score.candidate, coefficients) is None
                )
                and self._core_large(score.candidate, coefficients)
            ):
                out.append(name)
        if candidate.effect.name == "wind":
            together = self._together(OFFSET_AND_DRAG, others)
            if together and without - self.gram.held_out(_columns([*others, *together])).sum() >= (
                (1.0 - ALIAS_SHARE) * gain
            ):
                out += [name for name in OFFSET_AND_DRAG if name not in out]
        return tuple(out)

    def _together(self, names: Sequence[str], others: list[_Candidate]) -> list[_Candidate]:
        """Candidates of these effects, each with its best shape beside those before it; empty where one is not fit."""
        out: list[_Candidate] = []
        if {c.effect.name for c in others} & set(names):
            return out
        for name in names:
            beside = _columns([*others, *out])
            best, least = None, np.inf
            for rival in self.library.candidates:
                if rival.effect.name == name and self._plausible(self.gram, beside, rival):
                    columns = np.concatenate([beside, rival.columns])
                    left = -float(self.gram.size(columns) @ self.gram.total_ry[columns])
                    if left < least:
                        best, least = rival, left
            if best is None:
                return []
            out.append(best)
        return out

    def _rejected(self, chosen: list[_Candidate]) -> tuple[Rejected, ...]:
        taken = {c.effect.name for c in chosen}
        out = [Rejected(name, reason, False) for name, reason in self.library.lacking.items()]
        for score in self._scores(self.gram, _columns(chosen), taken):
            name = score.candidate.effect.name
            reason, p = self.reasons.get(name, ("no better than chance", None))
            floor = self._detectable(score.candidate, chosen)
            if not floor:
                reason = "this flight hardly excites it: " + score.candidate.effect.excite
            out.append(Rejected(name, reason, floor, p))
        return tuple(out)

    def _detectable(self, candidate: _Candidate, chosen: list[_Candidate]) -> bool:
        """Whether an effect of the smallest size worth a name would have stood out (three standard errors)."""
        schur, _, _ = self.gram.project(_columns(chosen))
        cov = _inverse(schur, self.gram.total_w, candidate.columns)
        if not cov.any():
            return False
        error = np.sqrt(np.maximum(np.diag(cov), 0.0)) / self.library.scale[candidate.columns]
        for j in range(len(error)):
            unit = np.zeros(len(error))
            unit[j] = 3.0 * error[j]
            if error[j] > 0 and not self._large(0.34 * self._contribution(candidate, unit)):
                return True
        return False


def _columns(chosen: Sequence[_Candidate]) -> Columns:
    return np.concatenate([c.columns for c in chosen]) if chosen else np.empty(0, np.int64)


def _inverse(schur: Array, total: Array, columns: Columns) -> Array:
    """Inverse of a candidate's Schur block; zero where the selected columns leave nothing of it."""
    block = schur[np.ix_(columns, columns)]
    own = np.diag(total)[columns]
    live = (own > 1e-9) & (np.diag(block) > 0.01 * own)
    out = np.zeros_like(block)
    if len(columns) == 1:
        return np.where(live, 1.0 / np.where(live, block, 1.0), 0.0)
    if live.any():
        out[np.ix_(live, live)] = np.linalg.pinv(block[np.ix_(live, live)], rcond=1e-6, hermitian=True)
    return out


def _place(chosen: Sequence[_Candidate], wanted: _Candidate) -> slice:
    """Where the coefficients of one of ``chosen`` stand in a joint fit."""
    start = 0
    for candidate in chosen:
        if candidate is wanted:
            break
        start += len(candidate.columns)
    return slice(start, start + len(wanted.columns))


def _same_kind(one: _Candidate, other: _Candidate) -> bool:
    """Whether two candidates are of one effect and differ only in what may vary continuously."""
    if one.effect is not other.effect or one.held != other.held:
        return False
    return all(
        a == b or (s.continuous and a not in s.kinds and b not in s.kinds)
        for s, a, b in zip(one.effect.shapes, one.shape, other.shape, strict=True)
    )


def _implausible(candidate: _Candidate, coefficients: Array) -> str | None:
    for c, value in zip(candidate.effect.coefficients, coefficients, strict=True):
        if not c.low <= value <= c.high:
            return f"right shape, but {c.name} = {value:.3g} {c.unit} is outside {c.low:g} to {c.high:g}"
    if candidate.effect.at_shape and not AT_SHAPE[0] <= float(coefficients[0]) / candidate.shape[0] <= AT_SHAPE[1]:
        return f"no {candidate.effect.coefficients[0].name} fits it: the curve is another one"
    return None


def trace(record: Record, effects: Sequence[Effect] | None = None, seed: int = 0) -> Trace:
    """Search one record."""
    return _Search(record, catalogue() if effects is None else effects, seed).run()

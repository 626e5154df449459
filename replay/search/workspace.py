"""One record under search: its noise, the scores of its candidates, and how large and how plausible they are."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from models.effects import Effect
from models.frames import AXES, GRAVITY, Array
from replay.residual.record import Record
from replay.search.free_curves import Channel, Leftover, free_search
from replay.search.gram import Gram, inverse
from replay.search.library import Candidate, Columns, Library, columns_of, out_of_range, place
from replay.search.noise import fit_noise
from replay.search.null import Chance, flips

MOST_EFFECTS = 6
SMALLEST = 0.01
"""Smallest effect worth a name: 99th percentile of its force over the weight (of its moment over weight x lever)."""
CARRIES = 0.25
"""An effect carries an axis where it is this strong beside its strongest axis, in units of the noise."""
BIAS_DOUBT = 0.3
"""Difference [m/s^2] from what velocity and attitude tell of the accelerometer's offset, along z."""
THRUST_TO_MASS = ("payload", "thrust_scale", "air_density")
CLASS_SHARE = 0.12
"""IMU and rotor speed see only the ratio of thrust to mass: members of that class within this share are aliases."""
ALIAS_BIC, ALIAS_OF_SCORE = 10.0, 0.03
"""Two explanations whose scores differ by less than this, or this share, are equally good."""
LAG_DOUBT_S = 0.035
"""A lag that exceeds what the clock correction moved by less may be of its making, or of uneven sampling."""
FORM_SHARE = 0.15
"""A leftover below this share of what the effects took out is their error of form, not a second riddle."""


@dataclass(frozen=True)
class Score:
    """A candidate and how much it would take off: twice the log likelihood, less a penalty for its coefficients."""

    candidate: Candidate
    value: float


class Workspace:
    """One record under search: its noise, its candidates, and the questions that every stage asks of them."""

    def __init__(self, record: Record, effects: Sequence[Effect], seed: int) -> None:
        self.record = record
        self.seed = seed
        self.library = Library(record, effects)
        self.y = np.nan_to_num(record.residual[:, list(record.axes)])
        self.lever = max(
            float(np.max([np.linalg.norm(f.position_m) for f in record.context.vehicle.fans])),
            record.context.vehicle.rotor_radius_m,
        )
        self.reasons: dict[str, tuple[str, float | None]] = {}
        self.best: Columns = np.empty(0, np.int64)
        self._searched: tuple[object, Leftover] | None = None
        told = record.kinematic_bias[record.valid]
        self.told = np.nanmean(told, axis=0) if np.isfinite(told).any() else np.full(3, np.nan)
        """The accelerometer's offset (3,) by velocity and attitude [m/s^2]; NaN where the log does not tell."""
        self.gram = self._noise_model()

    def learn_noise(self, chosen: Sequence[Candidate]) -> None:
        """The noise again, now that some of the residual has its name."""
        self.gram = self._noise_model(chosen)

    def take_in(self) -> None:
        """Bring the inner products up to the library, which has grown."""
        self.gram = Gram(self.record, self.library.x, self.y, self.gram.noise)

    def rest(self, gram: Gram, chosen: Columns) -> Array:
        """What the chosen columns leave of the residual, (n, axes)."""
        fit = self.library.x[:, :, chosen] @ gram.size(chosen) if len(chosen) else 0.0
        rest: Array = self.y - fit
        return rest

    def scores(self, gram: Gram, selected: Columns, taken: set[str]) -> list[Score]:
        """Best shape of every effect that is not taken, best effect first."""
        schur, _, parts = gram.project(selected)
        g = parts.sum(0)
        best: dict[str, Score] = {}
        plain: dict[str, Score] = {}
        for candidate in self.library.candidates:
            if candidate.effect.name in taken or self.ratio_again(candidate, taken):
                continue
            part = g[candidate.columns]
            gain = float(part @ inverse(schur, gram.total_w, candidate.columns) @ part)
            value = gain - len(candidate.columns) * np.log(gram.effective)
            name = candidate.effect.name
            if name not in plain or value > plain[name].value:
                plain[name] = Score(candidate, value)
            if (name not in best or value > best[name].value) and self.plausible(gram, selected, candidate):
                best[name] = Score(candidate, value)
        return sorted((plain | best).values(), key=lambda s: -s.value)

    def plausible(self, gram: Gram, selected: Columns, candidate: Candidate) -> bool:
        """Whether a candidate's coefficients beside the selected columns are ones that it may have."""
        fit = gram.size(np.concatenate([selected, candidate.columns]))[len(selected) :]
        return self.implausible(candidate, fit / self.library.scale[candidate.columns]) is None

    def implausible(self, candidate: Candidate, coefficients: Array) -> str | None:
        """What speaks against these coefficients: their range, or for a vertical offset what velocity tells of it."""
        if candidate.effect.name == "imu_bias" and abs(float(coefficients[2] - self.told[2])) > BIAS_DOUBT:
            return f"velocity does not bear out an offset of {coefficients[2]:.2g} m/s^2 along z"
        return out_of_range(candidate, coefficients)

    def late(self, candidate: Candidate, coefficients: Array) -> str | None:
        """A lag hardly longer than what the clock correction moved may be of its making."""
        if candidate.effect.name != "motor_lag":
            return None
        moved = max((d.seconds for d in self.record.delays[:1] if d.corrected), default=0.0)
        if float(coefficients[0]) * candidate.shape[0] < moved + LAG_DOUBT_S:
            return f"not beyond the {moved:.2f} s by which the rotor speeds' clock was set right"
        return None

    def null(self, gram: Gram, selected: Columns, taken: set[str]) -> Chance:
        """Scores by chance, in what the best combination of effects leaves: what is there is no noise."""
        schur, _, parts = gram.project(selected, np.union1d(selected, self.best))
        live = [c for c in self.library.candidates if c.effect.name not in taken]
        inverses = [inverse(schur, gram.total_w, c.columns) for c in live]
        penalties = np.array([len(c.columns) * np.log(gram.effective) for c in live])
        names = [c.effect.name for c in live]
        return flips(parts, names, [c.columns for c in live], inverses, penalties, self.seed)

    def free(self, chosen: Sequence[Candidate]) -> Leftover:
        """What free curves find beside the chosen effects."""
        key = (self.gram, tuple(chosen))
        if self._searched is None or self._searched[0] != key:
            rest = self.rest(self.gram, columns_of(chosen))
            self._searched = (key, free_search(self.record, rest, self.gram.noise, self.seed))
        return self._searched[1]

    def riddle(self, chosen: Sequence[Candidate]) -> tuple[Channel, ...]:
        """Channels of what free curves find beside the chosen effects, less what is the error of form of these."""
        free = self.free(chosen)
        if not free.significant:
            return ()
        removed = float(self.gram.yy.sum() - self.gram.held_out(columns_of(chosen)).sum())
        if not chosen or free.gain >= FORM_SHARE * removed:
            return free.channels
        carried = {a for c, size in zip(chosen, self.sizes(chosen), strict=True) for a in self.carries(c, size)}
        return tuple(channel for channel in free.channels if channel.axis not in carried)

    @staticmethod
    def from_start(candidate: Candidate) -> bool:
        """False for a load that is picked up in flight."""
        return candidate.effect.name != "payload" or candidate.shape[0] == 0.0

    def ratio_again(self, candidate: Candidate, taken: set[str]) -> bool:
        """Whether the ratio of thrust to mass, which one effect sets, has its name already."""
        ratio = candidate.effect.name in THRUST_TO_MASS and self.from_start(candidate)
        return ratio and bool((taken - {candidate.effect.name}) & set(THRUST_TO_MASS))

    def beside(self, candidate: Candidate, coefficients: Array, chosen: list[Candidate]) -> Array:
        """The part of a contribution (n, axes) that the chosen effects cannot take over."""
        out = self.contribution(candidate, coefficients)
        if not chosen:
            return out
        columns, r = columns_of(chosen), self.gram.total_r
        own = r[np.ix_(columns, candidate.columns)] @ (coefficients * self.library.scale[candidate.columns])
        block = r[np.ix_(columns, columns)]
        taken = np.linalg.lstsq(block + 1e-9 * np.trace(block) / len(columns) * np.eye(len(columns)), own)[0]
        beside: Array = out - self.library.x[:, :, columns] @ taken
        return beside

    def sizes(self, chosen: Sequence[Candidate]) -> list[Array]:
        """Coefficients of every chosen candidate, fitted together."""
        fit = self.gram.size(columns_of(chosen))
        return [fit[place(chosen, c)] / self.library.scale[c.columns] for c in chosen]

    def costs(self, chosen: Sequence[Candidate]) -> list[float]:
        """Held-out energy, in units of the noise, that comes back without each of the chosen."""
        full = self.gram.held_out(columns_of(chosen)).sum()
        return [float(self.gram.held_out(columns_of([o for o in chosen if o is not c])).sum() - full) for c in chosen]

    def size_beside(self, candidate: Candidate, chosen: list[Candidate]) -> Array:
        """Coefficients of a candidate fitted together with the chosen ones."""
        fit = self.gram.size(columns_of([*chosen, candidate]))[-len(candidate.columns) :]
        return np.asarray(fit / self.library.scale[candidate.columns])

    def kinematics(self, candidate: Candidate, coefficients: Array) -> str | None:
        """Velocity and attitude tell an accelerometer offset from a force."""
        if candidate.effect.name not in ("imu_bias", "wind"):
            return None
        seen = self.told
        if candidate.effect.name == "imu_bias":
            size = float(np.linalg.norm(coefficients))
            if float(seen @ coefficients) / size < 0.4 * size:
                return "velocity and attitude agree with the accelerometer: it has no such offset"
            return None
        mass = self.record.context.vehicle.mass_kg
        push = self.contribution(candidate, coefficients)[self.record.valid][:, :2].mean(axis=0) / mass
        size = float(np.linalg.norm(push))
        if size > 0.02 and float(seen[:2] @ push) / size > 0.6 * size:
            return "velocity and attitude disagree with the accelerometer by as much: its offset, not wind"
        return None

    def core(self, candidate: Candidate, coefficients: Array) -> Array:
        """The contribution (n, axes) of the coefficients that make the effect what it is."""
        effect = candidate.effect
        pairs = zip(effect.coefficients, coefficients, strict=True)
        core = np.array([value if not effect.main or c.name in effect.main else 0.0 for c, value in pairs])
        return self.contribution(candidate, core)

    def core_large(self, candidate: Candidate, coefficients: Array) -> bool:
        """Whether the coefficients that make the effect what it is matter by themselves."""
        return not candidate.effect.main or self.large(self.core(candidate, coefficients))

    def core_share(self, candidate: Candidate, coefficients: Array) -> float:
        """RMS of what makes the effect what it is over that of the whole, on the axis where that is most."""
        valid, noise = self.record.valid, self.gram.noise.total
        core = np.sqrt((self.core(candidate, coefficients)[valid] ** 2).mean(axis=0)) / noise
        whole = np.sqrt((self.contribution(candidate, coefficients)[valid] ** 2).mean(axis=0)) / noise
        carried = core > CARRIES * core.max()
        return float((core[carried] / np.maximum(whole[carried], 1e-12)).max()) if carried.any() else 0.0

    def contribution(self, candidate: Candidate, coefficients: Array) -> Array:
        """The wrench (n, axes) of a candidate with these coefficients."""
        x = self.library.x[:, :, candidate.columns] * self.library.scale[candidate.columns]
        out: Array = x @ coefficients
        return out

    def large(self, contribution: Array) -> bool:
        """Whether a wrench (n, axes) is worth a name on any axis."""
        top = np.percentile(np.abs(contribution[self.record.valid]), 99, axis=0)
        return bool((top >= self.worth_a_name).any())

    @property
    def worth_a_name(self) -> Array:
        """The smallest force and torque (axes,) that count: a share of the weight, and that at the rotors' lever."""
        weight = self.record.context.vehicle.mass_kg * GRAVITY
        return np.array([SMALLEST * weight * (1.0 if a < 3 else self.lever) for a in self.record.axes])

    def energy_on_axes_of(self, contribution: Array, rest: Array) -> float:
        """Energy of ``rest`` (n, axes), in units of the noise, on the axes that carry a contribution."""
        valid, noise = self.record.valid, self.gram.noise.total**2
        size = (contribution[valid] ** 2).sum(0) / noise
        return float(((rest[valid] ** 2).sum(0) / noise)[size > 0.1 * size.max()].sum())

    def strength(self, candidate: Candidate, size: Array) -> Array:
        """RMS of a contribution on every axis (axes,), in units of its noise."""
        own = self.contribution(candidate, size)[self.record.valid]
        return np.asarray(np.sqrt((own**2).mean(axis=0)) / self.gram.noise.total)

    def carries(self, candidate: Candidate, size: Array) -> tuple[str, ...]:
        """Axes that a contribution carries."""
        strength = self.strength(candidate, size)
        return tuple(AXES[a] for a, s in zip(self.record.axes, strength, strict=True) if s > CARRIES * strength.max())

    def held_out(self, columns: Columns) -> Array:
        """Residual (n, axes) with every run of time predicted by a fit that never saw it."""
        after = self.y.copy()
        if len(columns):
            for f, fit in enumerate(self.gram.fold_coefficients(columns)):
                rows = self.gram.folds[self.gram.coarse] == f
                after[rows] -= self.library.x[rows][:, :, columns] @ fit
        return after

    def _noise_model(self, given: Sequence[Candidate] = ()) -> Gram:
        """Noise from what no combination of effects explains, so that a missing effect does not pass for noise."""
        x, y, valid, step = self.library.x, self.y, self.record.valid, self.record.step_s
        fast = fit_noise(np.diff(y, axis=0, prepend=y[:1]), valid, step)
        noise = replace(fast, ar=np.zeros_like(fast.ar), innovation=fast.total, total=fast.total)
        gram = Gram(self.record, x, y, noise)
        per_sample = 15.0
        if given:
            noise = self.gram.noise
            gram = self.gram
        for penalty in (3.0,) if given else (3.0 * per_sample, 3.0, 3.0):
            chosen = self._greedy(gram, penalty * np.log(gram.effective), given)
            noise = fit_noise(self.rest(gram, chosen), valid, step)
            gram = Gram(self.record, x, y, noise)
            self.best = chosen
        return gram

    def _greedy(self, gram: Gram, penalty: float, given: Sequence[Candidate]) -> Columns:
        chosen: list[Candidate] = list(given)
        for _ in range(MOST_EFFECTS):
            columns = columns_of(chosen)
            scores = self.scores(gram, columns, {c.effect.name for c in chosen})
            if not scores or scores[0].value < penalty:
                break
            chosen.append(scores[0].candidate)
        return columns_of(chosen)

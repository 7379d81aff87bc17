"""Whitened directions at the end of a fit: what was fitted, what an effect would change, what the fit leaves of it."""

from collections.abc import Callable, Sequence
from functools import cached_property, partial

import torch
from torch import Tensor
from torch.nn.functional import pad

from solver.criticism.policy import POLICY
from solver.criticism.record_parts import RecordPart, linearized, reach_of
from solver.criticism.score import Projected, Score
from solver.criticism.slow_errors import slow_precision
from solver.criticism.sums import Sums, factor_of, load_cost, sharpness
from solver.effect import Effect, Heard
from solver.fit.chain import Chain
from solver.fit.map_fit import MapFit
from solver.fit.prior import Rows, anchor_rows
from solver.fit.state import Linearized, State
from solver.fit.windowed import Windowed, taken
from solver.signal_path.derivatives import acts_on_rows, derivatives
from solver.signal_path.extension import Extension
from solver.signal_path.local import Local, Section, Seen
from solver.signal_path.traffic import columns
from solver.survey.memory import give_back
from solver.trajectory.trajectory_effects import SLOW_ERROR

#: Bytes of what candidates share that are kept, about, and of a long record.
SHARED, SHARED_LONG = 2e8, 5e7
#: What candidates must have in common to share: shape of the gauges' points, a ratio that is the same at all of them,
#: moments per sample, and samples of a part of the record.
Key = tuple[torch.Size, bool, int, tuple[int, int] | None]


class Directions:
    """Whitened directions at the end of one fit.

    Slow errors of the tracks, as large as the tracks themselves say, are free beside all that was fitted. They are no
    fault of the model, and an effect that changes from vehicle to vehicle would otherwise absorb them.

    Parameters
    ----------
    fit : the fit
    state : where it converged
    alone : hold all that was fitted, wherever the state is
    variance : that the noise counts as in directions that effects may take, where it is known from another fit
    """

    def __init__(self, fit: MapFit, state: State, alone: bool = False, variance: float | None = None):
        self.fit, self.state, self.alone = fit, state, alone
        #: The problem there, but for derivatives; parts of the record, one after the other, and last the whole of it,
        #: for what cannot be told part by part.
        at, self.parts = linearized(fit, state)
        self.at: Linearized = at.bare
        matrix, right = Chain.single(fit).dense(state, [at])
        self.fitted = len(matrix)
        self._local: dict[Key, Local] = {}
        self._seen: Seen | None = None
        self._slow: list[int] | None = None
        factor = factor_of(matrix)
        #: How sharply the fit ends, with what its loads take of the prior density.
        self.sharpness = sharpness(factor) + load_cost(state.vehicles.amplitude)
        #: Largest component of the residual along what was fitted, sigmas: far below 1 where the fit converged.
        self.stress = float(torch.linalg.solve_triangular(factor, right[:, None], upper=False).abs().max())
        #: Whitened residual [sample * channel + anchor], those of the anchors below those of the record.
        self.residual = torch.cat([self.at.residual, self._below(-self._anchors.residual[:, None])[:, 0]])
        #: What was fitted, and then the tracks' slow errors [sample * channel + anchor, column].
        self.jacobian = at.jacobian.above(self._below(self._anchors.jacobian[:, fit.free]))
        if not alone and not any(one.slow_error for one in fit.extension.effects):
            slow, counts = self.slow_errors()
            self.forget()
            both = [self.jacobian, slow]
            del at, self.jacobian
            self.jacobian = Windowed.beside(taken(both))
            matrix, right = self._with_slow_errors(matrix, right, slow)
            self._slow = counts
            del slow
        self.factor = factor_of(matrix)
        #: What the noise's variance counts as in directions that effects may take: the base model is not exact.
        self.variance = self._inexact() if variance is None else variance
        self.step = torch.cholesky_solve(right[:, None], self.factor)[:, 0]

    def _inexact(self) -> float:
        signal = self._white(self.at.model)
        return 1 + POLICY.inexact**2 * float(signal.square().sum())

    def slow_errors(self) -> tuple[Windowed, list[int]]:
        """Directions of the tracks' slow errors, as `columns` gives them."""
        extension = self.fit.problem.extension([*self.fit.extension.effects, SLOW_ERROR])
        return self.columns(SLOW_ERROR, {}, extension)

    def _with_slow_errors(self, matrix: Tensor, right: Tensor, columns: Windowed) -> tuple[Tensor, Tensor]:
        """Normal equations with the tracks' slow errors, as large as the tracks say, beside what was fitted."""
        crossed, own = self.jacobian.transposed_times(columns).split([self.fitted, columns.width])
        own = own + slow_precision(self.fit)
        whole = torch.cat([torch.cat([matrix, crossed], 1), torch.cat([crossed.T, own], 1)])
        return whole, torch.cat([right, columns.along(self.residual)])

    @cached_property
    def tracks(self) -> tuple[int, ...]:
        """How many numbers each track has of what is smooth along tracks."""
        scopes = self.fit.problem.extension([SLOW_ERROR]).scopes
        assert scopes is not None
        return scopes.tracks

    @property
    def _slow_columns(self) -> Windowed:
        return self.jacobian.taking(torch.arange(self.jacobian.width) >= self.fitted)

    @cached_property
    def slow_left(self) -> Projected | None:
        """What all that was fitted leaves of the tracks' slow errors; None where these are fitted, or all is held."""
        if self._slow is None:
            return None
        columns, count = self._slow_columns, self.fitted
        own, right = self.factor[:count, :count], (self.factor @ (self.factor.T @ self.step))[:count]
        crossed = self.jacobian.transposed_times(columns)[:count]
        step = torch.cholesky_solve(right[:, None], own)[:, 0]
        return Projected.beyond(Sums(columns.along(self.residual), columns.gram, crossed), own, step)

    @cached_property
    def _anchors(self) -> Rows:
        """The anchors' rows, with derivatives by every parameter of the fit."""
        fit, state = self.fit, self.state
        place, by_number, other = fit.prior.led(state, fit.prior.anchor_distance)
        rows = anchor_rows(fit.basis, fit.prior.anchors, place, by_number, state.coefficients)
        jacobian = torch.zeros(len(rows.residual), fit.layout.size, dtype=torch.float64)
        route = fit.layout["route"].stop
        jacobian[:, :route], jacobian[:, other] = rows.jacobian[:, :route], rows.jacobian[:, route:]
        return Rows(rows.residual, jacobian)

    def _below(self, rows: Tensor) -> Tensor:
        """Rows of the anchors [anchor, column], filled up with zeros to whole samples of all channels."""
        return pad(rows, (0, 0, 0, -len(rows) % self.fit.data.shape[1]))

    def _anchor_columns(self, effect: Effect, numbers: Tensor, extension: Extension) -> Tensor:
        """Derivatives [anchor, number] of the anchors' rows by an effect's amplitudes, which may move channels."""
        slots = [s for s in extension.slots if s.effect is effect and not s.parameter.is_shape]
        own = [slot.where.stop - slot.where.start for slot in slots]
        if not any(slot.effect is effect for slot in extension.moving):
            return self._below(torch.zeros(len(self._anchors.residual), sum(own), dtype=torch.float64))
        place, by_number = extension.moves(numbers, torch.from_numpy(self.fit.prior.anchor_distance))
        counts = [slot.where.stop - slot.where.start for slot in extension.moving]
        parts = zip(extension.moving, by_number.split(counts, 1), strict=True)
        found = {slot.parameter.name: part for slot, part in parts if slot.effect is effect}
        nothing = [torch.zeros(len(place), count, dtype=torch.float64) for count in own]
        by_amplitude = torch.cat([found.get(s.parameter.name, none) for s, none in zip(slots, nothing, strict=True)], 1)
        rows = anchor_rows(self.fit.basis, self.fit.prior.anchors, place, by_amplitude, self.state.coefficients)
        return self._below(rows.jacobian[:, self.fit.layout["route"].stop :])

    def seen(self, extension: Extension, section: Section | None = None) -> Seen:
        """The model with a candidate at its null, at a section; what candidates share is computed once."""
        seen = self._seen
        if seen is not None and seen.path.extension is extension and seen.local.section is section:
            return seen
        path, self._seen = self.fit.path.with_effects(extension), None
        gauges = partial(self.fit.gauges_at, path, self.state.coefficients)
        values = extension.local(self.numbers(extension, {}))
        here = gauges(path.described(values))
        at = None if section is None else (section.samples.start, section.samples.stop)
        key = here.points.shape, here.change is None, path.traffic.over, at
        if key not in self._local:
            most = SHARED if len(self.parts) == 1 else SHARED_LONG
            while self._local and sum(local.bytes for local in self._local.values()) > most:
                del self._local[next(iter(self._local))]
                give_back()
            vehicles = self.state.vehicles.rows(path.traffic)
            self._local[key] = Local(path, gauges, vehicles, self.state.poisson_ratio, values, section)
        self._seen = Seen(path, gauges, self._local[key])
        return self._seen

    def forget(self) -> None:
        """Let go of what candidates share, hundreds of MB; it is computed again where one is looked at once more."""
        self._seen, self._local = None, {}
        if len(self.parts) > 1:
            give_back()

    def numbers(self, extension: Extension, shape: dict[str, float]) -> Tensor:
        """All effects' numbers: those of the fit, then the candidate's null and shape."""
        candidate = extension.effects[-1]
        numbers = extension.numbers({candidate.name: shape})
        numbers[: len(self.state.numbers)] = self.state.numbers
        return numbers

    def columns(
        self,
        effect: Effect,
        shape: dict[str, float],
        extension: Extension,
        part: RecordPart | None = None,
        like: Callable[[Seen], Seen] = lambda seen: seen,
    ) -> tuple[Windowed, list[int]]:
        """Whitened derivatives [sample * channel + anchor, number] by an effect's amplitudes, how many each has.

        Parameters
        ----------
        part : of the record, of `parts`: what cannot be told part by part, and the anchors' rows, are the last one's;
            all of them where None
        like : makes of the model as `seen` has it that which is differentiated
        """
        last, rows = part is None or part is self.parts[-1], self.fit.data.numel()
        numbers = self.numbers(extension, shape)
        slots = [s for s in extension.slots if s.effect is effect and not s.parameter.is_shape]
        counts = [slot.where.stop - slot.where.start for slot in slots]
        none = Windowed((), len(self.residual), sum(counts))
        if effect == SLOW_ERROR and self._slow is not None:
            return (self._slow_columns if last else none), counts
        told = self.told(extension, numbers)
        channels, pieces = self.fit.data.shape[1], list[tuple[int, Windowed]]()
        for one in (one for one in told if part in (None, one)):
            seen = like(self.seen(extension, one.section))
            maps = (some for slot in slots for some in derivatives(seen, slot, numbers))
            pieces.append((one.first * channels, Windowed.through_each(maps, one.white, self.fit.whiten.memory)))
        if not last:
            return Windowed.stacked(pieces, none.rows, none.width), counts
        whole = Windowed.stacked(pieces, rows, none.width)
        return whole.above(self._anchor_columns(effect, numbers, extension)), counts

    def told(self, extension: Extension, numbers: Tensor) -> list[RecordPart]:
        """Parts of the record by which a model's derivatives are told."""
        reach = reach_of(self.fit.path.with_effects(extension), extension.local(numbers))
        return [one for one in self.parts if one.reach == reach] or self.parts[-1:]

    @cached_property
    def _white(self) -> Callable[[Tensor], Tensor]:
        """Whitens and weighs maps [column, sample, channel]."""
        return self.fit.whiten.weighing(self.at.weights.good, self.at.weights.soft.sqrt())

    def change(self, extension: Extension, base: Tensor, numbers: Tensor) -> Windowed:
        """Change of the whitened record and of the anchors' rows from the numbers `base` to others."""
        told = torch.from_numpy(self.fit.prior.anchor_distance)
        none = torch.zeros(len(told), 0, dtype=torch.float64)
        basis, anchors, route = self.fit.basis, self.fit.prior.anchors, self.state.coefficients
        places = (extension.places(at, told) for at in (base, numbers))
        before, after = (anchor_rows(basis, anchors, place, none, route) for place in places)
        moved = self.model(extension, numbers) - self.at.model
        white = Windowed.through(moved[None], self._white, self.fit.whiten.memory)
        return white.above(self._below((after.residual - before.residual)[:, None]))

    def model(self, extension: Extension, numbers: Tensor) -> Tensor:
        """Map [sample, channel] with a candidate at some numbers."""
        seen, values = self.seen(extension), extension.local(numbers)
        slot = extension.slots[-1]
        if acts_on_rows(seen, slot, values):
            state = self.state
            fiber = self.fit.fiber_at(seen.path, state.coefficients, seen.path.described(values))
            return seen.path.strain_rate(fiber, state.vehicles, state.poisson_ratio, values)
        return seen.path.observed(seen.local.alone, values)

    def heard(self, extension: Extension) -> Heard:
        """What the fit leaves, for effects that seek their shapes in it."""
        path, values = self.fit.path.with_effects(extension), extension.local(self.numbers(extension, {}))
        load = path.loads(columns(self.state.vehicles.rows(path.traffic)), values)
        fiber = self.fit.fiber(self.state, self.fit.values(self.state))
        residual = self.at.residual.reshape(self.fit.data.shape)
        middle, slope = (fiber.ahead + fiber.behind) / 2, fiber.ahead - fiber.behind
        if (chosen := self.fit.extension.chosen) is not None:
            middle, slope = middle[chosen], slope[chosen]
        return Heard(residual, load, path.traffic.record_sample, middle, slope)

    def project(self, columns: Sequence[Windowed]) -> list[Projected]:
        """What the fit leaves of directions, as `columns` gives them; several shapes at once are faster."""
        return [self.left(one) for one in self.summed(columns)]

    def summed(self, columns: Sequence[Windowed]) -> list[Sums]:
        """Products of directions with one another, with the residual and with all that was fitted."""
        own = [(one.along(self.residual), one.gram) for one in columns]
        if self.alone or not columns:
            return [Sums(score, gram, gram[:0]) for score, gram in own]
        crossed = self.jacobian.transposed_times(Windowed.beside(columns)).split([one.width for one in columns], 1)
        return [Sums(score, gram, cross) for (score, gram), cross in zip(own, crossed, strict=True)]

    def left(self, sums: Sums) -> Projected:
        """What the fit leaves of directions."""
        if self.alone:
            return Projected(sums.score, sums.gram, sums.gram)
        return Projected.beyond(sums, self.factor, self.step)

    def whitened(self, maps: Tensor) -> Windowed:
        """Whitened changes [sample * channel + anchor, number] of the record by maps [number, sample, channel], 1/s."""
        white = Windowed.through(maps, self._white, self.fit.whiten.memory)
        return white.above(self._below(torch.zeros(len(self._anchors.residual), len(maps), dtype=torch.float64)))

    def following(self, score: Score) -> Tensor:
        """How all that was fitted [free] moves with a score's estimate."""
        if self.alone:
            return torch.zeros(self.fitted, dtype=torch.float64)
        signal = score.signal
        return self._led(score.crossed[:, None] if signal is None else self.jacobian.transposed_times(signal))[:, 0]

    def changed(self, score: Score) -> Tensor:
        """What a score's estimate changes [sample, channel], whitened, with all that was fitted following."""
        assert score.signal is not None
        change = score.signal.times(torch.ones(1, dtype=torch.float64))
        if not self.alone:
            crossed = self.jacobian.transposed_times(score.signal)
            change = change - self.jacobian.times(torch.cholesky_solve(crossed, self.factor)[:, 0])
        return change[: self.fit.data.numel()].reshape(self.fit.data.shape)

    def led(self, directions: Windowed, ways: Tensor) -> Tensor:
        """How all that was fitted [free, way] moves with directions [.., number] in proportions [number, way]."""
        return self._led(self.jacobian.transposed_times(directions) @ ways)

    def _led(self, crossed: Tensor) -> Tensor:
        return -torch.cholesky_solve(crossed, self.factor)[: self.fitted]

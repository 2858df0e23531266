"""Differences between groups of trials: which instrument, which surroundings, or which property of the ship.

First the instruments, by what the columns of each run say of each other without any model; what differs there gets a
value of its own in each group. Then forward selection: every effect, instrument and coefficient is tested for different
values in the groups, the best is refitted with them, and the rest is tested again.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from cases.evidence.kinematic_words import Quantity
from cases.evidence.kinematics import Kinematics
from cases.io.groups import Groups
from cases.trial import Trial
from diagnosis.estimation.candidates import FITTED_ALONG, LOCAL, Candidate, Column, parameters
from diagnosis.estimation.gridded_trials import GriddedTrials
from diagnosis.estimation.map_estimate import Estimate
from diagnosis.estimation.parameters import PRIOR_WIDTH, get_values
from diagnosis.estimation.transition_model import TransitionModel
from diagnosis.hypotheses.forward_selection import LEVEL, SAME_CLASS
from diagnosis.hypotheses.group_causes import NO_ROW, Tested, is_cause, physical, without_idle
from diagnosis.hypotheses.group_findings import Between, GroupDifference
from diagnosis.hypotheses.group_rows import group_row, parameters_by_group
from diagnosis.hypotheses.heterogeneity import (
    RunSlopes,
    candidate_test,
    imitated,
    run_slopes,
    surroundings_scatter,
    with_scatter,
)
from diagnosis.hypotheses.measured_differences import Measured, measured_differences, without_doubles
from diagnosis.hypotheses.refit import refit
from diagnosis.hypotheses.search_problem import SearchProblem
from diagnosis.report.between_words import sentence
from fitting.uncertainty.group_test import GroupTest, holm
from mmg.effects import EFFECTS
from mmg.errors import UserError
from mmg.messages import Message
from mmg.progress import LOGGER

SHARE = 0.1
"""Typical difference of a coefficient between groups, as a share of its value, if its prior is not narrower."""
WIDE = 3.0
"""Prior standard deviation of a difference in a refit, in typical sizes."""
MOST = 3
"""Differences that the dynamics name at the most."""
IMITATES = 0.9
"""Share of a difference that another parameter must imitate to be the same by another name."""
IDLE = 1.645
"""Standard errors from zero below which a difference is none beside one that was named after it."""
UNEXPLAINED = 0.25
"""Log Bayes factor of what is left without a name, as a share of that of the names, above which they are withdrawn."""
SCATTERED = 1.5
"""Typical sizes by which surroundings may differ from run to run for anything else to be told from them."""
AGREE = 3.0
"""Standard errors by which dynamics and kinematics may disagree on an instrument."""


def compare_groups(
    problem: SearchProblem, null: Estimate, sensors: Kinematics, groups: Groups, trials: Sequence[Trial]
) -> Between:
    """What differs between ``groups`` of ``trials``.

    problem: the trials on a grid with the priors of the ship; null: the fit without any effect, which all groups share;
    sensors: what the columns of each run say of each other. Returns the answer. Raises UserError for a group of which
    nothing can be used.
    """
    number = np.array(groups.number)
    unused = [name for i, name in enumerate(groups.names) if i not in number[problem.data.run]]
    if unused:
        raise UserError(f"--between {groups.by}: no trial of {unused[0]} has a piece without a gap that is long enough")
    measured = measured_differences(sensors, problem.steps.ship, groups)
    instruments = without_doubles([m for m in measured if m.matters])
    LOGGER.info(
        "testing every effect, instrument and coefficient for a difference between %d groups", len(groups.names)
    )
    search = _Search.of(problem, groups, trials, measured)
    differences, table, reasons = search.run(null, [m.fault for m in instruments if m.fault.exact])
    named = (*(m.row for m in instruments), *differences)
    verdict = "named" if named else "unknown" if reasons else "none"
    rows = sorted([*(m.row for m in measured), *(t.row for t in table)], key=lambda r: -r.log_bayes)
    members = {name: tuple(t.name for t in own) for name, own in groups.members(trials).items()}
    notes = (*reasons, *_limits(groups))
    words = sentence(groups.by, verdict, named, reasons)
    return Between(groups.by, members, verdict, words, named, tuple(rows), bool(reasons), notes)


def _limits(groups: Groups) -> list[Message]:
    """What cannot be concluded from these groups."""
    alone = [name for i, name in enumerate(groups.names) if groups.number.count(i) == 1]
    words = f"one run only in {', '.join(alone)}: what differs there may be a matter of that run alone"
    return [Message(words, "one_run_groups")] if alone else []


def group_candidates(problem: SearchProblem) -> tuple[Candidate, ...]:
    """What may differ between groups: all effects, the free coefficients, and what the instruments have beside.

    problem: with the effects and the priors of the coefficients. Returns candidates, the same in all runs.
    """
    ship, base = problem.steps.ship, problem.base
    rows = [c for c in problem.candidates if not c.by_run]
    known = {s for c in rows for s in c.symbols}
    more = {}
    for s, *sizes in zip(base.symbols, base.mean, base.std, base.lower, base.upper, strict=True):
        mean, std, lower, upper = sizes
        more[s] = (mean, min(std, SHARE * abs(mean)) if mean and "." not in s else std, lower, upper)
    for name in (e for e in FITTED_ALONG if e in ship.effects):
        for x in (x for x in parameters(ship, name) if not x.choice):
            more.setdefault(f"{name}.{x.symbol}", (x.neutral, x.typical, x.lower, x.upper))
    for s, values in more.items():
        if s not in known:
            effect, _, form = s.partition(".")
            rows.append(Candidate(effect, form, False, (Column(s),), *(np.array([float(v)]) for v in values)))
    return tuple(rows)


@dataclass(frozen=True)
class _Search:
    """The forward selection. problem: whose data have the number of the group as that of the run; runs: (R,) run of
    each window; candidates; measured: what the kinematics say."""

    problem: SearchProblem
    runs: np.ndarray
    candidates: tuple[Candidate, ...]
    groups: Groups
    kinds: tuple[frozenset[str], ...]
    measured: Sequence[Measured]

    @classmethod
    def of(
        cls, problem: SearchProblem, groups: Groups, trials: Sequence[Trial], measured: Sequence[Measured]
    ) -> _Search:
        """The search in a problem."""
        candidates = group_candidates(problem)
        symbols = dict.fromkeys([*problem.steps.symbols, *(s for c in candidates for s in c.symbols)])
        steps = TransitionModel(problem.steps.ship, tuple(symbols), problem.data.h)
        data: GriddedTrials = replace(problem.data, run=np.array(groups.number)[problem.data.run])
        kinds = tuple(frozenset(t.kind for t in own) for own in groups.members(trials).values())
        return cls(replace(problem, steps=steps, data=data), problem.data.run, candidates, groups, kinds, measured)

    def run(
        self, fit: Estimate, faults: Sequence[Quantity]
    ) -> tuple[list[GroupDifference], list[Tested], list[Message]]:
        """Named differences, all tests before any was named, and why what is left has no name.

        fit: common to all groups; faults: of instruments, which get a value in each group first.
        """
        wanted = {f"{q.effect}.{q.parameter}" for q in faults}
        own = [self._by_group(c) for c in self.candidates if wanted & set(c.symbols)]
        fit = self._refitted(fit, own, {}) if own else fit
        common, first, spent = fit, tuple(own), list[Candidate]()
        named: list[Tested] = []
        table: list[Tested] = []
        while True:
            tests, slopes, scatter = self._tests(fit, [*own, *spent])
            table = table or tests
            clear = [t for t in tests if t.row.p_value < LEVEL and t.row.log_bayes > 0]
            if not clear:
                return [self._final(fit, t) for t in named], table, []
            best = physical(max(clear, key=lambda t: t.row.log_bayes), clear)
            same, reason = self._judged(best, tests, slopes)
            if too_scattered(scatter):
                words = "surroundings, such as a current, differ so much from run to run that nothing is told from them"
                reason = Message(words, "scattered_surroundings")
            if reason is None and len(named) == MOST:
                reason = Message(f"beside {MOST} differences the groups differ in {best.candidate.label}", "too_many")
            if reason is not None:
                if named and best.row.log_bayes > UNEXPLAINED * sum(t.row.log_bayes for t in named):
                    words = " and ".join(t.candidate.label for t in named)
                    words += " would explain a part, but much is left unexplained: the name is withdrawn"
                    return [], table, [Message(words, "name_withdrawn"), reason]
                return [self._final(fit, t) for t in named], table, [reason]
            c = self._by_group(best.candidate)
            own.append(c)
            named.append(replace(best, row=replace(best.row, equivalence_class=same)))
            fit = self._refitted(fit, own, dict(zip(c.columns, self._values(fit, best), strict=True)))
            LOGGER.info(f"the groups differ in {best.candidate.label}")
            if idle := [t for t in named if self._is_idle(fit, t)]:
                LOGGER.info(f"but not in {', '.join(t.candidate.label for t in idle)}")
                spent += [t.candidate for t in (*idle, named[-1])]
                named = without_idle(idle, named, [t for t in table if t.row.p_value < LEVEL and t.row.log_bayes > 0])
                own = [*first, *(self._by_group(t.candidate) for t in named)]
                fit = self._refitted(common, own, self._start(fit, common, named))

    def _by_group(self, c: Candidate) -> Candidate:
        """A candidate with values of its own in each group, for a refit: a coefficient keeps its prior, widened."""
        known = dict(zip(self.problem.base.symbols, self.problem.base.std, strict=True))
        std = [
            np.hypot(known[s], WIDE * t) if s in known else PRIOR_WIDTH * t
            for s, t in zip(c.symbols, c.typical, strict=True)
        ]
        return replace(c, typical=np.array(std) / PRIOR_WIDTH).in_each(range(len(self.groups.names)))

    def _refitted(self, fit: Estimate, own: Sequence[Candidate], start: Mapping[Column, float]) -> Estimate:
        """The fit again with these candidates by group, the known ones from where they were."""
        p = self.problem
        first = {x: fit.value(*x) for c in own for x in c.columns if x in fit.free.columns}
        return refit(p.steps, p.data, p.base, fit, own, {**first, **start})

    def _values(self, fit: Estimate, t: Tested) -> np.ndarray:
        """Values by group (G p,) that a test points to [unit of the parameter]."""
        p, c = self.problem, t.candidate
        now = get_values(p.steps.ship, p.data, fit.theta, c.columns)
        count = len(t.test.values) // len(now)
        return np.tile(now, count) + t.test.values * np.tile(c.typical, count)

    def _tests(self, fit: Estimate, own: Sequence[Candidate]) -> tuple[list[Tested], RunSlopes, dict[Column, float]]:
        """All candidates that have no values by group yet, tested about a fit, the slopes of each run, and the scatter
        of the surroundings between runs."""
        gone = {s for c in own for s in c.symbols}
        rest = [c for c in self.candidates if not gone & set(c.symbols)]
        local = [c for c in self.candidates if c.effect in LOCAL]
        slopes = run_slopes(
            self.problem.steps, self.problem.data, self.runs, fit, [*rest, *(c for c in local if c not in rest)]
        )
        scatter = surroundings_scatter(slopes, local)
        still = with_scatter(slopes, scatter)
        found = [
            (c, candidate_test(with_scatter(slopes, scatter, c.columns) if c in local else still, c)) for c in rest
        ]
        shown = [(c, t) for c, t in found if t is not None]
        adjusted = holm([t.p_single for _, t in shown])
        rows = [self._tested(fit, c, t, float(p)) for (c, t), p in zip(shown, adjusted, strict=True)]
        return rows, still, scatter

    def _tested(self, fit: Estimate, c: Candidate, test: GroupTest, p: float) -> Tested:
        """A test with its row of the result."""
        size = np.tile(c.typical, len(self.groups.names))
        values = self._values(fit, Tested(c, test, NO_ROW))
        parts = parameters_by_group(self.groups, self._words(c), values, test.covariance * np.outer(size, size))
        return Tested(c, test, group_row(c.effect, nature(c.effect), "dynamics", parts, test, p))

    def _words(self, c: Candidate) -> dict[str, tuple[str, str]]:
        """Unit and meaning of each parameter of a candidate."""
        rows = {s: self.problem.steps.ship.coefficients[s] for s in c.symbols}
        return {s.rpartition(".")[2]: (x.unit, x.description) for s, x in rows.items()}

    def _final(self, fit: Estimate, t: Tested) -> GroupDifference:
        """The row of a named difference with the values of the last fit, as they scatter between runs."""
        c, names = t.candidate, self.groups.names
        at = [fit.free.columns.index(Column(s, k)) for k in range(len(names)) for s in c.symbols]
        values = (fit.free.mean + fit.free.std * fit.p)[at]
        runs = np.array([len(set(self.runs[self.problem.data.run == k])) for k in range(len(names))])
        covariance = fit.covariance[np.ix_(at, at)] * np.outer(fit.free.std[at], fit.free.std[at])
        covariance += np.diag(np.kron(1.0 / runs, (t.test.scatter * c.typical) ** 2))
        return replace(t.row, parameters=parameters_by_group(self.groups, self._words(c), values, covariance))

    def _is_idle(self, fit: Estimate, t: Tested) -> bool:
        """Whether a named difference is none any more, in the fit with one that was named after it."""
        return all(
            abs(x.difference) < IDLE * x.difference_std
            for p in self._final(fit, t).parameters.values()
            for x in p.groups.values()
        )

    def _start(self, fit: Estimate, common: Estimate, named: Sequence[Tested]) -> dict[Column, float]:
        """Where a fit with differences that are ``named`` begins: in the ``fit`` with others, or where the tests about
        the ``common`` one point to."""
        start: dict[Column, float] = {}
        for t in named:
            c = self._by_group(t.candidate)
            known = all(x in fit.free.columns for x in c.columns)
            values = [fit.value(*x) for x in c.columns] if known else self._values(common, t)
            start |= dict(zip(c.columns, values, strict=True))
        return start

    def _judged(
        self, best: Tested, tests: Sequence[Tested], slopes: RunSlopes
    ) -> tuple[tuple[str, ...], Message | None]:
        """What says the same as the best difference by another name, and why it cannot be named, if so."""
        rivals = [t for t in tests if t is not best and t.row.log_bayes > best.row.log_bayes - 0.5 * SAME_CLASS]
        other = [t for t in rivals if imitated(slopes, best.candidate, t.candidate) < IMITATES]
        if is_cause(best):  # coefficients that say the same are what it changes
            other = [t for t in other if t.candidate.effect in EFFECTS]
        same = tuple(dict.fromkeys(t.row.name for t in rivals if t not in other))
        k, group = self.groups.names.index(best.row.group), best.row.group
        elsewhere = frozenset().union(*(kinds for i, kinds in enumerate(self.kinds) if i != k))
        if "" not in self.kinds[k] | elsewhere and not self.kinds[k] & elsewhere:
            words = f"{group} holds only {' and '.join(sorted(self.kinds[k]))} trials, of which no other group has any"
            words += ": what differs there may be an error of the model in such manoeuvres"
            return same, Message(f"{words} (strongest: {best.candidate.label})", "other_manoeuvres")
        if other:
            names = ", ".join(dict.fromkeys(t.candidate.label for t in (best, *other)))
            return same, Message(f"several parameters explain a difference equally well: {names}", "several_explain")
        for m in self.measured:
            if m.fault.exact and f"{m.fault.effect}.{m.fault.parameter}" in best.candidate.symbols:
                a, b = (r.parameters[m.fault.parameter].groups[group] for r in (m.row, best.row))
                if abs(a.difference - b.difference) > AGREE * np.hypot(a.difference_std, b.difference_std):
                    words = f"the kinematics of the trials do not show the difference in {best.candidate.label}"
                    return same, Message(f"{words} that the dynamics ask for", "sensors_disagree")
        return same, None


def too_scattered(scatter: Mapping[Column, float]) -> bool:
    """Whether surroundings differ too much from run to run, whichever of them it is.

    scatter: parameter -> standard deviation between the runs of a group [typical sizes]. Returns True only if each of
    the effects would have to, since one that differs lets the others seem to.
    """
    largest: dict[str, float] = {}
    for x, std in scatter.items():
        name = x.symbol.partition(".")[0]
        largest[name] = max(std, largest.get(name, 0.0))
    return bool(largest) and min(largest.values()) > SCATTERED


def nature(effect: str) -> str:
    """Whether an ``effect``, or a coefficient, is of an "instrument", of the "surroundings" or of the "ship"."""
    if effect not in EFFECTS:
        return "ship"
    e = EFFECTS[effect]
    return "instrument" if e.measures else "surroundings" if e.surroundings else "ship"

"""Differences between groups of trials: which instrument, which surroundings, or which property of the ship.

First the instruments, by what the columns of each run say of each other without any model; what differs there gets a
value of its own in each group. Then forward selection: every effect, instrument and coefficient is tested for different
values in the groups, the best is refitted with them, and the rest is tested again.

About a fit that is common to all runs, the log likelihood of each run is quadratic in values of its own. A parameter is
tested for different means in the groups while all others are the same in all runs, except surroundings, which scatter
from run to run. What the parameter itself scatters between the runs of a group is estimated (random effects,
DerSimonian & Laird 1986), so that a difference between groups must be larger than that between runs.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, Generic, TypeVar

import numpy as np

from cases.evidence.kinematics import ALIKE, TRACK, TURN, Kinematics, SensorFault
from cases.io.campaigns import Groups
from cases.shipfiles.effects import parameters
from cases.trial import Trial
from diagnosis.estimation.candidates import FITTED_ALONG, LOCAL, Candidate, Column
from diagnosis.estimation.gridded_trials import GriddedTrials
from diagnosis.estimation.linearisation import Point, linearise_and_filter, path_of_all_states
from diagnosis.estimation.map_estimate import Estimate
from diagnosis.estimation.parameters import PRIOR_WIDTH, Priors, get_values
from diagnosis.estimation.transition_model import TransitionModel
from diagnosis.findings import Between, GroupDifference, GroupParameter, group_row, parameters_by_group
from diagnosis.hypotheses.forward_selection import ODDS
from diagnosis.hypotheses.refit import SearchProblem, refit
from diagnosis.report.words import shown_unit
from fitting.prediction.bands import NORMAL
from fitting.report.sections import plus_minus
from fitting.uncertainty.group_test import (
    LEAST,
    GroupTest,
    by_group,
    contrasts,
    group_test,
    holm,
    members_of,
    scatter_between,
)
from mmg.effects import EFFECTS
from mmg.errors import TooFewData
from mmg.messages import LOGGER, Message
from mmg.motion.froude import time_scale
from mmg.ship import Ship

Of = TypeVar("Of", Candidate, SensorFault)
# Prior standard deviation of what an effect beside the fit may have in all runs alike, in typical sizes.
COMMON = 3.0  # set by hand


@dataclass(frozen=True)
class RunSlopes:
    """The log likelihood of each of n runs about a fit, g r - 1/2 r G r, for values r (C,) of its own.

    columns: C parameters in typical sizes, the free ones of the fit first; g: (n, C); G: (n, C, C); pull, precision:
    (C,) slope and precision of the priors of values that all runs share; group: (n,) number of each run's group.
    """

    columns: tuple[Column, ...]
    g: np.ndarray
    G: np.ndarray
    pull: np.ndarray
    precision: np.ndarray
    group: np.ndarray

    def at(self, c: Candidate) -> list[int]:
        """Positions of the parameters of a candidate ``c``."""
        return [self.columns.index(x) for x in c.columns]


def run_slopes(
    steps: TransitionModel, data: GriddedTrials, runs: np.ndarray, fit: Estimate, candidates: Sequence[Candidate]
) -> RunSlopes:
    """Linearise about a fit.

    steps: the transition model; data: the trials, whose ``run`` is the number of the group; runs: (R,) run of each
    window; fit: the fit; candidates: those to be tested. Returns the slopes of each run.
    """
    sizes = {x: size for c in candidates for x, size in zip(c.columns, c.typical, strict=True)}
    more = [x for x in sizes if x not in fit.free.columns]
    n, typical = len(more), np.array([sizes[x] for x in more])
    free = fit.free + Priors(tuple(more), np.zeros(n), typical, np.full(n, -np.inf), np.full(n, np.inf))
    p = np.concatenate([fit.p, np.zeros(n)])
    point = Point(fit.theta, free, p, path_of_all_states(steps, data, fit), fit.noise)
    here = linearise_and_filter(steps, data, point, np.arange(steps.S))
    grams = np.einsum("krca,krcb->rab", here.white, here.white, optimize=True)
    slopes = -(grams[:, :-1, -1] + here.logdet_gradient)
    names = np.unique(runs)
    # to typical sizes
    unit = np.array([sizes.get(x, std) / std for x, std in zip(free.columns, free.std, strict=True)])
    g = np.array([slopes[runs == r].sum(axis=0) for r in names]) * unit  # windows of a run together
    G = np.array([grams[runs == r, :-1, :-1].sum(axis=0) for r in names]) * np.outer(unit, unit)
    group = np.array([data.run[runs == r][0] for r in names])
    precision = np.concatenate([unit[: len(fit.p)] ** 2, np.full(n, COMMON**-2.0)])
    return RunSlopes(free.columns, g, G, -p * unit, precision, group)  # the prior pulls each p back to 0


def with_scatter(s: RunSlopes, scatter: Mapping[Column, float], but: Sequence[Column] = ()) -> RunSlopes:
    """The slopes ``s`` with some parameters free to differ from run to run.

    scatter: parameter -> standard deviation between runs [typical sizes]; but: those that stay. Returns slopes.
    """
    at = [i for i, x in enumerate(s.columns) if x in scatter and x not in but]
    if not at:
        return s
    precision = np.diag([scatter[s.columns[i]] ** -2.0 for i in at])
    part = np.linalg.solve(s.G[:, at][:, :, at] + precision, np.concatenate([s.G[:, at], s.g[:, at, None]], axis=2))
    back = s.G[:, :, at] @ part  # what the free values explain
    return replace(s, G=s.G - back[..., :-1], g=s.g - back[..., -1])


def surroundings_scatter(s: RunSlopes, candidates: Sequence[Candidate]) -> dict[Column, float]:
    """How the surroundings among ``candidates`` scatter between the runs of a group, by the slopes ``s``.

    Returns parameter -> standard deviation [typical sizes].
    """
    out: dict[Column, float] = {}
    for c in (c for c in candidates if c.effect in LOCAL):
        std = scatter_between(*own_values(s, s.at(c)), members_of(s.group, len(c.columns)), len(c.columns))
        out |= dict(zip(c.columns, std.tolist(), strict=True))
    return out


def own_values(s: RunSlopes, at: Sequence[int]) -> tuple[np.ndarray, np.ndarray]:
    """Slopes (n p,) and information (n p, n p) of values by run of the p parameters ``at`` these positions of the
    slopes ``s``, what runs share projected out."""
    n, p = len(s.g), len(at)
    rows = s.G[:, at].reshape(n * p, -1)
    total = s.G.sum(axis=0) + np.diag(s.precision)
    solved = np.linalg.solve(total, np.column_stack([rows.T, s.g.sum(axis=0) + s.pull]))
    S = -rows @ solved[:, :-1]  # through what runs share they speak of each other
    for r in range(n):
        k = slice(r * p, (r + 1) * p)
        S[k, k] += s.G[r][np.ix_(at, at)]  # a run speaks of its own values directly
    return s.g[:, at].ravel() - rows @ solved[:, -1], 0.5 * (S + S.T)


def imitated(s: RunSlopes, c: Candidate, other: Candidate) -> float:
    """How much of the difference that a candidate ``c`` shows another one imitates.

    s: slopes; other: the other one. Returns 1 where both say the same of these trials.
    """
    own = len(c.columns)
    at = [*s.at(c), *s.at(other)]
    g, S = own_values(s, at)
    members = members_of(s.group, len(at))
    score, J = contrasts(*by_group(g, S, members, np.full(len(at), LEAST)), len(at))
    first = np.tile(np.arange(len(at)) < own, len(J) // len(at))  # contrasts repeat the parameters, in their order
    J11, J12, J22 = J[np.ix_(first, first)], J[np.ix_(first, ~first)], J[np.ix_(~first, ~first)]
    size = np.linalg.lstsq(J11, score[first], rcond=1e-9)[0]
    whole = float(size @ J11 @ size)
    return float(size @ J12 @ np.linalg.pinv(J22, rcond=1e-9) @ J12.T @ size) / whole if whole > 0 else 0.0


# Typical difference of a coefficient between groups, as a share of its value, if its prior is not narrower.
SHARE = 0.1  # set by hand
WIDE = 3.0  # Prior standard deviation of a difference in a refit, in typical sizes. Set by hand.
MOST = 3  # Differences that the dynamics name at the most. Set by hand.
IMITATES = 0.9  # Share of a difference that another parameter must imitate to be the same by another name. Set by hand.
# Typical sizes by which surroundings may differ from run to run for anything else to be told from them.
SCATTERED = 1.5  # set by hand
ALIKE_BY = ODDS  # Log Bayes factors within this of each other are alike
# Largest probability by chance, corrected for the number of tests, of a difference that is named. Set by hand.
LEVEL = 0.03
SHOWN = 12  # Tests in the table of the report. Set by hand: display.


def compare_groups(
    problem: SearchProblem, null: Estimate, sensors: Kinematics, groups: Groups, trials: Sequence[Trial]
) -> Between:
    """What differs between ``groups`` of ``trials``.

    problem: the trials on a grid with the priors of the ship; null: the fit without any effect, which all groups share;
    sensors: what the columns of each run say of each other. Raises UserError for a group without usable trials.
    """
    number = np.array(groups.number)
    unused = [name for i, name in enumerate(groups.names) if i not in number[problem.data.run]]
    if unused:
        raise TooFewData(f"--between {groups.by}: no trial of {unused[0]} has a long enough piece without a gap")
    measured = measured_differences(sensors, problem.steps.ship, groups)
    instruments = without_doubles(measured)
    LOGGER.info("testing every effect, instrument and coefficient for differences of %d groups", len(groups.names))
    search = _Search.of(problem, groups, trials)
    differences, table, reasons = search.run(null, [m.of for m in instruments if m.of.exact])
    named = (*(m.row for m in instruments), *differences)
    verdict = "named" if named else "unknown" if reasons else "none"
    rows = sorted([*(m.row for m in measured), *(t.row for t in table)], key=lambda r: -r.log_bayes)
    members = {name: tuple(t.name for t in own) for name, own in groups.members(trials).items()}
    notes = list(reasons)
    if alone := [name for name, own in members.items() if len(own) == 1]:
        words = f"one run only in {', '.join(alone)}: what differs there may be a matter of that run alone"
        notes.append(Message(words, "one_run_groups"))
    words = sentence(groups.by, verdict, named, reasons)
    return Between(groups.by, members, verdict, words, named, tuple(rows), bool(reasons), tuple(notes))


@dataclass(frozen=True)
class Tested(Generic[Of]):
    """A test and its row of the result. of: a candidate of the dynamics, or a fault of an instrument by the kinematics,
    the test of which is in units of the least size that matters."""

    of: Of
    test: GroupTest
    row: GroupDifference


def measured_differences(sensors: Kinematics, ship: Ship, groups: Groups) -> list[Tested[SensorFault]]:
    """Tests of all faults of instruments for different sizes in the ``groups``, without any model.

    sensors: what each run shows; ship: whose length says which sizes matter. Returns those that can be tested.
    """
    k, tests = time_scale(float(ship.particulars["L"])), []
    for q in (*TRACK, *TURN):
        readings = [(run[q.symbol], i) for run, i in zip(sensors.runs, groups.number, strict=True) if not run.faults]
        readings = [(x, i) for x, i in readings if np.isfinite(x.value) and x.std > 0]
        if {i for _, i in readings} != set(groups.number):
            continue
        size = q.threshold * k ** (2 * q.power)
        values, std = (np.array([getattr(x, a) for x, _ in readings]) / size for a in ("value", "std"))
        test = group_test(values / std**2, np.diag(std**-2.0), np.array([i for _, i in readings]), 1)
        if test is not None:
            tests.append((q, test, size))
    adjusted = holm([test.p_single for _, test, _ in tests])
    rows = []
    for (q, test, size), p in zip(tests, adjusted, strict=True):
        of = "surroundings" if q.symbol.startswith("drift") else "instrument"
        words = {q.parameter or q.symbol: (q.unit, q.form.format(q.ends[0]))}
        parts = parameters_by_group(groups, words, size * test.values, size**2 * test.covariance)
        rows.append(Tested(q, test, group_row(q.effect or q.symbol, of, "kinematics", parts, test, float(p))))
    return rows


def without_doubles(measured: Sequence[Tested[SensorFault]]) -> list[Tested[SensorFault]]:
    """Of those ``measured`` that differ by what matters and look alike in a run, the one for which most speaks, with
    the others as its class."""
    differing = [m for m in measured if m.row.p_value < LEVEL and np.ptp(m.test.values) > 1.0]
    rest, kept = sorted(differing, key=lambda m: -m.row.log_bayes), []
    while rest:
        first, *rest = rest
        alike = set().union(*(group for group in ALIKE if first.of.symbol in group))
        same = tuple(dict.fromkeys(m.row.name for m in rest if m.of.symbol in alike))
        rest = [m for m in rest if m.of.symbol not in alike]
        kept.append(replace(first, row=replace(first.row, equivalence_class=same)))
    return kept


def group_candidates(problem: SearchProblem) -> tuple[Candidate, ...]:
    """What may differ between groups: all effects, the free coefficients, and what the instruments have beside.

    problem: with the effects and the priors of the coefficients. Returns candidates, the same in all runs.
    """
    ship, base = problem.steps.ship, problem.base
    rows = list(problem.candidates)
    known = {s for c in rows for s in c.symbols}
    ranges = {}
    for s, *sizes in zip(base.symbols, base.mean, base.std, base.lower, base.upper, strict=True):
        mean, std, lower, upper = sizes
        # effects may well be absent
        ranges[s] = (mean, min(std, SHARE * abs(mean)) if mean and "." not in s else std, lower, upper)
    for name in (e for e in FITTED_ALONG if e in ship.effects):
        for x in (x for x in parameters(ship, name) if not x.choice):
            ranges.setdefault(f"{name}.{x.symbol}", (x.neutral, x.typical, x.lower, x.upper))
    for s, values in ranges.items():
        if s not in known:
            effect, _, form = s.partition(".")
            rows.append(Candidate(effect, form, (Column(s),), *(np.array([float(v)]) for v in values)))
    return tuple(rows)


@dataclass(frozen=True)
class _Search:
    """The forward selection. problem: whose data have the number of the group as that of the run; runs: (R,) run of
    each window; candidates; kinds: of the trials of each group."""

    problem: SearchProblem
    runs: np.ndarray
    candidates: tuple[Candidate, ...]
    groups: Groups
    kinds: tuple[frozenset[str], ...]

    @classmethod
    def of(cls, problem: SearchProblem, groups: Groups, trials: Sequence[Trial]) -> _Search:
        """The search in a problem."""
        candidates = group_candidates(problem)
        symbols = dict.fromkeys([*problem.steps.symbols, *(s for c in candidates for s in c.symbols)])
        steps = TransitionModel(problem.steps.ship, tuple(symbols), problem.data.h)
        data: GriddedTrials = replace(problem.data, run=np.array(groups.number)[problem.data.run])
        kinds = tuple(frozenset(t.kind for t in own) for own in groups.members(trials).values())
        return cls(replace(problem, steps=steps, data=data), problem.data.run, candidates, groups, kinds)

    def run(
        self, fit: Estimate, faults: Sequence[SensorFault]
    ) -> tuple[list[GroupDifference], list[Tested[Candidate]], list[Message]]:
        """Named differences, all tests before any was named, and why what is left has no name.

        fit: common to all groups; faults: of instruments, which get a value in each group first.
        """
        wanted = {f"{q.effect}.{q.parameter}" for q in faults}
        first = [c for c in self.candidates if wanted & set(c.symbols)]
        fit = self._refitted(fit, first, []) if first else fit
        named, table = list[Tested[Candidate]](), list[Tested[Candidate]]()
        while True:
            tests, slopes, scatter = self._tests(fit, [*first, *(t.of for t in named)])
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
                reason = Message(f"beside {MOST} differences the groups differ in {best.of.label}", "too_many")
            if reason is not None:
                return [self._final(fit, t) for t in named], table, [reason]
            named.append(replace(best, row=replace(best.row, equivalence_class=same)))
            fit = self._refitted(fit, first, named)
            LOGGER.info(f"the groups differ in {best.of.label}")

    def _by_group(self, c: Candidate) -> Candidate:
        """A candidate with values of its own in each group, for a refit: a coefficient keeps its prior, widened."""
        known = dict(zip(self.problem.base.symbols, self.problem.base.std, strict=True))
        std = [
            np.hypot(known[s], WIDE * t) if s in known else PRIOR_WIDTH * t
            for s, t in zip(c.symbols, c.typical, strict=True)
        ]
        return replace(c, typical=np.array(std) / PRIOR_WIDTH).in_each(range(len(self.groups.names)))

    def _refitted(self, fit: Estimate, first: Sequence[Candidate], named: Sequence[Tested[Candidate]]) -> Estimate:
        """The fit again with candidates by group: those of instruments, ``first``, and those ``named``. Known values
        begin where they are, new ones where the test points to."""
        start = dict[Column, float]()
        own = [self._by_group(c) for c in (*first, *(t.of for t in named))]
        for c, t in zip(own, (*(None for _ in first), *named), strict=True):
            if c.columns[0] in fit.free.columns:
                start |= {x: fit.value(*x) for x in c.columns}
            elif t is not None:
                start |= dict(zip(c.columns, self._values(fit, t.of, t.test), strict=True))
        return refit(self.problem, fit, own, start)

    def _values(self, fit: Estimate, c: Candidate, test: GroupTest) -> np.ndarray:
        """Values by group (G p,) of a candidate that a test points to [unit of the parameter]."""
        now, G = get_values(self.problem.steps.ship, self.problem.data, fit.theta, c.columns), len(self.groups.names)
        return np.tile(now, G) + test.values * np.tile(c.typical, G)

    def _tests(
        self, fit: Estimate, own: Sequence[Candidate]
    ) -> tuple[list[Tested[Candidate]], RunSlopes, dict[Column, float]]:
        """Tests about a fit of all candidates without values by group, slopes by run, scatter of the surroundings."""
        gone = {s for c in own for s in c.symbols}
        rest = [c for c in self.candidates if not gone & set(c.symbols)]
        local = [c for c in self.candidates if c.effect in LOCAL]
        every = [*rest, *(c for c in local if c not in rest)]
        slopes = run_slopes(self.problem.steps, self.problem.data, self.runs, fit, every)
        scatter = surroundings_scatter(slopes, local)
        still = with_scatter(slopes, scatter)
        shown = []
        for c in rest:
            free = with_scatter(slopes, scatter, c.columns) if c in local else still
            if (test := group_test(*own_values(free, free.at(c)), free.group, len(c.columns))) is not None:
                shown.append((c, test))
        tests = []
        for (c, test), p in zip(shown, holm([test.p_single for _, test in shown]), strict=True):
            size = np.tile(c.typical, len(self.groups.names))
            parts = self._parts(c, self._values(fit, c, test), test.covariance * np.outer(size, size))
            tests.append(Tested(c, test, group_row(c.effect, nature(c.effect), "dynamics", parts, test, float(p))))
        return tests, still, scatter

    def _parts(self, c: Candidate, values: np.ndarray, covariance: np.ndarray) -> dict[str, GroupParameter]:
        """The parameters of a candidate with their values by group (G p,) and the covariance of these (G p, G p)."""
        rows = {s: self.problem.steps.ship.coefficients[s] for s in c.symbols}
        words = {s.rpartition(".")[2]: (x.unit, x.description) for s, x in rows.items()}
        return parameters_by_group(self.groups, words, values, covariance)

    def _final(self, fit: Estimate, t: Tested[Candidate]) -> GroupDifference:
        """The row of a named difference with the values of the last fit, as they scatter between runs."""
        c, names = t.of, self.groups.names
        at = [fit.free.columns.index(Column(s, k)) for k in range(len(names)) for s in c.symbols]
        values = (fit.free.mean + fit.free.std * fit.p)[at]
        runs = np.array([len(set(self.runs[self.problem.data.run == k])) for k in range(len(names))])
        covariance = fit.covariance[np.ix_(at, at)] * np.outer(fit.free.std[at], fit.free.std[at])
        # of a mean over the runs of a group
        covariance += np.diag(np.kron(1.0 / runs, (t.test.scatter * c.typical) ** 2))
        return replace(t.row, parameters=self._parts(c, values, covariance))

    def _judged(
        self, best: Tested[Candidate], tests: Sequence[Tested[Candidate]], slopes: RunSlopes
    ) -> tuple[tuple[str, ...], Message | None]:
        """What says the same as the best difference by another name, and why it cannot be named, if so."""
        rivals = [t for t in tests if t is not best and t.row.log_bayes > best.row.log_bayes - ALIKE_BY]
        other = [t for t in rivals if imitated(slopes, best.of, t.of) < IMITATES]
        if is_cause(best):  # coefficients that say the same are what it changes
            other = [t for t in other if t.of.effect in EFFECTS]
        same = tuple(dict.fromkeys(t.row.name for t in rivals if t not in other))
        k, group = self.groups.names.index(best.row.group), best.row.group
        elsewhere = frozenset().union(*(kinds for i, kinds in enumerate(self.kinds) if i != k))
        if "" not in self.kinds[k] | elsewhere and not self.kinds[k] & elsewhere:
            words = f"{group} holds only {' and '.join(sorted(self.kinds[k]))} trials, of which no other group has any"
            words += ": what differs there may be an error of the model in such manoeuvres"
            return same, Message(f"{words} (strongest: {best.of.label})", "other_manoeuvres")
        if other:
            names = ", ".join(dict.fromkeys(t.of.label for t in (best, *other)))
            return same, Message(f"several parameters explain a difference equally well: {names}", "several_explain")
        return same, None


def is_cause(t: Tested[Candidate]) -> bool:
    """Whether the tested ``t`` is an effect in the ship, such as fouling: coefficients change by such a cause only."""
    return t.of.effect in EFFECTS and t.row.nature == "ship"


def physical(best: Tested[Candidate], clear: Sequence[Tested[Candidate]]) -> Tested[Candidate]:
    """What to name where ``best`` is a coefficient: a cause in the ship that explains as much, if ``clear`` has one."""
    if best.of.effect in EFFECTS:
        return best
    causes = [t for t in clear if is_cause(t) and t.row.log_bayes > best.row.log_bayes - ALIKE_BY]
    return max(causes, key=lambda t: t.row.log_bayes, default=best)


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


def sentence(by: str, verdict: str, named: Sequence[GroupDifference], reasons: Sequence[str]) -> str:
    """What differs between groups ``by`` day (or folder, ...), in words.

    verdict: "none", "named" or "unknown"; named: the differences; reasons: why more has no name. Returns text.
    """
    if verdict == "none":
        return f"between groups by {by} nothing differs beyond chance and the scatter of the runs"
    if verdict == "unknown":
        return f"the groups by {by} do not agree, and what differs has no name: {reasons[0]}"
    words = f"between groups by {by}: {'; '.join(difference(d) for d in named)}"
    return words + ("; they differ in more, which has no name" if reasons else "")


def difference(d: GroupDifference) -> str:
    """The named difference ``d`` in words, with 90 % intervals."""
    sizes = ", ".join(("" if name == d.name else f"{name} ") + size(p, d.group, d) for name, p in d.parameters.items())
    alike = f" (or {', '.join(d.equivalence_class)}, which would explain it as well)" if d.equivalence_class else ""
    meaning = "".join(f", {p.words}" for p in d.parameters.values() if p.words and len(d.parameters) == 1)
    return f"{d.name}{alike} in {d.group}, {sizes} against the others ({d.nature}{meaning})"


def size(p: GroupParameter, group: str, d: GroupDifference) -> str:
    """By how much a parameter ``p`` of ``d`` is larger in a ``group`` than in the others, with its 90 % interval; a
    coefficient in per cent."""
    x = p.groups[group]
    factor, unit = shown_unit(p.unit)
    rest = x.value - x.difference
    if d.name not in EFFECTS and d.source == "dynamics" and abs(rest) > NORMAL * x.difference_std:
        factor, unit = 100.0 / rest, "%"
    text = plus_minus(factor * x.difference, NORMAL * abs(factor) * x.difference_std)
    return f"{'+' if factor * x.difference > 0 else ''}{text} {unit}".rstrip()


def table_rows(b: Between) -> list[dict[str, Any]]:
    """Rows of the strongest tests of ``b``: what, p, log Bayes factor, value ± std by group, whether named."""
    out = []
    for d in b.candidates[:SHOWN]:
        for name, p in d.parameters.items():
            factor, unit = shown_unit(p.unit)
            cells = [plus_minus(factor * x.value, factor * x.std) for x in p.groups.values()]
            named = any((d.name, d.source, name) == (e.name, e.source, k) for e in b.differences for k in e.parameters)
            out.append(
                {"name": d.name, "parameter": name, "words": p.words, "unit": unit, "nature": d.nature, "named": named}
                | {"source": d.source, "p": d.p_value, "log_bayes": d.log_bayes, "cells": cells}
            )
    return out

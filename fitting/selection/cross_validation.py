"""Model choice by cross-validation over runs: which coefficients are free, how wide their priors are, and so on.

Runs are left out in turn (all of them one by one, or in folds); the ship fitted on the rest is judged by 30 s windows
of the runs left out. Choices are made one after the other (greedily), each from where the last one left off. A
candidate replaces the present choice only if it is better by LEAST_GAIN and by more than one standard error of the
difference over runs: a choice among nearly equal models would only fit the noise of the cross-validation.
"""

from __future__ import annotations

import itertools
import time
from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace

import numpy as np

from cases.shipfiles.effects import freeing_effects
from cases.trial import Trial
from fitting.calibration import estimate_coefficients
from fitting.nlp.captive import Captive
from fitting.nlp.grid import default_step
from fitting.nlp.loss import LOSSES
from fitting.parallel import run_all
from fitting.prediction.score import pooled_sigma, score
from fitting.settings import Settings
from fitting.solvers.interrupts import unless_interrupted
from mmg.errors import UserError
from mmg.messages import Message
from mmg.progress import LOGGER, OnProgress, Progress
from mmg.rollout import Simulator
from mmg.ship import Ship

FOLDS = 8
"""Most parts into which the runs are divided."""
LEAST_GAIN = 0.005
"""Share by which a candidate must lower the score."""
INSTRUMENTS = (("velocity_filter",), ("velocity_filter", "gyro"))
"""Measurement models that are tried beside none."""
MANAGED = ("velocity_filter", "gyro")
"""Effects that a choice puts on a ship or takes off it; all others stay as they were given."""
WIDTHS = (0.5, 2.0)
"""Factors on the standard deviations of the priors that are tried beside 1."""
STEPS = (30, 50, 200)
"""Window lengths [steps] that are tried beside the given one."""
PRIOR_SHARE = 0.9
"""Prior's share of the variance from which a coefficient counts as decided by its prior."""


@dataclass(frozen=True)
class Choice:
    """One model: effects of the instruments, factor on prior widths, window [s], loss, coefficients held."""

    measurement: tuple[str, ...] = ()
    width: float = 1.0
    window: float = 100.0
    loss: str = "gaussian"
    held: tuple[str, ...] = ()

    def words(self) -> str:
        held = f"{len(self.held)} coefficients held at their priors" if self.held else "all free"
        instruments = "+".join(self.measurement) or "none"
        return f"{held}, priors x {self.width:g}, windows {self.window:g} s, measurement {instruments}, {self.loss}"


@dataclass(frozen=True)
class CandidateModel:
    """A row of the table: what was varied, the choice, its scores, and whether it was taken.

    window, paper: pooled over the runs left out (30 s windows; restarts every 100 s); difference, error: of ``window``
    to the choice before, mean and standard error over runs; converged: fits that did, of ``folds``.
    """

    varied: str
    choice: Choice
    window: float
    paper: float
    difference: float
    error: float
    converged: int
    folds: int
    seconds: float
    taken: bool

    def to_dict(self) -> dict:
        return {**asdict(self), "words": self.choice.words()}


@dataclass(frozen=True)
class ModelSelection:
    """The choice, the ship and settings to fit with, and the table of what was tried."""

    choice: Choice
    ship: Ship
    settings: Settings
    table: tuple[CandidateModel, ...]
    notices: tuple[Message, ...]


@dataclass(frozen=True)
class Fold:
    """One fit of a candidate, complete enough for another process.

    out: numbers of the trials left out; warm: coefficients to start from; deadline: time (``time.time``) from which it
    is not started any more.
    """

    ship: Ship
    settings: Settings
    trials: tuple[Trial, ...]
    out: tuple[int, ...]
    sigma: np.ndarray
    captive: Captive | None
    warm: dict[str, float]
    deadline: float = float("inf")


def prepare(ship: Ship, choice: Choice) -> Ship:
    """The ``ship`` with the effects, priors and fixed coefficients of a ``choice``."""
    for name in MANAGED:
        if name in ship.effects and name not in choice.measurement:
            ship = ship.without_effect(name)
    ship = freeing_effects(ship, [name for name in choice.measurement if name not in ship.effects])
    wider = {s: ship.coefficients[s].with_(std=choice.width * ship.coefficients[s].std) for s in ship.free}
    return ship.with_coefficients(wider).fixing([s for s in choice.held if s in ship.free])


Outcome = tuple[np.ndarray, bool, dict[str, float]]
"""Per trial left out both metrics and the number of windows (trials, 3); whether the fit converged; coefficients."""


def run_fold(fold: Fold) -> Outcome | None:
    """Outcome of one ``fold``: fitted on the rest, scored on the trials left out; None when it is too late to begin."""
    if time.time() > fold.deadline:
        return None
    rest = [t for i, t in enumerate(fold.trials) if i not in fold.out]
    free = [fold.ship.coefficients[s] for s in fold.ship.free]
    warm = {"p": np.array([(fold.warm.get(c.symbol, c.value) - c.value) / c.std for c in free])} if fold.warm else None
    found = estimate_coefficients(fold.ship, rest, fold.settings, warm=warm, captive=fold.captive)
    judged = score(Simulator(found.ship, fold.settings.compiled), [fold.trials[i] for i in fold.out], fold.sigma)
    scores = np.array([(t.window, t.paper, t.windows) for t in judged.trials])
    return scores, found.converged, {s: found.ship.coefficients[s].value for s in fold.ship.free}


def folds_of(trials: Sequence[Trial], count: int) -> list[tuple[int, ...]]:
    """Numbers of the ``trials`` in ``count`` folds, those of a kind spread over them."""
    order = sorted(range(len(trials)), key=lambda i: (trials[i].kind or "", i))
    return [tuple(sorted(order[k::count])) for k in range(min(count, len(trials)))]


class Selector:
    """Cross-validation of candidates on trials, divided into FOLDS parts.

    limit: seconds; what would take longer, judged by the last candidates, is not tried.
    """

    def __init__(
        self,
        ship: Ship,
        trials: Sequence[Trial],
        settings: Settings,
        captive: Captive | None,
        limit: float,
        progress: OnProgress | None,
    ) -> None:
        if len(trials) < 3 or not all(t.has_position for t in trials):
            raise UserError("--auto needs at least three trials, all with positions, to leave out in turn")
        self.ship, self.trials, self.settings, self.captive = ship, tuple(trials), settings, captive
        self.sigma, self.parts = pooled_sigma(trials), folds_of(trials, FOLDS)
        self.limit, self.progress, self.began = limit, progress, time.perf_counter()
        self.table: list[CandidateModel] = []
        self.scores: dict[Choice, np.ndarray] = {}
        self.warm: dict[str, float] = {}
        self.each = 0.0

    @property
    def time_left(self) -> float:
        return self.limit - (time.perf_counter() - self.began)

    def cross_validate(self, varied: str, choices: Sequence[Choice], present: Choice | None) -> list[CandidateModel]:
        """Scores of candidates, all their folds spread over the workers at once; those out of time are left out."""
        began = time.perf_counter()
        tasks = [self.fold(choice, out) for choice in choices for out in self.parts]
        count = itertools.count(1)

        def fitted(_: Outcome | None) -> None:
            if self.progress:
                self.progress(Progress(f"model choice, {varied}", next(count), len(tasks)))

        done = unless_interrupted(lambda: run_all(run_fold, tasks, self.settings.workers, fitted))
        if done is None:  # a choice by a part of the folds would be another one
            raise KeyboardInterrupt
        self.each = (time.perf_counter() - began) / len(choices)
        rows, n = [], len(self.parts)
        for k, choice in enumerate(choices):
            mine = [outcome for outcome in done[k * n : (k + 1) * n] if outcome is not None]
            if len(mine) < n:
                continue
            scores = self.scores[choice] = np.full((len(self.trials), 3), np.nan)
            for out, (found, _, _) in zip(self.parts, mine, strict=True):
                scores[list(out)] = found
            if present is None:
                self.warm = {s: float(np.mean([values[s] for _, _, values in mine])) for s in mine[0][2]}
            before = self.scores[present or choice]
            rows.append(CandidateModel(
                varied,
                choice,
                window=self.mean_window(choice),
                paper=weighted_mean(scores[:, 1], np.where(scores[:, 2] > 0, [t.duration for t in self.trials], 0.0)),
                difference=self.mean_window(choice) - self.mean_window(present or choice),
                error=standard_error(scores - before, scores[:, 2]) if present else 0.0,
                converged=sum(converged for _, converged, _ in mine),
                folds=n,
                seconds=self.each,
                taken=present is None,
            ))  # fmt: skip
        return rows

    def mean_window(self, choice: Choice) -> float:
        """Mean error of the 30 s windows of all runs left out, by a choice that was cross-validated."""
        return weighted_mean(self.scores[choice][:, 0], self.scores[choice][:, 2])

    def fold(self, choice: Choice, out: tuple[int, ...]) -> Fold:
        settings = replace(
            self.settings,
            window=choice.window,
            loss=choice.loss,
            weight=self.settings.weight or 1.0,
            starts=1,
            workers=1,
            tolerance=1e-4,
            time_limit=None,
        )
        deadline = time.time() + self.time_left if self.warm else float("inf")
        ship = prepare(self.ship, choice)
        return Fold(ship, settings, self.trials, out, self.sigma, self.captive, self.warm, deadline)

    def decide(self, varied: str, choices: Sequence[Choice], present: Choice) -> Choice:
        """The best of the candidates, or the present choice when none is clearly better; extends the table."""
        fresh = [c for c in choices if c not in self.scores][: max(0, int(self.time_left / max(self.each, 1e-3)))]
        if not fresh:
            return present
        rows = self.cross_validate(varied, fresh, present)
        least = LEAST_GAIN * self.mean_window(present)
        whole = [r for r in rows if np.isfinite(r.window) and r.converged == r.folds]
        clear = np.isfinite(least)  # else the present choice diverges
        good = [r for r in whole if r.difference < -max(least, r.error)] if clear else whole
        best = min(good, key=lambda r: r.window, default=None)
        self.table += [replace(r, taken=r is best) for r in rows]
        for r in rows:
            LOGGER.info(
                f"auto, {varied}: {r.choice.words()}: {r.window:.4f} ({r.difference:+.4f} +- {r.error:.4f})"
                f"{', taken' if r is best else ''}"
            )
        return best.choice if best else present

    def held_by_prior(self, choice: Choice) -> tuple[str, ...]:
        """Coefficients that the prior decides when all are free."""
        fold = self.fold(choice, ())
        found = estimate_coefficients(fold.ship, fold.trials, fold.settings, captive=fold.captive)
        share = np.diag(found.covariance)
        return tuple(s for s, value in zip(found.prior.symbols, share, strict=True) if value > PRIOR_SHARE)


def weighted_mean(values: np.ndarray, weights: np.ndarray) -> float:
    """Mean of ``values`` (R,) with ``weights`` (R,), over the runs that count, those with nothing to score (NaN) left
    out; inf where the model diverges on one."""
    counts = (weights > 0) & ~np.isnan(values)
    return float(np.average(values[counts], weights=weights[counts])) if counts.any() else float("nan")


def standard_error(difference: np.ndarray, weights: np.ndarray) -> float:
    """Standard error over runs of the mean of the first column of ``difference`` (R, 3), by ``weights`` (R,)."""
    d = difference[:, 0]
    good = np.isfinite(d) & (weights > 0)
    d, w = d[good], weights[good] / weights[good].sum()
    n = len(d)
    return float(np.sqrt(n / max(n - 1, 1) * (w**2 * (d - w @ d) ** 2).sum())) if n else float("nan")


def select(
    ship: Ship,
    trials: Sequence[Trial],
    settings: Settings,
    captive: Captive | None = None,
    limit: float = 480.0,
    progress: OnProgress | None = None,
) -> ModelSelection:
    """The model for a final fit of ``ship`` on ``trials`` (and ``captive`` points); no other data are used.

    settings: of the fits, which ``settings.workers`` processes share; limit: seconds after which the search ends at the
    best choice so far; progress: called after each fit. Raises UserError for fewer than three runs, or runs without
    positions.
    """
    step = settings.step or default_step(trials, ship.particulars["L"])
    given = tuple(e for e in MANAGED if e in ship.effects)
    selector = Selector(ship, trials, settings, captive, limit, progress)
    now = Choice(given, window=settings.window or 100 * step, loss=settings.loss or LOSSES[0])
    selector.table += selector.cross_validate("start", [now], None)
    LOGGER.info(f"auto, start: {now.words()}: {selector.table[0].window:.4f}")
    instruments = ((), *(() if "gnss_delay" in ship.effects else INSTRUMENTS))
    now = selector.decide("measurement", [replace(now, measurement=m) for m in instruments], now)
    now = selector.decide("window", [replace(now, window=k * step) for k in STEPS], now)
    now = selector.decide("prior width", [replace(now, width=w) for w in WIDTHS], now)
    losses = [name for name in ("gaussian", "student") if name != now.loss]
    now = selector.decide("loss", [replace(now, loss=name) for name in losses], now)
    if selector.time_left > 0 and (held := selector.held_by_prior(now)):
        now = selector.decide("free coefficients", [replace(now, held=held)], now)
    notices = [Message(f"chosen by cross-validation over runs: {now.words()}", "model_chosen")]
    if selector.time_left <= selector.each:
        notices.append(Message(f"--auto stopped trying after its {limit:.0f} s", "model_choice_stopped"))
    return ModelSelection(
        choice=now,
        ship=prepare(ship, now),
        settings=replace(settings, window=now.window, loss=now.loss, weight=settings.weight or 1.0),
        table=tuple(selector.table),
        notices=tuple(notices),
    )

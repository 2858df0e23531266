"""Choice of a model's structure: fit every candidate, thin out the best, choose by validation, test the choice once."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np

from cases.shipfiles.model_changes import with_instruments
from cases.trial import Trial
from fitting.calibration import Calibration, estimate_coefficients
from fitting.nlp.captive import Captive
from fitting.pipeline import FitOptions, calibrate
from fitting.prediction.score import pooled_sigma, score
from fitting.result import FitResult
from fitting.selection.anchors import anchor_points
from fitting.selection.candidates import GIVEN, StructureCandidate
from fitting.selection.coverage import fault
from fitting.selection.sparsity import weak_terms
from fitting.selection.stability import SEQUENCES, Stability, stability
from fitting.settings import Settings
from mmg.errors import UserError
from mmg.motion.froude import time_scale
from mmg.progress import LOGGER, OnProgress, Progress
from mmg.rollout import Simulator
from mmg.ship import Ship

WINDOW = 100.0
"""Length of the windows fitted [s of a 3 m model], that of the paper's subsequences."""
LARGEST = 450
"""Most unknowns of a candidate that is tried without being named."""
NO_LOSS = 1.02
"""Factor on the best validation error up to which a model with fewer unknowns is preferred."""
INSTRUMENTS = ("velocity_lag",)


@dataclass(frozen=True)
class Tried:
    """One candidate and what became of it.

    unknowns: free coefficients; validation, training: mean squared error of 30 s windows, by the variance of the
    trials; stable: sequences of ``stability`` that did not diverge, of those simulated; left_out: why it was not tried.
    """

    name: str
    words: str
    unknowns: int
    terms: int
    validation: float = float("nan")
    training: float = float("nan")
    converged: bool = False
    seconds: float = 0.0
    stable: int = 0
    sequences: int = 0
    left_out: str = ""

    def to_dict(self) -> dict[str, Any]:
        """Plain values, NaN as None."""
        return {k: None if isinstance(v, float) and not np.isfinite(v) else v for k, v in asdict(self).items()}


@dataclass(frozen=True)
class StructureChoice:
    """The chosen candidate, calibrated; the table of all; errors on the test trials of some models; its stability."""

    chosen: str
    result: FitResult
    table: tuple[Tried, ...]
    test: dict[str, float]
    stability: Stability

    def to_dict(self) -> dict[str, Any]:
        """Content of selection.json."""
        test = {name: value if np.isfinite(value) else None for name, value in self.test.items()}
        return {
            "chosen": self.chosen,
            "candidates": [row.to_dict() for row in self.table],
            "test": test,
            "stability": asdict(self.stability),
        }


@dataclass(frozen=True)
class _Fitted:
    row: Tried
    ship: Ship
    start: StructureCandidate
    weak: tuple[str, ...]


def choose_structure(
    ship: Ship,
    given: Sequence[StructureCandidate],
    trials: tuple[Sequence[Trial], Sequence[Trial], Sequence[Trial]],
    settings: Settings | None = None,
    named: bool = False,
    progress: OnProgress | None = None,
) -> StructureChoice:
    """The best of candidates ``given`` for ``ship``, calibrated.

    trials: to fit on, to choose by, to test once; settings: of the fits; named: the candidates were named by the user,
    so that one that the trials cannot determine is an error; progress: called before each fit. The best two polynomials
    are also tried without the terms that their evidence speaks against (``sparsity.weak_terms``). A model that diverges
    in one of SEQUENCES random harbour sequences is not chosen while another one does not. Raises UserError where no
    candidate can be fitted, for trials without positions, and for a named one that the trials cannot determine.
    """
    train, validate, test = trials
    _check(train, validate)
    settings = settings or Settings()
    settings = replace(settings, window=settings.window or WINDOW * time_scale(ship.particulars["L"]))
    anchors, sigma = anchor_points(ship, train, settings.seed), pooled_sigma(train)
    fitted: list[_Fitted] = []
    table: list[Tried] = []
    for number, one in enumerate(given):
        reason = fault(one, train) or ("" if named or one.unknowns <= LARGEST else f"more than {LARGEST} unknowns")
        if reason and named:
            raise UserError(reason)
        if reason:
            table.append(_row(one, left_out=reason))
            continue
        if progress:
            progress(Progress(f"fitting {one.name}", number, len(given)))
        fitted.append(_fit(one, (train, validate), settings, anchors, sigma))
    polynomials = sorted((f for f in fitted if f.start.order), key=_error)[:2]
    thinned = [one for one in map(_thinned, polynomials) if one is not None]
    fitted += [_fit(one, (train, validate), settings, anchors, sigma) for one in thinned]
    if not fitted:
        raise UserError(f"no candidate can be fitted: {'; '.join(row.left_out for row in table[:3])}")
    best, checked = _stable_best(fitted, settings)
    rows = [checked.get(f.row.name, f.row) for f in fitted]
    own = None if best.start.name == GIVEN else anchors
    options = FitOptions(captive=own, instruments=INSTRUMENTS, next_trial=False)
    result = calibrate(best.start.ship, train, validate, settings, options, progress)
    messages = tuple(row for row in result.messages if row.code != "captive_against_prior")
    others = {f.row.name: f.ship for f in fitted if f.row.name == GIVEN}
    models = {"as given": ship, **{f"{name} calibrated": own for name, own in others.items()}, "chosen": result.ship}
    errors = {name: _window_error(model, test, sigma) for name, model in models.items()} if test else {}
    final = stability(result.ship, SEQUENCES, settings.seed, settings.compiled)
    return StructureChoice(best.row.name, replace(result, messages=messages), (*rows, *table), errors, final)


def _check(train: Sequence[Trial], validate: Sequence[Trial]) -> None:
    if not train or not validate:
        raise UserError(
            f"{len(train)} trials to fit on and {len(validate)} to choose by: give both, the latter with --validate"
        )
    without = [t.name for t in (*train, *validate) if not t.has_position]
    if without:
        raise UserError(f"{', '.join(without)}: no positions, by which candidates are judged")


def _row(one: StructureCandidate, **more: Any) -> Tried:
    return Tried(one.name, one.words, one.unknowns, sum(one.counts), **more)


def _error(fitted: _Fitted) -> float:
    return fitted.row.validation if np.isfinite(fitted.row.validation) else float("inf")


def _window_error(ship: Ship, trials: Sequence[Trial], sigma: np.ndarray) -> float:
    return score(Simulator(ship), list(trials), sigma).window


def _fit(
    one: StructureCandidate,
    trials: tuple[Sequence[Trial], Sequence[Trial]],
    settings: Settings,
    anchors: Captive,
    sigma: np.ndarray,
) -> _Fitted:
    """A candidate fitted on the first of the trials and scored on both; one that cannot be solved has no score."""
    began = time.perf_counter()
    start = with_instruments(one.ship, INSTRUMENTS)
    found: Calibration = estimate_coefficients(
        start, trials[0], settings, captive=None if one.name == GIVEN else anchors
    )
    training, validation = (_window_error(found.ship, some, sigma) for some in trials)
    row = _row(
        one,
        validation=validation,
        training=training,
        converged=found.converged,
        seconds=time.perf_counter() - began,
    )
    LOGGER.info(f"{one.name}: {one.unknowns} unknowns, validation {validation:.4g}, training {training:.4g}")
    return _Fitted(row, found.ship, one, weak_terms(found))


def _thinned(fitted: _Fitted) -> StructureCandidate | None:
    """The candidate without its weak terms; None if there are none, or no others."""
    weak = fitted.weak
    if not weak or len(weak) == len(fitted.start.ship.monomials):
        return None
    ship = fitted.start.ship
    kept = replace(ship, coefficients={s: c for s, c in ship.coefficients.items() if s not in weak})
    words = f"{fitted.start.words}, without {len(weak)} terms that the evidence speaks against"
    return replace(fitted.start, name=f"{fitted.start.name}-thinned", ship=kept, words=words)


def _stable_best(fitted: Sequence[_Fitted], settings: Settings) -> tuple[_Fitted, dict[str, Tried]]:
    """The first that stays stable, by validation error, a smaller model first where it loses next to nothing.

    Returns it, and the rows of those that were checked. If none stays stable, the one that diverges least often.
    """
    least = min(map(_error, fitted))
    near = sorted((f for f in fitted if _error(f) <= NO_LOSS * least), key=lambda f: f.row.unknowns)
    order = [*near, *sorted((f for f in fitted if f not in near), key=_error)]
    checked: dict[str, Tried] = {}
    for one in order:
        found = stability(one.ship, SEQUENCES, settings.seed, settings.compiled)
        checked[one.row.name] = replace(one.row, stable=found.sequences - found.diverged, sequences=found.sequences)
        if not found.diverged and np.isfinite(_error(one)):
            return one, checked
    return max(order, key=lambda f: checked[f.row.name].stable), checked

"""Windows of pieces as tensors: to train on, to judge by; the scales that are known from them.

Slicing and jittering follow Wakita et al. (2024, sections 3.1 to 3.4): a window of I rows every I (ref) or every S rows
(sli), and normal noise of the instruments on the states (jit).
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np
import torch

from cases.evidence.signals import white_noise
from cases.trial import Trial
from fitting.nlp.windows import Stretch
from fitting.prediction.predict import values_of
from fitting.prediction.score import PAPER_WINDOW, STRIDE, WINDOW, pooled_sigma
from fitting.solvers.rollout_loss import RolloutLoss
from mmg.errors import TooFewData
from mmg.motion.froude import length_scale
from mmg.ship import Ship
from residual.settings import SETS
from residual.system import Past, RolloutBatch, TrainableSystem, measured_accelerations, rollout, squares


def windows(pieces: Sequence[Stretch], h: float, steps: int, stride: int, past: int = 0) -> RolloutBatch | None:
    """Slices of ``steps`` steps of ``h`` [s] every ``stride`` rows of each of ``pieces``; None where none fits.

    None reaches out of its piece; ``past`` rows before each start, inside the piece, are given along.
    """
    # only whole windows: a window over the end of a piece would see rows that judge or stop
    starts = [(p.record, k) for p in pieces for k in range(p.first + past, p.last - steps + 1, stride)]
    if not starts:
        return None
    targets = _stacked(g.states[k : k + steps + 1] for g, k in starts)
    before = None
    if past:
        before = Past(*(_stacked(getattr(g, name)[k - past : k] for g, k in starts) for name in ("states", "controls")))
    return RolloutBatch(
        h,
        _stacked(g.controls[k : k + steps] for g, k in starts),
        # a gap must be a number: 0 times NaN is NaN, also in gradients. The mask takes it out
        torch.nan_to_num(targets),
        torch.isfinite(targets).double(),
        before,
    )


def _stacked(rows: Iterable[np.ndarray]) -> torch.Tensor:
    """Rows (N, C) of M windows side by side, (N, C, M)."""
    return torch.as_tensor(np.stack(list(rows), axis=2), dtype=torch.float64)


def campaign_symbols(ship: Ship) -> tuple[str, ...]:
    """The V coefficients of ``ship`` that its campaigns have for themselves."""
    return tuple(s for s in next(iter(ship.campaigns.values()), {}) if s in ship.coefficients)


def by_campaign(pieces: Sequence[Stretch], ship: Ship, trials: Sequence[Trial]) -> list[Stretch]:
    """``pieces`` of ``trials`` with the values of their campaign behind their inputs, (N, C + V), as ``Physics`` with
    ``campaign_symbols`` takes them; of a trial of none that ``ship`` knows the mean."""
    symbols = campaign_symbols(ship)
    if not symbols:
        return list(pieces)
    places = [ship.symbols.index(symbol) for symbol in symbols]
    values = [np.asarray(values_of(ship, trial))[places] for trial in trials]  # (V,) each
    result = []
    for piece in pieces:
        inputs = piece.record.controls
        inputs = np.hstack([inputs, np.tile(values[piece.run], (len(inputs), 1))])
        result.append(replace(piece, record=replace(piece.record, controls=inputs)))
    return result


def calibration_windows(loss: RolloutLoss, pieces: Sequence[Stretch]) -> RolloutBatch | None:
    """The windows of the ``loss`` of a calibration, weighed only within ``pieces``, by run and time; None: nowhere."""
    t = loss.began + loss.h * np.arange(len(loss.targets))[:, None]  # (N + 1, M), by the clock of its run
    inside = np.zeros(t.shape, dtype=bool)
    for p in pieces:
        # half a step of slack on either side: the grids of loss and pieces need not be the same
        inside |= (loss.run == p.run) & (t > p.t[0] - loss.h / 2) & (t < p.t[-1] + loss.h / 2)
    weights = loss.weights * inside[:, None]
    weighed = np.flatnonzero(weights.any(axis=(0, 1)))
    if not len(weighed):
        return None
    values = np.broadcast_to(loss.values, (len(loss.controls), *loss.values.shape))  # the same over all steps
    arrays = np.concatenate([loss.controls, values], axis=1), loss.targets, weights
    controls, targets, mask = (torch.as_tensor(np.ascontiguousarray(a[..., weighed])) for a in arrays)
    return RolloutBatch(loss.h, controls, targets, mask, states=torch.as_tensor(loss.starts[:, weighed].copy()))


def augmented(
    pieces: Sequence[Stretch], h: float, rows: int, name: str, noise: torch.Tensor, seed: int, past: int = 0
) -> RolloutBatch | None:
    """Windows of I = ``rows`` rows of ``pieces`` on a grid of ``h`` [s], as the set of that ``name`` cuts and copies
    them (Wakita et al. 2024, Eq. 15 to 23); None where none fits.

    noise: of the instruments (6,), of which that of u, v and r is drawn by ``seed`` (Table 5); past: rows before each
    start that are given along.
    """
    slices, copies = SETS[name]
    batch = windows(pieces, h, rows - 1, max(1, rows // slices), past)  # I rows are I - 1 steps
    if batch is None or not copies:
        return batch
    # positions and heading stay as measured, as in Table 5
    std = torch.cat([torch.zeros(3, dtype=torch.float64), noise[3:]])[:, None]
    draw = torch.Generator().manual_seed(seed)
    batch = batch.chosen(torch.arange(len(batch)).repeat(copies))
    targets, before = batch.targets, batch.past
    # by the mask: what is not measured stays 0
    targets = targets + torch.randn(targets.shape, generator=draw, dtype=torch.float64) * std * batch.mask
    if before:
        noisy = before.logged + torch.randn(before.logged.shape, generator=draw, dtype=torch.float64) * std
        before = Past(noisy, before.controls)
    return replace(batch, targets=targets, past=before)


def compare_errors(
    systems: tuple[TrainableSystem, TrainableSystem],
    pieces: Sequence[Stretch],
    h: float,
    sigma: np.ndarray,
    method: str,
) -> tuple[np.ndarray, np.ndarray]:
    """Errors of two ``systems`` on 30 s windows every 15 s and on 100 s windows side by side.

    pieces: on a grid of h [s]; sigma: (6,) by which errors are divided; method: of the integration. Returns rows (run,
    first row of its piece, error of each system) of the 30 s windows and of the 100 s restarts.
    """
    past, scale = systems[0].past, torch.as_tensor(sigma)
    place, rows_by_length = np.array([(p.run, p.first) for p in pieces]).reshape(-1, 2), []
    # overlapping windows, and restarts side by side, as the scores have them
    for length, stride in ((WINDOW, STRIDE), (PAPER_WINDOW, PAPER_WINDOW)):
        rows, every = round(length / h), round(stride / h)
        batch = windows(pieces, h, rows, every, past)
        errors = [window_errors(s, batch, scale, method) if batch else np.zeros(0) for s in systems]
        # as ``windows`` counts them, so that each error finds its run again
        counts = np.array([len(range(p.first + past, p.last - rows + 1, every)) for p in pieces], dtype=int)
        rows_by_length.append(np.column_stack([np.repeat(place, counts, axis=0), *errors]))
    return rows_by_length[0], rows_by_length[1]


@torch.no_grad()
def window_errors(system: TrainableSystem, batch: RolloutBatch, sigma: torch.Tensor, method: str) -> np.ndarray:
    """Mean squared normalised error of ``system`` on each window of ``batch`` (M,), on the grid.

    sigma: (6,) by which errors are divided; method: of the integration.
    """
    return squares(rollout(system, batch, method), batch, sigma).numpy()


# Sigma of the loss for x, y [m] of a 3 m ship and for psi [rad], set by hand; those of u, v, r are of the data.
POSITION, HEADING = 1.0, 0.3
LEAST_SCALE = 1e-9  # Scale of what never changes in the training rows. It bounds a division.


@dataclass(frozen=True)
class Scales:
    """What is known of the training data before training.

    feature (F,), output (3,): scales of a network; mean, std (F,): of its features; sigma (6,): of the loss; score
    (6,): of stop and judged windows; acceleration, acceleration_mean (3,): deviation, as of Eq. 16, and mean of the
    measured accelerations; noise (6,): of the instruments, for jittering; features (F, R): of the training rows.
    """

    feature: np.ndarray
    output: np.ndarray
    mean: np.ndarray
    std: np.ndarray
    sigma: np.ndarray
    score: np.ndarray
    acceleration: np.ndarray
    acceleration_mean: np.ndarray
    noise: np.ndarray
    features: np.ndarray


def training_scales(
    ship: Ship,
    pieces: Sequence[Stretch],
    trials: Sequence[Trial],
    h: float,
    features_at: Callable[[torch.Tensor, torch.Tensor], torch.Tensor],
) -> Scales:
    """Scales of the measured rows of ``pieces``, which are those of ``trials`` of ``ship`` on a grid of ``h`` [s].

    features_at: (logged columns (6, M), inputs (C, M)) -> what the network is fed (F, M). Its output is scaled by the
    deviation of the measured accelerations (Wakita et al. 2025, Eq. 14). Raises UserError where there are no rows, or
    nothing moves in them.
    """
    rows = windows(pieces, h, 1, 1)  # each row and the one after it, as windows of one step
    if rows is None:
        raise TooFewData("too little data to train on: no piece of a trial is longer than a step without a gap")
    measured, mask = measured_accelerations(rows)
    accelerations = measured[0].numpy()[:, mask[0].numpy().all(axis=0)]  # differences over a gap are no accelerations
    states = [p.logged for p in pieces]
    sigma = _loss_sigma(states, ship.particulars["L"])
    placed = [t for t in trials if t.has_position]
    features = features_at(rows.targets[0], rows.controls[0]).numpy()
    rms, std = np.sqrt((features**2).mean(axis=1)), features.std(axis=1)
    acceleration = np.maximum(accelerations.std(axis=1), LEAST_SCALE)
    return Scales(
        # a feature that is always zero keeps scale 1, so that it stays zero and does not blow up outside the data
        feature=np.where(rms > LEAST_SCALE, rms, 1.0),
        output=acceleration,
        mean=features.mean(axis=1),
        std=np.where(std > LEAST_SCALE, std, 1.0),
        sigma=sigma,
        score=pooled_sigma(placed) if placed else sigma,  # the scores' own scales need positions
        acceleration=acceleration,
        acceleration_mean=accelerations.mean(axis=1),
        noise=white_noise(states),
        features=features,
    )


def _loss_sigma(states: Sequence[np.ndarray], length: float) -> np.ndarray:
    """Sigma of the loss (6,): a third of a ship length, 0.3 rad, and the standard deviation of each velocity.

    The deviation of positions over a whole pond would make the drift of a window invisible.
    """
    std = np.nanstd(np.vstack(states)[:, 3:], axis=0)
    if not (std > 0).all():  # a constant velocity has no scale by which its error could be measured
        raise TooFewData("u, v or r never changes in the training trials, so there is nothing to learn from")
    position = POSITION * length_scale(length)
    return np.array([position, position, HEADING, *std])

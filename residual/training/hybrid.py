"""Training of a residual on a calibrated ship: scales, tasks of the seeds, the mean network, the decision."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import torch

from cases.trial import Trial
from fitting.nlp.grid import default_step
from mmg.messages import Message
from mmg.network import Network
from mmg.progress import OnProgress
from mmg.ship import Ship
from residual.bounded_network import Residual, Symmetric, TwoLayers, to_network
from residual.physics.operator import Physics
from residual.settings import TrainSettings
from residual.system import Hybrid
from residual.training.acceptance import decide
from residual.training.checkpoint import Store
from residual.training.decision import Decision
from residual.training.scales import LEAST_SCALE, Scales, measured_scales
from residual.training.seeds import train_seeds
from residual.training.tasks import training_tasks
from residual.training.trainer import Outcome
from residual.training.windows import Piece, pieces_of

OUTPUT = 0.3
"""Scale of the residual as a share of the rms accelerations of the ship on the training rows."""


@dataclass(frozen=True)
class TrainedResidual:
    """What training a residual made. ship: the calibrated ship; network: the mean of the residuals, None where every
    training diverged; decision: whether it is worth keeping; outcomes: of each seed; settings: with the step filled in;
    scales: of the training data; seconds: it took; interrupted: by Ctrl-C.
    """

    ship: Ship
    network: Network | None
    decision: Decision
    outcomes: tuple[Outcome, ...]
    settings: TrainSettings
    scales: Scales
    seconds: float
    interrupted: bool = False


def build_hybrid(ship: Ship, scales: Scales, settings: TrainSettings, seed: int) -> Hybrid:
    """A calibrated ``ship`` with a residual of these ``scales``, ``settings`` and ``seed`` that is still zero."""
    return Hybrid(Physics(ship), residual_of(ship, scales, settings, seed), scales.features)


def residual_of(ship: Ship, scales: Scales, settings: TrainSettings, seed: int) -> TwoLayers:
    """An untrained residual on ``ship`` of these ``scales``, ``settings`` and ``seed``."""
    if not settings.symmetric:
        return Residual(scales.feature, scales.output, settings.width, seed)
    own = Residual(scales.feature, scales.output, max(1, settings.width // 2), seed)
    return Symmetric(own, ship.actuators)


def train_residual(
    ship: Ship,
    trials: Sequence[Trial],
    settings: TrainSettings,
    validation: Sequence[Trial] = (),
    progress: OnProgress | None = None,
    store: Store | None = None,
) -> TrainedResidual:
    """Train a residual on a calibrated ship from several seeds and decide whether their mean is worth keeping.

    Each seed stops by other parts of the ``trials`` and is judged by others again (``residual.training.folds``), or by
    ``validation`` where that is given. ship: its network, if any, is left out; settings: how to train; progress: called
    after each epoch or seed; store: finished seeds, which are not trained again. Returns the residual and the
    decision. Raises UserError where there is too little to train on, stop or judge by, KeyboardInterrupt after
    Ctrl-C before any training began.
    """
    began = time.perf_counter()
    ship = ship.without_network()
    h = settings.step or default_step(trials, ship.particulars["L"])
    settings = replace(settings, step=h)
    pieces = pieces_of(trials, h, ship.inputs)
    held = pieces_of(validation, h, ship.inputs) if validation else []
    scales = hybrid_scales(ship, pieces, trials, h)
    tasks = training_tasks(build_hybrid, ship, scales, settings, pieces, held)
    outcomes, interrupted = train_seeds(tasks, settings, progress, store)
    good = [o for o in outcomes if o.status != "diverged"]
    network = network_of(ship, scales, settings, good) if good else None
    seconds = time.perf_counter() - began
    return TrainedResidual(ship, network, decide(outcomes), tuple(outcomes), settings, scales, seconds, interrupted)


def hybrid_scales(ship: Ship, pieces: Sequence[Piece], trials: Sequence[Trial], h: float) -> Scales:
    """Scales for a residual on ``ship`` from ``pieces`` of ``trials`` on a grid of ``h`` [s].

    Raises UserError where there are no rows, or nothing moves in them.
    """
    physics, m = Physics(ship), measured_scales(pieces, trials, h, ship.particulars["L"])
    logged, controls = m.rows.targets[0], m.rows.controls[0]
    with torch.no_grad():
        rates = physics.rates(physics.start(logged, controls), controls)[3:6].numpy()
    features = physics_features(physics, pieces)
    rms = np.sqrt((features**2).mean(axis=1))
    return Scales(
        feature=np.where(rms > LEAST_SCALE, rms, 1.0),
        output=OUTPUT * np.sqrt((rates**2).mean(axis=1)) + LEAST_SCALE,
        sigma=m.sigma,
        score=m.score,
        acceleration=m.std,
        noise=m.noise,
        features=features,
    )


def physics_features(physics: Physics, pieces: Sequence[Piece]) -> np.ndarray:
    """What a network on the ship of ``physics`` sees at the measured rows of ``pieces``, (F, rows)."""
    rows = [torch.as_tensor(np.nan_to_num(p.grid.states[p.first : p.last].T)) for p in pieces]
    controls = [torch.as_tensor(np.ascontiguousarray(p.grid.controls[p.first : p.last].T)) for p in pieces]
    logged, inputs = torch.cat(rows, dim=1), torch.cat(controls, dim=1)
    return physics.features(physics.start(logged, inputs), inputs).numpy()


def network_of(ship: Ship, scales: Scales, settings: TrainSettings, outcomes: Sequence[Outcome]) -> Network:
    """The mean of the residuals that ``outcomes`` hold, with the range of the training rows.

    ship, scales, settings: of their training.
    """
    residuals = []
    for o in outcomes:
        residual = residual_of(ship, scales, settings, o.seed)
        weights = {name.removeprefix("residual."): torch.as_tensor(v) for name, v in o.state.items()}
        residual.load_state_dict(weights, strict=False)
        residuals.append(residual)
    return to_network(residuals, ship.actuators, scales.features.min(axis=1), scales.features.max(axis=1))


def warnings_of(outcomes: Sequence[Outcome], settings: TrainSettings) -> tuple[Message, ...]:
    """Warnings on the seeds of ``settings`` that did not come to their end, by the ``outcomes`` of the others."""
    status = {o.seed: o.status for o in outcomes}
    seeds = range(settings.seed, settings.seed + settings.seeds)
    kinds = (
        ("diverged", "diverged, also at lower rates, and left out"),
        ("stopped", "stopped before the end"),
        ("missing", "not begun"),
    )
    found = []
    for kind, words in kinds:
        which = ", ".join(str(s) for s in seeds if status.get(s, "missing") == kind)
        found += [Message(f"{words}: seed(s) {which}", f"seeds_{kind}")] if which else []
    return tuple(found)

"""How far a hybrid gets: memory, tuned coefficients, initial state, jitter, ensembles, errors of the past, more data.

``python -m benchmarks.hybrid_variants RUN [--seeds N] [VARIANT ...]``: RUN is a calibration on Train-TZRB (Wakita et
al. 2022). Trained on the same eight records; scored on the 21 others of Train-TZRB+ without the development hold-outs,
on the grid of 1 s, from every row at which ``mmg score`` starts. Variants on "more data" deal these 21 into five parts
by turns: each is scored by networks trained on the eight and the other four parts. A training takes 5 to 30 s.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import partial

import numpy as np
import torch

from benchmarks.ensembles.fixed_ship import FixedShip
from benchmarks.hybrid_system import Extra, Knowing, build, with_past
from cases import published_splits as splits
from cases.io.read import read_trials
from cases.shipfiles.ship_file import load_ship
from fitting.nlp.grid import default_step
from fitting.prediction.score import pooled_sigma
from mmg.ship import Ship
from residual.rollout import RolloutBatch, rollout, squares
from residual.settings import TrainSettings
from residual.system import TrainableSystem
from residual.training.folds import WINDOW
from residual.training.hybrid import hybrid_scales
from residual.training.pieces import Piece
from residual.training.pieces import pieces_of as grid_pieces
from residual.training.scales import Scales
from residual.training.tasks import training_tasks
from residual.training.trainer import restored, train_one
from residual.training.window_errors import RESTART, STRIDE
from residual.training.windows import windows

PARTS = 5
"""Parts of the 21 records in the variants on more data."""
GAINS = ("current", "force", "start")


@dataclass(frozen=True)
class Variant:
    """extra: what the hybrid knows besides; settings of the training; members of the mean; more: on more data;
    judge: whether a fifth of the runs is set aside to judge, as in the product, or trained on as well; within: trained
    on and stopped by what scores, a bound of what such a network can explain.
    """

    extra: Extra = field(default_factory=Extra)
    settings: dict = field(default_factory=dict)
    members: int = 5
    more: bool = False
    judge: bool = True
    within: bool = False


ALL = (3.0, 10.0, 30.0)
ERRORS, TUNED = Extra(innovation=True), Extra(coefficients=True)
KALMAN = Extra(gains=("current", "force"), network=False)
FREE = {"penalty": 0.0, "epochs": 40}
VARIANTS = {
    "symmetric": Variant(),
    "symmetric, all runs": Variant(judge=False),
    "jitter 1": Variant(settings={"jitter": 1.0}),
    "penalty 1": Variant(settings={"penalty": 1.0}),
    "penalty 0.1": Variant(settings={"penalty": 0.1}),
    "ensemble of 10": Variant(members=10),
    "memory 10 s": Variant(Extra(lags=(10.0,))),
    "memory 3, 10, 30 s": Variant(Extra(lags=ALL)),
    "memory 3, 10, 30 s, plain": Variant(Extra(lags=ALL, symmetric=False)),
    "coefficients alone": Variant(replace(TUNED, network=False)),
    "coefficients": Variant(TUNED),
    "coefficients, memory 10 s": Variant(replace(TUNED, lags=(10.0,))),
    "coefficients, memory 3, 10, 30 s": Variant(replace(TUNED, lags=ALL)),
    "coefficients, memory 10 s, kappa 0.001": Variant(replace(TUNED, lags=(10.0,), kappa=0.001)),
    "start*": Variant(Extra(gains=("start",))),
    "errors*": Variant(ERRORS),
    "errors, memory 10 s*": Variant(replace(ERRORS, lags=(10.0,))),
    "gains alone*": Variant(KALMAN),
    "gains, start alone*": Variant(replace(KALMAN, gains=GAINS)),
    "gains, symmetric*": Variant(Extra(gains=GAINS)),
    "gains, coefficients, memory 10 s*": Variant(Extra(gains=GAINS, coefficients=True, lags=(10.0,))),
    "adapt, symmetric*": Variant(Extra(adapted=True)),
    "adapt, gains alone*": Variant(replace(KALMAN, adapted=True, gains=GAINS)),
    "adapt, gains, symmetric*": Variant(Extra(adapted=True, gains=GAINS)),
    "adapt, gains, coefficients, memory 10 s*": Variant(
        Extra(adapted=True, gains=GAINS, coefficients=True, lags=(10.0,))
    ),
    "gains, start alone, cost 0.1, all runs*": Variant(replace(KALMAN, gains=GAINS, cost=0.1), judge=False),
    "adapt, memory 10 s*": Variant(Extra(adapted=True, lags=(10.0,))),
    "adapt, coefficients*": Variant(replace(TUNED, adapted=True)),
    "adapt, coefficients, memory 10 s*": Variant(replace(TUNED, adapted=True, lags=(10.0,))),
    "adapt, coefficients, memory 10 s, all runs*": Variant(replace(TUNED, adapted=True, lags=(10.0,)), judge=False),
    "coefficients, memory 10 s, all runs": Variant(replace(TUNED, lags=(10.0,)), judge=False),
    "coefficients, all runs": Variant(TUNED, judge=False),
    "more data: symmetric": Variant(more=True),
    "more data: memory 10 s": Variant(Extra(lags=(10.0,)), more=True),
    "more data: coefficients, memory 10 s": Variant(replace(TUNED, lags=(10.0,)), more=True),
    "more data: adapt, symmetric*": Variant(Extra(adapted=True), more=True),
    "more data: adapt, coefficients, memory 10 s*": Variant(replace(TUNED, adapted=True, lags=(10.0,)), more=True),
    "more data: adapt, gains, symmetric*": Variant(Extra(adapted=True, gains=GAINS), more=True),
    "within: symmetric, no penalty": Variant(settings=FREE, within=True, members=3),
    "within: memory 3, 10, 30 s, no penalty": Variant(Extra(lags=ALL), FREE, within=True, members=3),
    "within: coefficients alone": Variant(replace(TUNED, network=False, kappa=1e-4), within=True, members=3),
}
"""By name; those with * read the past of a window, as ``--adapt`` does."""


@dataclass(frozen=True)
class Setting:
    """Ship, grid step [s], records that train and others that score, with their past; scales of the former."""

    ship: Ship
    h: float
    train: list[Piece]
    others: list[Piece]
    scales: Scales
    sigma: torch.Tensor

    @classmethod
    def of(cls, run: str, past: float) -> Setting:
        """Of a run on Train-TZRB and ``past`` [s] that adaptation may use.

        The development hold-outs and the published test set are never read.
        """
        out = {*splits.TRAIN_TZRB, *splits.DEVELOPMENT_HOLDOUT, "turn_14-Sep-2020_15_58_08"}
        train = read_trials(splits.find(splits.TRAIN_TZRB))
        others = read_trials(splits.find([name for name in splits.TRAIN_TZRB_PLUS if name not in out]))
        ship = load_ship(run).without_network()
        h = default_step(train, ship.particulars["L"])
        if h != 1.0:
            raise ValueError(f"the past is tabulated on a grid of 1 s, not of {h:g} s")
        pieces, held = (grid_pieces(trials, h, ship.inputs) for trials in (train, others))
        scales = hybrid_scales(ship, pieces, train, h)
        wide, rms = with_past(ship, pieces, None, past)
        sigma = torch.as_tensor(pooled_sigma(others))
        return cls(ship, h, wide, with_past(ship, held, rms, past)[0], scales, sigma)

    def batches(self, pieces: Sequence[Piece]) -> list[RolloutBatch]:
        """Windows of both metrics."""
        pairs = (WINDOW, STRIDE), (RESTART, RESTART)
        found = [windows(pieces, self.h, round(a / self.h), round(b / self.h)) for a, b in pairs]
        return [batch for batch in found if batch is not None]

    def scaled(self, extra: Extra, pieces: Sequence[Piece]) -> Scales:
        """Scales of what a network of these extras sees in the training rows; outputs and sigma stay."""
        physics = Knowing(self.ship, extra)
        blind = replace(self.scales, feature=np.ones(physics.width_in), features=np.zeros((physics.width_in, 1)))
        system = build(replace(extra, symmetric=False), self.ship, blind, TrainSettings(), 0)
        rows = windows(pieces, self.h, 1, 5)
        assert rows is not None
        with torch.no_grad():
            z = system.start(rows.targets[0], rows.controls[0])
            real = rows.controls[0][: len(physics.model.controls)].contiguous()
            seen = physics.features(z.contiguous(), real).numpy()
        feature = np.sqrt((seen**2).mean(axis=1))
        return replace(self.scales, feature=np.where(feature > 1e-9, feature, 1.0), features=seen)


@torch.no_grad()
def paths(system: TrainableSystem, batches: Sequence[RolloutBatch]) -> list[torch.Tensor]:
    """Trajectories of both metrics."""
    return [rollout(system, batch) for batch in batches]


def errors(found: Sequence[torch.Tensor], batches: Sequence[RolloutBatch], sigma: torch.Tensor) -> list[np.ndarray]:
    """Of each window, on both metrics."""
    return [squares(a, b, sigma).numpy() for a, b in zip(found, batches, strict=True)]


def sums(each: Sequence[np.ndarray]) -> np.ndarray:
    """Sum over windows of both metrics (2,)."""
    return np.array([a.sum() for a in each])


def by_file(each: np.ndarray, pieces: Sequence[Piece], h: float) -> np.ndarray:
    """Sums of the errors of 30 s windows over the files of these pieces."""
    counts = [len(range(p.first, p.last - round(WINDOW / h) + 1, round(STRIDE / h))) for p in pieces]
    runs = np.repeat(np.unique([p.run for p in pieces], return_inverse=True)[1], counts)
    return np.bincount(runs, each)


def ship_errors(s: Setting, batches: Sequence[RolloutBatch]) -> list[np.ndarray]:
    """Those of the calibrated ship."""
    known = FixedShip(s.ship)
    C = len(known.physics.model.controls)
    plain = [RolloutBatch(b.h, b.controls[:, :C].contiguous(), b.targets, b.mask) for b in batches]
    return errors(paths(known, plain), plain, s.sigma)


def sets_of(s: Setting, v: Variant) -> list[tuple[list[Piece], list[Piece]]]:
    """What trains and what scores, by turns."""
    held = [replace(p, run=p.run + 1000) for p in s.others]
    if v.within:
        return [([*s.train, *held], held)]
    if not v.more:
        return [(s.train, s.others)]
    parts = [[p for i, p in enumerate(held) if i % PARTS == k] for k in range(PARTS)]
    dealt = [[p for j, part in enumerate(parts) if j != k for p in part] for k in range(PARTS)]
    # the runs that stop the training are every fifth: those of calibration are spread among the others
    mixed = [sorted([*s.train, *some], key=lambda p: (p.run % 1000, p.run)) for some in dealt]
    return list(zip(mixed, parts, strict=True))


@dataclass(frozen=True)
class Gains:
    """On both metrics: of each member (members, 2), of the mean of their trajectories (2,); files on whose 30 s windows
    that mean is no worse; seconds per training.
    """

    each: np.ndarray
    mean: np.ndarray
    files: int
    seconds: float = 0.0


def gains_of(s: Setting, v: Variant, seed: int) -> Gains:
    """What a set of members brings."""
    after, mean_after, before, files, seconds = np.zeros((v.members, 2)), np.zeros(2), np.zeros(2), 0, []
    for train, held in sets_of(s, v):
        scales, make = s.scaled(v.extra, train), partial(build, v.extra)
        total, known = sum(p.steps for p in train), sum(p.steps for p in s.train)
        epochs = max(8, round(40 * known / total))
        values = {"epochs": epochs, "penalty": 0.3, **v.settings}
        training = TrainSettings(seed=seed, seeds=v.members, step=s.h, **values)
        stop = held if v.within else []
        tasks = training_tasks(make, s.ship, scales, training, train, stop, v.judge and not v.within)
        outcomes = [train_one(t) for t in tasks]
        systems, batches = restored(tasks[0], outcomes), s.batches(held)
        each = [paths(system, batches) for system in systems]
        after += [sums(errors(found, batches, s.sigma)) for found in each]
        mean = errors([torch.stack(a).mean(0) for a in zip(*each, strict=True)], batches, s.sigma)
        ship = ship_errors(s, batches)
        mean_after, before = mean_after + sums(mean), before + sums(ship)
        files += int((by_file(mean[0], held, s.h) <= by_file(ship[0], held, s.h)).sum())
        seconds += [o.seconds for o in outcomes]
    return Gains(1 - after / before, 1 - mean_after / before, files, float(np.mean(seconds)))


def adapted(s: Setting) -> Gains:
    """What ``fitting.prediction.adaptation`` alone brings."""
    extra, batches = Extra(adapted=True, network=False), s.batches(s.others)
    system = build(extra, s.ship, s.scaled(extra, s.train), TrainSettings(), 0)
    after, before = errors(paths(system, batches), batches, s.sigma), ship_errors(s, batches)
    gain = 1 - sums(after) / sums(before)
    files = (by_file(after[0], s.others, s.h) <= by_file(before[0], s.others, s.h)).sum()
    return Gains(gain[None], gain, int(files))


def figures(values: np.ndarray) -> str:
    """Mean and standard deviation of both metrics (n, 2) in %, as cells."""
    spread = values.std(axis=0, ddof=1) if len(values) > 1 else np.zeros(2)
    pairs = zip(values.mean(axis=0), spread, strict=True)
    return " | ".join(f"{100 * a:+.2f}" + (f" ± {100 * b:.2f}" if len(values) > 1 else "") for a, b in pairs)


def main() -> None:
    """Print a row per variant."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("run")
    parser.add_argument("variants", nargs="*", metavar="VARIANT")
    parser.add_argument("--sets", type=int, default=1, help="sets of members, seeds 0, 100, ...")
    parser.add_argument("--members", type=int, help="members of a set, instead of those of the variant")
    parser.add_argument("--past", type=float, default=30.0, help="seconds that adaptation may use")
    given = parser.parse_intermixed_args()
    torch.set_num_threads(1)
    s = Setting.of(given.run, given.past)
    batches = s.batches(s.others)
    known = [float(a.mean()) for a in ship_errors(s, batches)]
    print(f"calibrated ship: 30 s windows {known[0]:.4f}, 100 s restarts {known[1]:.4f}\n")
    print("| variant | members | one: 30 s | one: 100 s | mean of all: 30 s | 100 s | files | s |")
    print("|---|---|---|---|---|---|---|---|")
    known_past = adapted(s)
    print(f"| --adapt {given.past:g} alone* | | | | {figures(known_past.each)} | {known_past.files} | |", flush=True)
    for name in given.variants or VARIANTS:
        v = VARIANTS[name]
        v = replace(v, members=given.members or v.members)
        found = [gains_of(s, v, 100 * i) for i in range(given.sets)]
        one, mean = figures(np.vstack([g.each for g in found])), figures(np.array([g.mean for g in found]))
        files, seconds = "/".join(str(g.files) for g in found), np.mean([g.seconds for g in found])
        print(f"| {name} | {v.members} x {given.sets} | {one} | {mean} | {files} | {seconds:.0f} |", flush=True)


if __name__ == "__main__":
    main()

"""Finished seeds of a training, kept as they finish: what ``--resume`` continues from."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path

import numpy as np

from cases.trial import Trial
from fitting.report.parts import Store, hash_of_ship, hashes_of_trials
from mmg.ship import Ship
from residual.settings import TrainSettings
from residual.training.trainer import Outcome

FREE = ("workers", "time_limit")
"""Settings that may change between an interrupted run and its continuation: they do not change its numbers."""


def training_store(
    out: Path,
    ship: Ship,
    trials: Sequence[Trial],
    validation: Sequence[Trial],
    settings: TrainSettings,
    resume: bool = False,
) -> Store:
    """Where the finished seeds of a training are, or will be, kept, with what must be the same to continue it.

    out: its run folder; ship, trials, validation, settings: as given to ``residual.pipeline.train``, the trials without
    those held out by their role; resume: continue where ``out`` is there.
    """
    about = {
        "--model": getattr(settings, "kind", "hybrid"),
        "settings": {name: value for name, value in asdict(settings).items() if name not in FREE},
        "ship": hash_of_ship(ship),
        "trial files": hashes_of_trials(trials),
        "--validate": hashes_of_trials(validation),
    }
    return Store(out / "training", about, resume and out.exists())


def save_outcome(store: Store, outcome: Outcome) -> None:
    """Keep the ``outcome`` of a seed in ``store``."""
    o, arrays = outcome, {f"state.{name}": value for name, value in outcome.state.items()}
    arrays |= {"errors": np.array([o.before, o.after]), "history": np.array(o.history), "judged": o.judged}
    arrays |= {"times": np.array([o.rate, o.seconds]), "path": np.array(o.path).reshape(-1, 2)}
    store.save(f"seed_{o.seed}", {name: getattr(o, name) for name in _WORDS}, arrays)


def load_outcome(store: Store, seed: int) -> Outcome | None:
    """The training of a ``seed`` as ``store`` kept it, to the last bit; None where it is not complete."""
    found = store.load(f"seed_{seed}")
    if found is None:
        return None
    words, arrays = found
    (before, after), (rate, seconds) = arrays["errors"].tolist(), arrays["times"].tolist()
    history = tuple((int(row[0]), *row[1:]) for row in arrays["history"].tolist())
    path = tuple((weight, least) for weight, least in arrays["path"].tolist())
    state = {name.removeprefix("state."): a for name, a in arrays.items() if name.startswith("state.")}
    return Outcome(
        before=tuple(before), after=tuple(after), history=history, state=state, rate=rate, seconds=seconds,
        judged=arrays["judged"], path=path, **{name: words[name] for name in _WORDS},
    )  # type: ignore[arg-type]  # fmt: skip


_WORDS = ("seed", "status", "restarts", "windows", "held_out_windows", "fold")
"""What of an outcome is no array."""

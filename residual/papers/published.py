"""The networks of Wakita et al. (2022) as published, and their Table 9.

The five types of Table 7: windowed or standard recurrent network of 200 neurons, loss of states or accelerations, three
sets of training data; Euler steps of 0.1 s, rollouts of 6 s, errors over the deviations of the training data.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from cases.io.published_splits import SPLITS
from cases.trial import Trial
from fitting.prediction.predict import Forecaster, predict
from fitting.prediction.score import PAPER_WINDOW, pooled_sigma
from mmg.errors import Missing
from mmg.rollout import Simulator
from residual.settings import BlackBoxSettings

PaperModels = dict[str, tuple[BlackBoxSettings, tuple[Trial, ...]]]
"""Name of a network -> its settings and the trials that it is trained on."""
PAPERS = ("wakita2022",)
TYPES = {
    "type1": ("rnn-window", "state", "train-tzrb+"),
    "type2": ("rnn", "state", "train-tzrb+"),
    "type3": ("rnn-window", "acceleration", "train-tzrb+"),
    "type4": ("rnn-window", "state", "train-tzb"),
    "type5": ("rnn-window", "state", "train-tzrb"),
}
"""Type of network -> kind, loss and split of the records (Table 7)."""
NETWORK = {"width": 200, "memory": 10, "step": 0.1, "curriculum": ((6.0, 1.0),), "method": "euler", "penalty": 0.0}
"""Eq. 7 and Table 8: 200 neurons, m = 10 rows, N_T = 60 rows of 0.1 s; without a penalty of weights."""
STEPS, EVERY, BATCH, RATE = 200, 3.0, 128, 1e-3
"""Of the shorter schedule: gradient steps, seconds between windows, windows a step, and first rate. Set by hand: some
ten minutes a network on one core."""
SHORTER = (
    f"A schedule shorter than the published one: {STEPS} gradient steps of {BATCH} windows, one every {EVERY:g} s, at "
    f"rates of {RATE:g} to 2e-05; --epochs N as published: windows at every row, 512 a step, at 2e-05 (or 1e-4)"
)


def paper_models(trials: Sequence[Trial], names: Sequence[str], epochs: int | None, **values: Any) -> PaperModels:
    """Settings and training trials of the types ``names`` of TYPES, each on those of ``trials`` that are its own.

    epochs: by the published schedule, None: by the SHORTER one; values: further settings. Raises UserError where a type
    has no trial.
    """
    result = {}
    for name in names:
        kind, loss, split = TYPES[name]
        own = tuple(t for t in trials if t.name in SPLITS[split])
        if not own:
            raise Missing(f"--models {name}: none of its training records is here, or all of them are test trials")
        rate = 2e-5 if loss == "state" else 1e-4
        plan = {"batch": 512, "stride": 0.1, "rate": rate, "last_rate": rate, "epochs": epochs}
        if epochs is None:
            passes = STEPS * BATCH * EVERY / sum(t.duration for t in own)
            plan = {"batch": BATCH, "stride": EVERY, "rate": RATE, "last_rate": 2e-5, "epochs": max(1, round(passes))}
        sigma = tuple(pooled_sigma(own).tolist())
        result[name] = BlackBoxSettings(kind=kind, loss=loss, sigma=sigma, **NETWORK, **plan, **values), own
    return result


RESTARTED = ("random", "turn")
"""Parts of the names of runs that are restarted every 100 s (section 4); the others run in one piece."""


def table_9_errors(model: Simulator | Forecaster, trials: Sequence[Trial]) -> list[float]:
    """Eq. 25 of each of ``trials`` by the protocol of Table 9, with sigma of all of them; NaN where no run is whole."""
    sigma, result = pooled_sigma(trials), []
    for trial in trials:
        again = any(word in f"{trial.kind} {trial.name}".lower() for word in RESTARTED)
        windows, _ = predict(model, trial, PAPER_WINDOW if again else 0.0, PAPER_WINDOW)
        errors = [((w.error(trial.states) / sigma) ** 2).sum(axis=1) for w in windows]
        result.append(float(np.concatenate(errors).mean()) if errors else float("nan"))
    return result


TABLE_9 = {
    "captive": ((0.272,), (0.858,), (1.015,), (0.036,), (0.189,), (0.100,)),
    "type1": ((0.236, 0.003), (0.713, 0.011), (0.086, 0.063), (0.052, 0.024), (0.069, 0.014), (0.138, 0.023)),
    "type2": ((0.241, 0.005), (0.728, 0.017), (0.124, 0.141), (0.058, 0.031), (0.140, 0.101), (0.167, 0.053)),
    "type3": ((4834, 4041), (0.864, 0.100), (761.1, 1519), (634.8, 1264), (91.76, 124.6), (1.163, 0.617)),
    "type4": ((0.488, 0.022), (0.701, 0.019), (0.122, 0.054), (0.144, 0.053), (0.246, 0.107), (0.302, 0.062)),
    "type5": ((0.262, 0.007), (0.785, 0.024), (0.856, 0.288), (0.055, 0.030), (0.182, 0.047), (0.294, 0.043)),
}
"""Wakita et al. (2022), Table 9: mean and standard deviation over five seeds of Eq. 25, per record of TABLE_9_TEST."""
TABLE_9_TEST = ("Random", "Turning", "Zigzag", "Berthing1", "Berthing2", "Berthing3")
TABLE_9_NOTE = (
    "As published by Wakita et al. (2022, Table 9), not like for like: its six test records are not those tested here "
    "unless --test test names them; sigma is pooled over its own test set; only the random and the turning record are "
    "restarted every 100 s, the others run in one piece; a windowed network is given the first second as measured, "
    "here the one before it; weights were chosen by the loss on other data, here by 30 s windows of left-out runs."
)

"""Trainings by default: a missing force is learned, noise is not; steps of Adam, finished seeds that are kept."""

from __future__ import annotations

import json
import re
import subprocess
import sys
from dataclasses import asdict, replace
from pathlib import Path

import numpy as np
import pytest
import torch

import delivery.view
from fitting.nlp.windows import pieces_of
from fitting.solvers.control import Control, OutOfTimeError
from mmg.errors import BadValue
from mmg.rollout import Simulator
from mmg.ship import Ship
from residual.hybrid import HYBRID_KIND
from residual.pipeline import train
from residual.result import learning_plot
from residual.settings import TrainSettings, settings_from
from residual.train import Adam, load_outcome, save_outcome, tasks_of, train_one, training_store
from residual.windows import windows
from tests.residual.test_hybrid import QUICK
from tests.support import hybrids
from tests.support.colours import told_by_colour_alone

DEFAULT = replace(QUICK, penalty=TrainSettings().penalty, epochs=30, rate=3e-3)
"""A small network with the default penalty and rate."""


def error_on_fresh_runs(ship: Ship) -> float:
    """Mean square of the error of the turn rate over 30 s of runs that no training saw."""
    fresh = hybrids.trials(hybrids.lacking(), 2, 200, seed=9)
    batch = windows(pieces_of(fresh, 1.0, hybrids.ship().inputs), 1.0, 30, 15)
    assert batch is not None
    out = Simulator(ship, compiled=False).run(batch.targets[0].numpy(), batch.controls.numpy(), 1.0)[:, :6]
    return float(((out - batch.targets.numpy())[:, 5] ** 2).mean())


@pytest.mark.slow
def test_by_default_a_missing_force_is_learned_in_stages() -> None:
    """Each stage of the curriculum has its share of the epochs."""
    found = train(hybrids.ship(), hybrids.trials(hybrids.lacking()), settings=DEFAULT)
    assert found.decision and found.decision.kept and found.hybrid is not None
    truth = error_on_fresh_runs(hybrids.lacking())
    assert error_on_fresh_runs(found.hybrid) - truth < 0.5 * (error_on_fresh_runs(hybrids.ship()) - truth)
    lengths = [[step["rollout_s"] for step in row["history"]] for row in found.per_seed]
    assert lengths == [[0.0, *[10.0] * round(0.3 * DEFAULT.epochs), *[30.0] * round(0.7 * DEFAULT.epochs)]] * 2


@pytest.mark.slow
def test_by_default_noise_alone_is_declined() -> None:
    quiet = train(hybrids.ship(), hybrids.trials(hybrids.ship()), settings=replace(DEFAULT, seeds=1, epochs=4))
    assert quiet.decision and not quiet.decision.kept and quiet.ship.network is None
    assert quiet.network is not None, "what was declined can still be compared"


@pytest.mark.slow
def test_a_training_ends_when_its_stop_error_has_risen_by_a_tenth_of_its_fall() -> None:
    """Eq. 24 and 25 of Wakita et al. (2024), by the history: at a rate of learning that is far too high."""
    settings = replace(DEFAULT, seeds=1, epochs=60, rate=0.1, last_rate=0.1, penalty=0.0)
    task = tasks_of(HYBRID_KIND, hybrids.ship(), hybrids.trials(hybrids.lacking()), settings)[0]
    whole, early = (train_one(replace(task, settings=replace(task.settings, stop_after=k))) for k in (0, 5))
    errors = [row[3] for row in early.history]
    average, ends = errors[0], []
    for k, error in enumerate(errors[1:], 1):
        average, least = 0.9 * average + 0.1 * error, min(errors[: k + 1])
        ends += [k] if k >= 5 and average > least + 0.1 * (errors[0] - least) else []
    assert len(whole.history) == 61 and early.status == "finished"
    assert ends == [len(errors) - 1] and errors == [row[3] for row in whole.history][: len(errors)]


def test_a_limit_of_time_in_force_ends_a_training_and_its_store_stays(tmp_path: Path) -> None:
    trials = hybrids.trials(hybrids.ship(), 3, 150)
    settings = TrainSettings(seeds=2, epochs=10**6, step=1.0)
    store = training_store(tmp_path, hybrids.ship(), trials, (), settings)
    with Control.within(2.0).in_force(), pytest.raises(OutOfTimeError):
        train(hybrids.ship(), trials, (), settings, store=store)
    assert store.folder.is_dir()


def test_a_given_sigma_is_that_of_the_loss() -> None:
    settings = replace(DEFAULT, seeds=1, sigma=(1.0, 2.0, 3.0, 4.0, 5.0, 6.0))
    tasks = tasks_of(HYBRID_KIND, hybrids.ship(), hybrids.trials(hybrids.lacking()), settings)
    np.testing.assert_array_equal(tasks[0].scales.sigma, [1, 2, 3, 4, 5, 6])
    assert settings_from(json.loads(json.dumps(asdict(settings)))) == settings
    for sigma in ((1.0,) * 5, (1.0, 1.0, 1.0, 1.0, 1.0, 0.0)):
        with pytest.raises(BadValue):
            tasks_of(HYBRID_KIND, hybrids.ship(), hybrids.trials(hybrids.lacking()), replace(settings, sigma=sigma))


@pytest.mark.slow
def test_a_seed_that_was_kept_comes_back_to_the_last_bit(tmp_path: Path) -> None:
    trials = hybrids.trials(hybrids.lacking(), 3, 100)
    settings = replace(DEFAULT, seeds=1, epochs=1, width=4)
    found = train_one(tasks_of(HYBRID_KIND, hybrids.ship(), trials, settings)[0])
    store = training_store(tmp_path / "run", hybrids.ship(), trials, (), settings)
    store.open()
    save_outcome(store, found)
    again = load_outcome(store, 0)
    assert again is not None and again.seconds == found.seconds
    assert (again.before, again.after) == (found.before, found.after)
    np.testing.assert_array_equal(again.history, found.history)
    np.testing.assert_array_equal(again.judged, found.judged)
    assert all((again.state[name] == a).all() for name, a in found.state.items())


def losses(net: torch.nn.Module, x: torch.Tensor, skipped: bool) -> torch.Tensor:
    """A loss of which the last bias has no gradient where it is ``skipped``."""
    first, last = net[0], net[2]  # type: ignore[index]
    out = torch.nn.functional.linear(torch.tanh(first(x)), last.weight, None if skipped else last.bias)
    return (out - x.sum(dim=1, keepdim=True).sin()).square().mean()


def test_steps_are_those_of_torch_bit_for_bit() -> None:
    nets = []
    for _ in range(2):
        torch.manual_seed(3)
        nets.append(torch.nn.Sequential(torch.nn.Linear(4, 8), torch.nn.Tanh(), torch.nn.Linear(8, 1)).double())
    ours, theirs = Adam(nets[0].parameters()), torch.optim.Adam(nets[1].parameters(), lr=1e-2)
    for step in range(25):
        x = torch.randn(16, 4, dtype=torch.float64)
        theirs.param_groups[0]["lr"] = 1e-2 / (1 + step)
        for net in nets:
            net.zero_grad()
            losses(net, x, skipped=step % 3 == 0).backward()
        ours.step(1e-2 / (1 + step))
        theirs.step()
    assert all(torch.equal(a, b) for a, b in zip(nets[0].parameters(), nets[1].parameters(), strict=True))


MODULES = ("residual.settings", "residual.result", "fitting.calibrate")


@pytest.mark.slow
def test_reading_and_calibrating_need_no_torch_and_training_not_its_compiler() -> None:
    lines = [f"import {module}; assert 'torch' not in sys.modules, '{module}'" for module in MODULES]
    lines += ["import torch; from residual.train import Adam; p = torch.nn.Parameter(torch.ones(2)); o = Adam([p])"]
    lines += ["p.sum().backward(); o.step(0.1); assert p[0] < 1.0 and 'torch._dynamo' not in sys.modules"]
    done = subprocess.run([sys.executable, "-c", "\n".join(["import sys", *lines])], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr


# Figures of trainings, and lines of the interactive page, can be read in grey
def seeds(count: int) -> list[dict]:
    """Rows of trainings that went about the same way."""
    history = [{"epoch": k, "stop": 1.0 - 0.01 * k} for k in range(5)]
    pair = {"before": 1.0, "after": 0.97}
    row = {"history": history, "stop_window": pair, "judged_window": pair, "status": "finished"}
    return [row | {"seed": k} for k in range(count)]


@pytest.mark.parametrize("count", [1, 5])
def test_learning_curves_of_seeds_differ_in_their_dashes(count: int) -> None:
    figure = learning_plot(seeds(count))
    lines = [x for x in figure.axes[0].get_lines() if str(x.get_label()).startswith("seed")]
    assert len(lines) == count == len({str(x.__dict__["_unscaled_dash_pattern"]) for x in lines})
    assert told_by_colour_alone(figure) == []


@pytest.mark.parametrize("table", ["LOOKS", "ROLE_LOOKS"])
def test_lines_of_the_interactive_page_differ_in_their_dashes(table: str) -> None:
    text = (Path(delivery.view.__path__[0]) / "assets" / "data.js").read_text(encoding="utf-8")
    rows = re.search(rf"const {table} = \[(.*?)\n\];", text, re.DOTALL)
    assert rows
    dashes = re.findall(r"dash: (\[.*?\])", rows[1])
    assert len(dashes) >= 4 and len(set(dashes)) == len(dashes)

"""The part of ``mmg train`` that trains a black box."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from mmg_ident.commands.train_input import AGAIN, Order

if TYPE_CHECKING:
    from fitting.prediction.predict import Forecaster
    from mmg.rollout import Simulator


def train_box(order: Order, run: str) -> int:
    """Train a black box, score it beside the ship model of ``run``, write a run folder with its report; exit code."""
    import time

    from fitting.report.run_folder import RESULT, write_json
    from mmg.rollout import Simulator
    from mmg_ident.commands.fit_input import _leaks
    from mmg_ident.commands.output import print_json, say
    from mmg_ident.commands.train_hybrid import scores_of
    from residual.blackbox.models import BoxTraining
    from residual.blackbox.models import train_box as trained_on
    from residual.report.blackbox_run import result, write_box
    from residual.report.figures import write_figures
    from residual.report.page import write_report

    assert isinstance(order.settings, BoxTraining)
    trained = trained_on(order.ship, order.trials, order.settings, order.held_out, say, order.store)
    models: dict[str, Simulator | Forecaster] = {"ship model": Simulator(order.ship), "black box": trained.box}
    scores = scores_of(models, order.trials, order.held_out)
    content = result(trained, order.trials, order.held_out, scores, order.command, run)
    content["warnings"] += [*order.remarks, *_leaks(order.trials, order.held_out)]

    def decorate(folder: Path) -> None:
        shown = order.held_out or order.trials
        content["figures"] = write_figures(folder, content, models, shown, "untrained network")
        content["timings_s"]["wall"] = time.perf_counter() - order.began
        write_json(folder / RESULT, content)
        write_report([folder], folder / "report.html")

    write_box(order.out, trained, order.ship, content, decorate, order.store)
    if order.json:
        print_json(content)
        return 130 if trained.interrupted else 0
    for line in content["warnings"]:
        say(f"warning: {line}")
    for name, pair in scores.items():
        before, after = pair["before"], pair["after"]
        say(
            f"{name}: 30 s windows {after['window']:.4f} (ship model {before['window']:.4f}), "
            f"100 s restarts {after['paper']:.4f} ({before['paper']:.4f})"
        )
    if any(o.status == "stopped" for o in trained.outcomes) or len(trained.outcomes) < trained.settings.seeds:
        say(f"not all seeds came to their end: {AGAIN}")
    say(f"run folder: {order.out} (network.safetensors, report.html): mmg predict and mmg score take it")
    return 130 if trained.interrupted else 0

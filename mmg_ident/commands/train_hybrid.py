"""The part of ``mmg train`` that trains a residual on a calibrated ship."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from mmg_ident.commands.train_input import AGAIN, Order

if TYPE_CHECKING:
    from collections.abc import Sequence

    from cases.trial import Trial
    from fitting.prediction.predict import Forecaster
    from mmg.rollout import Simulator
    from residual.training.hybrid import Trained


def train_hybrid(order: Order) -> int:
    """Train, decide, score, write a run folder with its report, and tell; the exit code."""
    import time

    from fitting.report.run_folder import RESULT, write_json
    from mmg_ident.commands.fit_input import _leaks
    from mmg_ident.commands.output import print_json
    from residual.report.figures import write_figures
    from residual.report.hybrid_run import result, write_training
    from residual.report.page import write_report
    from residual.training.hybrid import train

    trained = train(order.ship, order.trials, order.settings, order.held_out, order.say, order.store)
    models = models_of(trained)
    scores = scores_of(models, order.trials, order.held_out)
    content = result(trained, "hybrid", order.trials, order.held_out, scores, order.command, order.base)
    content["warnings"] += [*order.remarks, *_leaks(order.trials, order.held_out)]
    content["warnings"] += _known_before(order.base, order.held_out)

    def decorate(folder: Path) -> None:
        content["figures"] = write_figures(folder, content, models, order.held_out or order.trials)
        content["timings_s"]["wall"] = time.perf_counter() - order.began
        write_json(folder / RESULT, content)
        write_report([folder], folder / "report.html")

    write_training(order.out, trained, content, decorate, order.store)
    if order.json:
        print_json(content)
    else:
        _summary(trained, content, order)
    return 130 if trained.interrupted else 0


def models_of(trained: Trained) -> dict[str, Simulator | Forecaster]:
    """Simulators by their names in figures: the calibrated ship, and with the residual, kept or not."""
    from mmg.rollout import Simulator

    ship = trained.ship.without_network()
    models: dict[str, Simulator | Forecaster] = {"calibrated ship": Simulator(ship)}
    if trained.network is not None:
        models["with residual"] = Simulator(ship.with_network(trained.network))
    return models


def scores_of(
    models: dict[str, Simulator | Forecaster], trials: Sequence[Trial], held_out: Sequence[Trial]
) -> dict[str, dict]:
    """Both metrics of models, "before" and "after", on training and validation trials with positions."""
    from fitting.prediction.score import pooled_sigma, score
    from fitting.report.run_folder import score_rows
    from mmg.errors import UserError

    result = {}
    for name, some in (("validation", held_out), ("training", trials)):
        placed = [t for t in some if t.has_position]
        try:
            sigma = pooled_sigma(placed) if placed else None
        except UserError:
            sigma = None
        if sigma is not None:
            result[name] = {
                when: score_rows(score(model, placed, sigma, f"the {name} trials"))
                for when, model in zip(("before", "after"), models.values(), strict=False)
            }
    return result


def _known_before(base: dict, held_out: Sequence[Trial]) -> list[str]:
    """A sentence on validation trials that the ship was calibrated on."""
    seen = {row.get("sha256") for row in base.get("data", [])}
    both = [t.name for t in held_out if t.sha256 and t.sha256 in seen]
    return [f"{', '.join(both)}: the ship was calibrated on it, so its score is not held out"] if both else []


def _summary(trained: Trained, content: dict, order: Order) -> None:
    """A few lines for a person."""
    say, out = order.say, order.out
    for line in content["warnings"]:
        say(f"warning: {line}")
    say(trained.decision.words)
    for name, pair in content["scores"].items():
        if "after" in pair:
            before, after = pair["before"], pair["after"]
            say(
                f"{name}, with the residual: 30 s windows {before['window']:.4f} -> {after['window']:.4f}, "
                f"100 s restarts {before['paper']:.4f} -> {after['paper']:.4f}"
            )
    if trained.network is not None and trained.decision.kept:
        du, dv, dr = trained.network.bound
        say(f"the residual never exceeds |du| {du:.3g}, |dv| {dv:.3g} m/s2, |dr| {dr:.3g} rad/s2, whatever the inputs")
    if any(o.status == "stopped" for o in trained.outcomes) or len(trained.outcomes) < trained.settings.seeds:
        say(f"not all seeds came to their end: {AGAIN}")
    say(f"run folder: {out} (ship.toml, {'network.safetensors, ' if trained.decision.kept else ''}report.html)")

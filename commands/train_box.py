"""The part of ``mmg train`` that trains a black box."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from cases.trial import Trial
    from mmg.ship import Ship
    from residual.train import Training


def train_box(
    ship: Ship,
    trials: Sequence[Trial],
    held_out: Sequence[Trial],
    settings: Training,
    remarks: Sequence[str],
    command: str,
    out: Path,
    json: bool,
) -> int:
    """Train, score and write a black box; the exit code."""
    from commands.fit_input import _leaks
    from commands.output import print_json, say
    from fitting.run import score_rows
    from fitting.score import pooled_sigma, score
    from residual.blackbox import BoxTraining
    from residual.blackbox import train_box as trained_on
    from residual.blackbox_run import result, write_box
    from residual.figures import write_figures

    assert isinstance(settings, BoxTraining)
    trained = trained_on(ship, trials, settings, held_out, say)
    scores = {}
    for name, some in (("validation", held_out), ("training", trials)):
        placed = [t for t in some if t.has_position]
        if placed:
            found = score(trained.box, placed, pooled_sigma(placed), f"the {name} trials")
            scores[name] = {"after": score_rows(found)}
    content = result(trained, trials, held_out, scores, command)
    content["warnings"] += [*remarks, *_leaks(trials, held_out)]

    def decorate(folder: Path) -> None:
        content["figures"] = write_figures(folder, {**content, "scores": {}}, "untrained network")

    write_box(out, trained, ship, content, decorate)
    if json:
        print_json(content)
        return 130 if trained.interrupted else 0
    for line in content["warnings"]:
        say(f"warning: {line}")
    for name, pair in scores.items():
        after = pair["after"]
        say(f"{name}: 30 s windows {after['window']:.4f}, 100 s restarts {after['paper']:.4f}")
    say(f"run folder: {out} (network.safetensors, result.json): mmg predict and mmg score take it")
    return 130 if trained.interrupted else 0

"""The residual of ``mmg demo``: what the calibrated ship still gets wrong, and whether that is worth a network."""

from __future__ import annotations

import time
from pathlib import Path

SEEDS, EPOCHS, WIDTH = 3, 12, 16
"""A small training of a few seconds."""


def demo_residual(folder: Path) -> dict | None:
    """Train on the trials and the run of a demo's folder, write ``folder``/residual, and tell the decision.

    Returns the decision as plain values; None, with a line, where torch is missing or nothing was decided.
    """
    from cases.io.read import read_trials
    from mmg.errors import UserError, needs_torch
    from mmg_ident.commands.output import say

    say("6. Learning a residual on the calibrated ship")
    try:
        needs_torch("the residual")
    except UserError as missing:
        say(f"   skipped: {missing}")
        return None
    from residual.pipeline import train
    from residual.settings import TrainSettings

    began = time.perf_counter()
    run, out = folder / "run", folder / "residual"
    trials, held_out = (read_trials([folder / "trials" / role]) for role in ("train", "held_out"))
    command = (
        f"mmg train {run} {folder / 'trials' / 'train'} --validate {folder / 'trials' / 'held_out'} "
        f"--seeds {SEEDS} --epochs {EPOCHS} --width {WIDTH} --out {out}"
    )
    try:
        settings = TrainSettings(seeds=SEEDS, epochs=EPOCHS, width=WIDTH)
        result = train(run, trials, held_out, settings, command=command)
        result.save(out)
    except UserError as error:
        say(f"   nothing was learned: {error}")
        return None
    content = result.to_dict()
    say(f"   {result.sentence}")
    say(f"   {time.perf_counter() - began:.1f} s; report: {out / 'report.html'}")
    return {"kept": content["kept"], **content["decision"]}

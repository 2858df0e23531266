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
    from cases.shipfiles.ship_file import load_ship
    from fitting.report.run_folder import read_result
    from mmg.errors import UserError
    from mmg_ident.commands.output import needs_torch, say
    from mmg_ident.commands.train_hybrid import train_hybrid
    from mmg_ident.commands.train_input import Order, settings_of, store_of

    say("6. Learning a residual on the calibrated ship")
    try:
        needs_torch("the residual")
    except UserError as missing:
        say(f"   skipped: {missing}")
        return None
    began = time.perf_counter()
    run, out = folder / "run", folder / "residual"
    trials, held_out = (read_trials([folder / "trials" / role]) for role in ("train", "held_out"))
    settings = settings_of(
        "hybrid", seeds=SEEDS, epochs=EPOCHS, width=WIDTH, workers=1, loss="state", augment="", jitter=0.0
    )
    ship, base = load_ship(run), read_result(run)
    store = store_of(out, False, "hybrid", settings, ship, trials, held_out)
    command = (
        f"mmg train {run} {folder / 'trials' / 'train'} --validate {folder / 'trials' / 'held_out'} "
        f"--seeds {SEEDS} --epochs {EPOCHS} --width {WIDTH} --out {out}"
    )
    order = Order(ship, trials, held_out, settings, base, (), command, out, False, store, began, lambda _: None)
    try:
        train_hybrid(order)
    except UserError as error:
        store.discard()
        say(f"   nothing was learned: {error}")
        return None
    content = read_result(out)
    from residual.report.words import headline

    say(f"   {headline(content)['sentence']}")
    say(f"   {time.perf_counter() - began:.1f} s; report: {out / 'report.html'}")
    return {"kept": content["kept"], **content["decision"]}

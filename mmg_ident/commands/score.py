"""``mmg score``: both metrics, side by side for several models."""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from typer import Argument, Option

from mmg.errors import Conflict, Missing, NoSolution, OutOfRange, TooFewData, UnknownName
from mmg.states import STATES
from mmg_ident.commands import options as o
from mmg_ident.commands import output as cli

if TYPE_CHECKING:
    from collections.abc import Mapping

    from fitting.prediction.score import RunErrors, Score, TrialScore, UnitErrors


def score(
    runs_and_trials: Annotated[
        list[str], Argument(help="Ships or run folders, then trials or folders of them.", metavar="SHIP... TRIAL...")
    ],
    sigma: Annotated[str | None, Option(help="Of x,y,psi,u,v,r, to divide errors by.")] = None,
    sigma_from: Annotated[list[Path] | None, Option(help="Trials with that sigma.", metavar="TRIAL...")] = None,
    method: Annotated[str, Option(help="Integration: rk4 or euler.")] = "rk4",
    adapt: Annotated[float | None, Option(help="Also with a past of so many s; default what a run says pays.")] = None,
    window: Annotated[float, Option(help="Of errors in units [s]; default 30, or 4 L/U of a large ship.")] = 0.0,
    campaign: o.Campaign = None,
    unchecked: o.Unchecked = False,
    json: o.Json = False,
) -> None:
    """Score models on trials: Eq. 25 of Wakita et al. (2022) with 100 s restarts, and 30 s windows every 15 s.

    Both are the mean squared error summed over x, y, psi, u, v, r, each divided by its sigma, by default pooled over
    the scored trials with the heading as stored. Beside them: rms errors by run in metres, degrees, m/s and deg/s, over
    windows that are longer for a large ship, and errors of advance, diameters and overshoots of the runs that are
    manoeuvres, predicted with the measured rudder. Models after the first are compared with it by run. With --adapt,
    and where the run folder of one of the models knows that the past of a window pays, every ship is scored twice:
    without and with the disturbance estimated from that past (see mmg predict), and models are compared with as much
    past as each other. A black box of mmg train --model fnn, rnn or rnn-window uses none, and has its own integration.

    Example: mmg score esso_osaka_3m runs/first held_out/*.csv
    """
    from dataclasses import replace

    from cases.io.campaigns import campaigns_taken
    from cases.shipfiles.ship_file import load_ship
    from cases.trial_set import TrialSet
    from fitting.prediction.score import past_to_use, pooled_sigma, window_for
    from fitting.prediction.score import score as scored
    from mmg.rollout import Simulator
    from mmg_ident.api import content_of, predictor

    models = list(dict.fromkeys(a for a in runs_and_trials if cli.is_model(a)))
    files = [a for a in runs_and_trials if not cli.is_model(a)]
    if not models and not Path(runs_and_trials[0]).exists():
        load_ship(runs_and_trials[0])  # for its error, which lists the ships
    if not models:
        raise Missing("no model named: give a ship of mmg ships, a ship file or a run folder before the trials")
    if not files:
        raise Missing("no trial named: give trial files, or a folder of them, after the models")
    if method not in ("rk4", "euler"):
        raise UnknownName(f"--method {method!r} is unknown; use rk4 or euler")
    cli.positive("--adapt", adapt, or_zero=True)
    cli.positive("--window", window, or_zero=True)
    if sigma and sigma_from:
        raise Conflict("--sigma and --sigma-from exclude each other")
    trials, others = cli.read_ready(files, sigma_from, unchecked=unchecked)
    loaded = {name: predictor(name) for name in models}
    ships = {name: model.ship for name, model in loaded.items() if isinstance(model, Simulator)}
    if sigma:
        import numpy as np

        values, origin = np.array(cli.numbers_of(sigma, 6, "--sigma")), "--sigma"
        if not (values > 0).all():
            raise OutOfRange("--sigma: all six numbers must be positive")
    elif sigma_from:
        values, origin = pooled_sigma(others), ", ".join(str(p) for p in sigma_from)
    else:
        values, origin = pooled_sigma(trials), "the scored trials"
    if campaign is not None:
        knowing = [ship for ship in ships.values() if ship.campaigns] or list(ships.values())
        if not knowing:
            raise UnknownName(f"--campaign {campaign}: no model named knows campaigns")
        trials = trials.said_campaign(campaign, knowing[0])
    # by the first ship: one window for all models, or their errors in units would not compare
    window = window or window_for(trials, next((ship.particulars["L"] for ship in ships.values()), None))
    scores = {}
    past = max(past_to_use(content_of(name), adapt)[0] for name in models)
    for name, simulator in cli.each(list(loaded.items()), "scoring"):
        scores[name] = scored(simulator, trials, values, origin, method, units=window)
        if past and name in ships:
            scores[f"{name} --adapt {past:g}"] = scored(simulator, trials, values, origin, method, past, window)
    taken = dict.fromkeys(message for ship in ships.values() for message in campaigns_taken(ship, trials))
    scores = {name: replace(s, notes=(*taken, *TrialSet.of(trials).remarks, *s.notes)) for name, s in scores.items()}
    if json:
        found = {"metric": METRIC, "method": method, "past_s": past, "worse": _worse_than_first(scores)}
        cli.print_json({"titles": {name: ship.title for name, ship in ships.items()}, "models": scores, **found})
    else:
        for name, ship in ships.items():
            if ship.mark:
                cli.say(f"{Path(name).name}: {ship.title}")
        _print(scores)
    for name, result in scores.items():  # both are failures, no results
        if result.diverged:
            names = ", ".join(result.diverged)
            raise NoSolution(f"{Path(name).name}: no score on {names}, the prediction diverges; see mmg check")
        if math.isnan(result.window):
            words = "no window of 30 s without missing samples is in these trials; give longer ones, or mend them"
            raise TooFewData(f"{Path(name).name}: no score, {words} (mmg check)")


METRIC = {
    "paper": "mean squared normalised error, Eq. 25 of Wakita et al. (2022), restart every 100 s",
    "window": "the same over full 30 s windows every 15 s, first row excluded",
    "units": "rms errors over windows of window_s, in units and as a share of what the states change by over a window",
}


def _print(scores: Mapping[str, Score]) -> None:
    """Everything about the ``scores`` of models, by name."""
    from cases.quantities import UNITS

    first = next(iter(scores.values()))
    rows = [
        (row.name, *(_cell(s.trials[i]) for s in scores.values()), str(row.windows))
        for i, row in enumerate(first.trials)
    ]
    rows.append(("all rows pooled", *map(_cell, scores.values()), ""))
    heads = ("trial", *(f"{Path(name).name}|n" for name in scores), "windows|n")
    cli.print_table(heads, rows, "100 s restarts (Eq. 25) | 30 s windows")
    _print_units({Path(name).name: s.units for name, s in scores.items() if s.units})
    words = ", ".join(f"{s} {v:.5g} {UNITS[s]}" for s, v in zip(STATES, first.sigma, strict=True))
    print(f"sigma from {first.sigma_from}: {words}")
    past = {Path(name).name: s.past_s for name, s in scores.items() if s.past_s}
    used = f"up to {max(past.values()):g} s by {', '.join(past)}; none by the others" if past else "none is used"
    print(f"past of a window: {used}")
    for note in dict.fromkeys(note for s in scores.values() for note in s.notes):
        of = [Path(name).name for name, s in scores.items() if note in s.notes]
        model = f" ({', '.join(of)})" if len(of) < len(scores) else ""
        print(f"note: {note}{model}")
    for line in _worse_than_first(scores):
        print(line)


def _cell(found: Score | TrialScore) -> str:
    """Both metrics of one trial or of all."""
    from fitting.prediction.score import NOTHING, in_words

    if math.isnan(found.paper) and math.isnan(found.window):
        return NOTHING
    return f"{in_words(found.paper)} | {in_words(found.window)}"


def _print_units(units: Mapping[str, UnitErrors]) -> None:
    """Errors in units by run, and those of the manoeuvring figures, of models by name."""
    if not units:
        return
    first = next(iter(units.values()))
    times = f", {first.ship_times:.1f} L/U" if first.ship_times else ""
    title = f"rms errors over {first.window_s:g} s windows{times}:\n"
    title += "position [m] | heading [deg] | u [m/s] | r [deg/s] | share of change [%]"
    rows = [(run.name, *(_units(u.runs[i]) for u in units.values())) for i, run in enumerate(first.runs)]
    rows.append(("all rows pooled", *(_units(u.pooled) for u in units.values())))
    cli.print_table(("trial", *(f"{name}|n" for name in units)), rows, f"\n{title}")
    rows = []
    for i, run in enumerate(first.runs):
        by_model = [{(m.title, f.figure): f for m in u.runs[i].maneuvers for f in m.figures} for u in units.values()]
        for title, figure in ((m.title, f) for m in run.maneuvers for f in m.figures):
            found = [figures.get((title, figure.figure)) for figures in by_model]
            cells = [f"{f.predicted:.3g} ({f.error:+.3g})" if f else "-" for f in found]
            measured = f"{figure.measured:.3g} {figure.unit}"
            rows.append((run.name, title, figure.figure.replace("_", " "), measured, *cells))
    if rows:
        heads = ("trial", "manoeuvre", "figure", "measured|n", *(f"{name}|n" for name in units))
        cli.print_table(heads, rows, "\nmanoeuvring figures, predicted with the measured rudder: error")


def _units(run: RunErrors) -> str:
    from fitting.prediction.score import NOTHING

    if not run.windows or not math.isfinite(run.position_m):
        return "diverges" if run.windows else NOTHING
    numbers = (run.position_m, run.heading_deg, run.u_m_s, run.r_deg_s, 100 * run.share_of_change)
    return " | ".join(f"{value:.3g}" for value in numbers)


def _worse_than_first(scores: Mapping[str, Score]) -> list[str]:
    """A line for each of the ``scores`` that is worse on some run than the first with as much past, which is itself
    compared with the first of all."""
    from fitting.prediction.score import ScorePair

    first, *others = scores
    lines = []
    for other in others:
        found, alike = scores[other], next(n for n, s in scores.items() if s.past_s == scores[other].past_s)
        name = first if alike == other else alike
        if runs := ScorePair(scores[name], found).worse_runs:
            words = f"worse than {Path(name).name} on {len(runs)} of {len(found.trials)} runs: {'; '.join(runs)}"
            lines.append(f"{Path(other).name}: {words}")
    return lines

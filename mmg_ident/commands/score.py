"""``mmg score``: both metrics, side by side for several models."""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from typer import Argument, Option

from mmg.errors import Conflict, Missing, NoSolution, OutOfRange, TooFewData, UnknownName
from mmg.states import STATES
from mmg_ident.commands import options as o
from mmg_ident.commands.output import each, is_model, numbers_of, print_json, print_table, say

if TYPE_CHECKING:
    from collections.abc import Mapping

    import numpy as np

    from cases.trial import Trial
    from fitting.prediction.score import Score, TrialScore
    from fitting.prediction.units import RunErrors
    from mmg.messages import Message
    from mmg.ship import Ship


def score(
    runs_and_trials: Annotated[
        list[str], Argument(help="Ships or run folders, then trials or folders of them.", metavar="SHIP... TRIAL...")
    ],
    sigma: Annotated[str | None, Option(help="Of x,y,psi,u,v,r, to divide errors by.")] = None,
    sigma_from: Annotated[list[Path] | None, Option(help="Trials with that sigma.", metavar="TRIAL...")] = None,
    method: Annotated[str, Option(help="Integration: rk4 or euler.")] = "rk4",
    adapt: Annotated[
        float | None,
        Option(help="Also with this past of a window [s], 0: not; default what a run folder says pays."),
    ] = None,
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

    from cases.checks import ready
    from cases.checks.trusted import remarks
    from cases.io.read import read_trials
    from cases.shipfiles.ship_file import load_ship
    from fitting.prediction.score import past_to_use, pooled_sigma
    from fitting.prediction.score import score as scored
    from fitting.prediction.units import window_for
    from mmg.rollout import Simulator
    from mmg_ident.api import content_of, predictor

    models = list(dict.fromkeys(a for a in runs_and_trials if is_model(a)))
    files = [Path(a) for a in runs_and_trials if not is_model(a)]
    if not models and not Path(runs_and_trials[0]).exists():
        load_ship(runs_and_trials[0])
    if not models:
        raise Missing("no model named: give a ship of mmg ships, a ship file or a run folder before the trials")
    if not files:
        raise Missing("no trial named: give trial files, or a folder of them, after the models")
    if method not in ("rk4", "euler"):
        raise UnknownName(f"--method {method!r} is unknown; use rk4 or euler")
    if adapt is not None and not (0 <= adapt < float("inf")):
        raise OutOfRange("--adapt must be 0 or a positive number of seconds")
    if not (0 <= window < float("inf")):
        raise OutOfRange(f"--window {window:g} must be 0 or a positive number of seconds")
    if sigma and sigma_from:
        raise Conflict("--sigma and --sigma-from exclude each other")
    trials, others = ready(read_trials(files), read_trials(sigma_from) if sigma_from else [], unchecked=unchecked)
    loaded = {name: predictor(name) for name in models}
    if sigma:
        import numpy as np

        values, origin = np.array(numbers_of(sigma, 6, "--sigma")), "--sigma"
        if not (values > 0).all():
            raise OutOfRange("--sigma: all six numbers must be positive")
    elif sigma_from:
        values, origin = pooled_sigma(others), ", ".join(str(p) for p in sigma_from)
    else:
        values, origin = pooled_sigma(trials), "the scored trials"
    if campaign is not None:
        trials = _said(trials, campaign, [s.ship for s in loaded.values() if isinstance(s, Simulator)])
    lengths = [s.ship.particulars["L"] for s in loaded.values() if isinstance(s, Simulator)]
    window = window or window_for(trials, lengths[0] if lengths else None)
    scores = {}
    past = max(past_to_use(content_of(name), adapt)[0] for name in models)
    for name, simulator in each(list(loaded.items()), "scoring"):
        scores[name] = scored(simulator, trials, values, origin, method, units=window)
        if past and isinstance(simulator, Simulator):
            scores[f"{name} --adapt {past:g}"] = scored(simulator, trials, values, origin, method, past, window)
    notes = [
        *_campaigns(loaded, trials),
        *remarks(trials),
        *(_worth(scores, loaded, read_trials(files), values, method) if remarks(trials) else ()),
    ]
    scores = {name: replace(s, notes=(*notes, *s.notes)) for name, s in scores.items()}
    if json:
        found = {n: s.to_dict() for n, s in scores.items()}
        titles = {n: s.ship.title for n, s in loaded.items() if isinstance(s, Simulator)}
        print_json(
            {"titles": titles, "metric": METRIC, "method": method, "past_s": past, "models": found,
             "worse": worse_than_first(scores)}
        )  # fmt: skip
    else:
        for model, simulator in loaded.items():
            if isinstance(simulator, Simulator) and simulator.ship.mark:
                say(f"{Path(model).name}: {simulator.ship.title}")
        print_scores(scores)
    _refuse_nan(scores)


def _said(trials: list[Trial], campaign: str, ships: list[Ship]) -> list[Trial]:
    """The ``trials`` as of the ``campaign``, which one of the ``ships`` at least must know."""
    from cases.io.campaigns import said_campaign

    knowing = [ship for ship in ships if ship.campaigns] or ships
    if not knowing:
        raise UnknownName(f"--campaign {campaign}: no model named knows campaigns")
    return said_campaign(trials, campaign, knowing[0])


def _campaigns(models: dict[str, Any], trials: list[Trial]) -> list[Message]:
    """Which campaigns' instruments the ``models`` take for the ``trials``, each message once."""
    from cases.io.campaigns import campaigns_taken
    from mmg.rollout import Simulator

    ships = [model.ship for model in models.values() if isinstance(model, Simulator)]
    return list(dict.fromkeys(message for ship in ships for message in campaigns_taken(ship, trials)))


def _worth(
    scores: dict[str, Score], models: dict[str, Any], trials: list[Trial], sigma: np.ndarray, method: str
) -> list[Message]:
    """What the stretches left out of ``scores`` were worth: the same scores with them, of the first of the models."""
    from cases.checks.trusted import as_they_are
    from fitting.prediction.score import in_words
    from fitting.prediction.score import score as scored
    from mmg.messages import Message

    name, simulator = next(iter(models.items()))
    kept = scored(simulator, as_they_are(trials), sigma, "", method)
    words = f"with what was left out {Path(name).name} has 30 s windows {in_words(kept.window)} instead of "
    words += f"{in_words(scores[name].window)}, 100 s restarts {in_words(kept.paper)} instead of "
    words += in_words(scores[name].paper)
    return [Message(f"{words} (--unchecked scores every row)", "left_out_worth")]


def _refuse_nan(scores: dict[str, Score]) -> None:
    """Raises UserError where a prediction diverges, and where no 30 s are scored: that is a failure, not a result."""
    for name, found in scores.items():
        if found.diverged:
            names = ", ".join(found.diverged)
            raise NoSolution(f"{Path(name).name}: no score on {names}, the prediction diverges; see mmg check")
        if math.isnan(found.window):
            raise TooFewData(
                f"{Path(name).name}: no score, no whole window of 30 s without missing samples is in these trials; "
                "give longer ones, or mend them (mmg check)"
            )


METRIC = {
    "paper": "mean squared normalised error, Eq. 25 of Wakita et al. (2022), restart every 100 s",
    "window": "the same over full 30 s windows every 15 s, first row excluded",
    "units": "rms errors over windows of window_s, in units and as a share of what the states change by over a window",
}


def print_scores(scores: Mapping[str, Score]) -> None:
    """Print everything about the ``scores`` of models, by name."""
    from cases.trial import UNITS

    first = next(iter(scores.values()))
    rows = [
        (row.name, *(_cell(s.trials[i]) for s in scores.values()), str(row.windows))
        for i, row in enumerate(first.trials)
    ]
    rows.append(("all rows pooled", *map(_cell, scores.values()), ""))
    heads = ("trial", *(f"{Path(name).name}|n" for name in scores), "windows|n")
    print_table(heads, rows, "100 s restarts (Eq. 25) | 30 s windows")
    _print_units(scores)
    words = ", ".join(f"{s} {v:.5g} {UNITS[s]}" for s, v in zip(STATES, first.sigma, strict=True))
    print(f"sigma from {first.sigma_from}: {words}")
    print(past_in_words(scores))
    for note in dict.fromkeys(note for s in scores.values() for note in s.notes):
        of = [Path(name).name for name, s in scores.items() if note in s.notes]
        model = f" ({', '.join(of)})" if len(of) < len(scores) else ""
        print(f"note: {note}{model}")
    for line in worse_than_first(scores):
        print(line)


def past_in_words(scores: Mapping[str, Score]) -> str:
    """How much of the past of a window the predictions of the ``scores`` used."""
    with_past = {Path(name).name: s.past_s for name, s in scores.items() if s.past_s}
    if not with_past:
        return "past of a window: none is used"
    return f"past of a window: up to {max(with_past.values()):g} s by {', '.join(with_past)}; none by the others"


def _cell(found: Score | TrialScore) -> str:
    """Both metrics of one trial or of all."""
    from fitting.prediction.score import in_words

    return f"{in_words(found.paper)} | {in_words(found.window)}"


def _print_units(scores: Mapping[str, Score]) -> None:
    """Errors in units by run, and those of the manoeuvring figures."""
    units = {Path(name).name: s.units for name, s in scores.items() if s.units}
    if not units:
        return
    first = next(iter(units.values()))
    times = f", {first.ship_times:.1f} L/U" if first.ship_times else ""
    title = f"rms errors over {first.window_s:g} s windows{times}: position | heading | u | r | share of change"
    rows = [(run.name, *(_units(u.runs[i]) for u in units.values())) for i, run in enumerate(first.runs)]
    rows.append(("all rows pooled", *(_units(u.pooled) for u in units.values())))
    print_table(("trial", *(f"{name} [m | deg | m/s | deg/s | %]|n" for name in units)), rows, f"\n{title}")
    rows = []
    for i, run in enumerate(first.runs):
        by_model = [{(m.title, f.figure): f for m in u.runs[i].maneuvers for f in m.figures} for u in units.values()]
        for maneuver in run.maneuvers:
            for figure in maneuver.figures:
                found = [figures.get((maneuver.title, figure.figure)) for figures in by_model]
                cells = [f"{f.predicted:.3g} ({f.error:+.3g})" if f else "-" for f in found]
                measured = f"{figure.measured:.3g} {figure.unit}"
                rows.append((run.name, maneuver.title, figure.figure.replace("_", " "), measured, *cells))
    if rows:
        heads = ("trial", "manoeuvre", "figure", "measured|n", *(f"{name}|n" for name in units))
        print_table(heads, rows, "\nmanoeuvring figures, predicted with the measured rudder: error")


def _units(run: RunErrors) -> str:
    if not run.windows:
        return "-"
    if not math.isfinite(run.position_m):
        return "diverges"
    numbers = (run.position_m, run.heading_deg, run.u_m_s, run.r_deg_s, 100 * run.share_of_change)
    return " | ".join(f"{value:.3g}" for value in numbers)


def worse_than_first(scores: Mapping[str, Score]) -> list[str]:
    """A line for each of the ``scores`` that is worse on some run than the first with as much past, which is itself
    compared with the first of all."""
    from fitting.prediction.score import ScorePair

    first, *others = scores
    lines = []
    for other in others:
        found, alike = scores[other], next(n for n, s in scores.items() if s.past_s == scores[other].past_s)
        name = first if alike == other else alike
        runs = ScorePair(scores[name], found).worse_runs
        if runs:
            words = f"worse than {Path(name).name} on {len(runs)} of {len(found.trials)} runs: {'; '.join(runs)}"
            lines.append(f"{Path(other).name}: {words}")
    return lines

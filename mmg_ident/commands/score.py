"""``mmg score``: both metrics, side by side for several models."""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from typer import Argument, Option

from mmg.errors import Conflict, Missing, NoSolution, OutOfRange, TooFewData, UnknownName
from mmg.motion.flow import STATES
from mmg_ident.commands import options as o
from mmg_ident.commands import output as cli

if TYPE_CHECKING:
    from collections.abc import Mapping

    from fitting.prediction.score import Score, TrialScore
    from fitting.prediction.unit_errors import RunErrors, StateErrors, UnitErrors


@o.options(Errors="window baseline sigma sigma_from")
def score(
    runs_and_trials: Annotated[
        list[str], Argument(help="Ships or run folders, then trials or folders of them.", metavar="SHIP... TRIAL...")
    ],
    sigma: Annotated[str | None, Option(help="Of x,y,psi,u,v,r, to divide errors by.")] = None,
    sigma_from: Annotated[list[Path] | None, Option(help="Trials with that sigma.", metavar="TRIAL...")] = None,
    method: Annotated[str, Option(help="Integration: rk4 or euler.")] = "rk4",
    adapt: Annotated[float | None, Option(help="Also with a past of so many s; default what a run says pays.")] = None,
    window: Annotated[float, Option(help="Of errors in units [s]; default 30, or 4 L/U of a large ship.")] = 0.0,
    baseline: Annotated[
        list[Path] | None, Option(help="Trials to fit a plain grey box to, scored too.", metavar="TRIAL...")
    ] = None,
    campaign: o.Campaign = None,
    unchecked: o.Unchecked = False,
    json: o.Json = False,
) -> None:
    """Score models on trials: rms errors in units, and the normalised metric of Wakita et al. (2022), Eq. 25.

    Errors of position, heading, u, v and r are told after one ship length of sailing and after 30 s (a large ship: 4
    L/U), with their ratio to those of keeping the velocities of the first row, which any model must beat, and with
    --baseline to those of a grey box of 18 coefficients that scipy fits to the trials given there, in seconds. A model
    that does not beat them says so first. By run they are rms over the windows, with errors of advance, diameters and
    overshoots of the runs that are manoeuvres, predicted with the measured rudder.

    The normalised metric is the mean squared error summed over x, y, psi, u, v, r, each divided by its sigma (by
    default pooled over the scored trials, heading as stored): 100 s restarts, and 30 s windows every 15 s. Models after
    the first are compared with it by run. With --adapt, and where the run folder of one of the models knows that the
    past of a window pays, every ship is scored twice: without and with the disturbance estimated from that past (see
    mmg predict), and models are compared with as much past as each other. A black box of mmg train --model fnn, rnn or
    rnn-window uses none, and has its own integration.

    Example: mmg score esso_osaka_3m runs/first held_out/*.csv --baseline trials/
    """
    from dataclasses import replace

    from cases.io.campaigns import campaigns_taken
    from cases.shipfiles.ship_file import load_ship
    from cases.trial_set import TrialSet, ready, shared_rows
    from fitting.prediction.baselines import fit_grey_box
    from fitting.prediction.score import past_to_use, pooled_sigma
    from fitting.prediction.score import score as scored
    from fitting.prediction.unit_errors import window_for
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
    trials, others, fitted = ready(files, sigma_from or (), baseline or (), unchecked=unchecked)
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
        # one that has none is asked only where all have none, for her own error
        with_campaigns = [ship for ship in ships.values() if ship.campaigns] or list(ships.values())
        if not with_campaigns:
            raise UnknownName(f"--campaign {campaign}: no model named knows campaigns")
        trials = trials.said_campaign(campaign, with_campaigns[0])
    # by the first ship: one window for all models, or their errors in units would not compare
    particulars = next((ship.particulars for ship in ships.values()), {})
    window = window or window_for(trials, particulars.get("L"))
    # the inputs are those of the first model, which all must have anyway to be scored on the same trials
    box = fit_grey_box(fitted, loaded[models[0]].inputs, particulars, window) if baseline else None
    scores = {}
    past = max(past_to_use(content_of(name), adapt)[0] for name in models)
    for name, simulator in cli.each(list(loaded.items()), "scoring"):
        for used in (None, past) if past and name in ships else (None,):  # a black box has no disturbance to estimate
            label = f"{name} --adapt {past:g}" if used else name
            scores[label] = scored(simulator, trials, values, origin, method, used, window, box)
    campaigns = dict.fromkeys(message for ship in ships.values() for message in campaigns_taken(ship, trials))
    remarks = (*campaigns, *shared_rows(fitted, trials), *TrialSet.of(trials).remarks)
    scores = {name: replace(s, notes=(*remarks, *s.notes)) for name, s in scores.items()}
    if json:
        titles = {name: ship.title for name, ship in ships.items()}
        how = {"metric": METRIC, "method": method, "past_s": past}
        judged = {"worse": _worse_than_first(scores), "defeats": _defeats(scores)}
        cli.print_json({"titles": titles, "models": scores, **how, **judged})
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


# Errors in units below which 0.1 mm/s are the last digit shown, which no log resolves. Set by hand: display.
SMALL = 0.01
METRIC = {
    "paper": "mean squared normalised error, Eq. 25 of Wakita et al. (2022), restart every 100 s",
    "window": "the same over full 30 s windows every 15 s, first row excluded",
    "units": "rms errors over windows of window_s, in units and as a share of what the states change by over a window",
}


def _defeats(scores: Mapping[str, Score]) -> list[str]:
    """A line for each of the ``scores`` of models, by name, that does not beat what any model must."""
    return [f"{Path(name).name} is {words}" for name, s in scores.items() if s.units for words in s.units.defeats()]


def _print(scores: Mapping[str, Score]) -> None:
    """Everything about the ``scores`` of models, by name."""
    from cases.quantities import UNITS

    for line in _defeats(scores):
        cli.print_wrapped("", line)
    units = {Path(name).name: s.units for name, s in scores.items() if s.units}
    if units:
        _print_units(units)
        _print_maneuvers(units)
    first = next(iter(scores.values()))
    rows = [
        (row.name, *(_cell(s.trials[i]) for s in scores.values()), str(row.windows))
        for i, row in enumerate(first.trials)
    ]
    rows.append(("all rows pooled", *map(_cell, scores.values()), ""))
    heads = ("trial", *(f"{Path(name).name}|n" for name in scores), "windows|n")
    cli.print_table(heads, rows, "\nnormalised: 100 s restarts (Eq. 25) | 30 s windows")
    words = ", ".join(f"{s} {v:.5g} {UNITS[s]}" for s, v in zip(STATES, first.sigma, strict=True))
    cli.print_wrapped("", f"sigma from {first.sigma_from}: {words}")
    past = {Path(name).name: s.past_s for name, s in scores.items() if s.past_s}
    used = f"up to {max(past.values()):g} s by {', '.join(past)}; none by the others" if past else "none is used"
    print(f"past of a window: {used}")
    for note in dict.fromkeys(note for s in scores.values() for note in s.notes):
        of = [Path(name).name for name, s in scores.items() if note in s.notes]
        model = f" ({', '.join(of)})" if len(of) < len(scores) else ""
        print(f"note: {note}{model}")
    for line in _worse_than_first(scores):
        print(line)


def _cell(score: Score | TrialScore) -> str:
    """Both metrics of one trial or of all."""
    from fitting.prediction.score import NOTHING, in_words

    if math.isnan(score.paper) and math.isnan(score.window):  # no window of either length is without a gap
        return NOTHING
    return f"{in_words(score.paper)} | {in_words(score.window)}"


def _print_units(units: Mapping[str, UnitErrors]) -> None:
    """Errors of models by name, in units: of all runs at each time, with their ratios, and of each run."""
    from fitting.prediction.score import NOTHING
    from fitting.prediction.unit_errors import REFERENCES, SHIP_LENGTH, STATE_ERRORS, ratios

    heads = [f"{state}|n" for state, _ in STATE_ERRORS.values()]
    first = max(units.values(), key=lambda errors: len(errors.seconds))  # of a black box no ship length is known
    every = {REFERENCES[name]: errors for name, errors in first.references.items()} | dict(units)
    for key, seconds in first.seconds.items():
        errors_of = {name: errors.pooled.after.get(key) for name, errors in every.items()}
        rows = [("", *(unit for _, unit in STATE_ERRORS.values()))]
        for name, errors in errors_of.items():
            rows.append((name, *_numbers(errors)))
            for rival in [] if name in REFERENCES.values() else REFERENCES.values():
                if errors and (other := errors_of.get(rival)):  # below 1: better than what any model must beat
                    rows.append((f"  / {rival}", *(f"{ratio:.2f}" for ratio in ratios(errors, other).values())))
        times = " (one ship length)" if key == SHIP_LENGTH else ""
        cli.print_table(("rms errors", *heads), rows, f"\nafter {seconds:.3g} s{times}")
    rows = [("", *(unit for _, unit in STATE_ERRORS.values()), "%")]
    for i, run in enumerate([*first.runs, first.pooled]):  # all models are scored on the same runs, in this order
        rows.append((run.name if run.windows else f"{run.name}: {NOTHING}", *[""] * 6))
        for name, scored in every.items() if run.windows else ():
            row = [*scored.runs, scored.pooled][i]
            rows.append((f"  {name}", *_numbers(row), f"{100 * row.share_of_change:.1f}" if row.scored else ""))
    times = f", {first.ship_times:.1f} L/U" if first.ship_times else ""
    title = f"\nover {first.window_s:g} s windows{times} (share: of what the states change by)"
    cli.print_table(("rms errors", *heads, "share|n"), rows, title)


def _numbers(errors: RunErrors | StateErrors | None) -> list[str]:
    """The errors of each state, or that a prediction diverges."""
    from fitting.prediction.unit_errors import STATE_ERRORS

    if errors is None:
        return ["-"] * len(STATE_ERRORS)
    numbers = [getattr(errors, key) for key in STATE_ERRORS]
    if not all(map(math.isfinite, numbers)):
        return ["diverges"] * len(numbers)
    return [f"{number:.3g}" if number >= SMALL else f"{number:.4f}" for number in numbers]


def _print_maneuvers(units: Mapping[str, UnitErrors]) -> None:
    """Errors of the manoeuvring figures of each run, of models by name."""
    rows = []
    for i, run in enumerate(next(iter(units.values())).runs):
        by_model = [{(m.title, f.figure): f for m in u.runs[i].maneuvers for f in m.figures} for u in units.values()]
        for maneuver in run.maneuvers:
            rows.append((f"{run.name}, {maneuver.title}", *[""] * (1 + len(units))))
            for figure in maneuver.figures:
                # a model that does not come to the event has no such figure
                predicted = [figures.get((maneuver.title, figure.figure)) for figures in by_model]
                cells = [f"{f.predicted:.3g} ({f.error:+.3g})" if f else "-" for f in predicted]
                what = f"  {figure.figure.replace('_', ' ')} [{figure.unit}]"
                rows.append((what, f"{figure.measured:.3g}", *cells))
    if rows:
        heads = ("figure", "measured|n", *(f"{name}|n" for name in units))
        cli.print_table(heads, rows, "\nmanoeuvring figures, predicted with the measured rudder (error)")


def _worse_than_first(scores: Mapping[str, Score]) -> list[str]:
    """A line for each of the ``scores`` that is worse on some run than the first with as much past, which is itself
    compared with the first of all."""
    from fitting.prediction.score import ScorePair

    first, *others = scores
    lines = []
    for other in others:
        score, alike = scores[other], next(n for n, s in scores.items() if s.past_s == scores[other].past_s)
        name = first if alike == other else alike
        if runs := ScorePair(scores[name], score).worse_runs:
            words = f"worse than {Path(name).name} on {len(runs)} of {len(score.trials)} runs: {'; '.join(runs)}"
            lines.append(f"{Path(other).name}: {words}")
    return lines

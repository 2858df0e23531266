"""``mmg predict``: open-loop windows from the measured state."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

from typer import Option

from mmg.errors import Conflict, NoSolution, TargetExists
from mmg_ident.commands import options as o
from mmg_ident.commands import output as cli


@o.options(Prediction="window stride adapt members campaign")
def predict(
    model: o.Ship,
    trials: o.Trials,
    out: Annotated[Path, Option(help="CSV file (one trial), or folder (NAME.csv for each).")],
    window: Annotated[float, Option(help="Window length [s]; 0 is the whole run.")] = 100.0,
    stride: Annotated[float | None, Option(help="Between window starts [s]; default the window.")] = None,
    adapt: Annotated[float | None, Option(help="Past of a window [s]; default what the run says pays.")] = None,
    members: Annotated[str, Option(help="By each member of an ensemble: ts-infinity or ts1.")] = "",
    campaign: o.Campaign = None,
    force: o.Force = False,
    unchecked: o.Unchecked = False,
    json: o.Json = False,
) -> None:
    """Predict open-loop windows of trials, each started from the measured state.

    A window shorter than --window is kept at the end of a run only when windows do not overlap. Rows carry the trial's
    own time stamps; the first row of a window is the measured state; psi is continuous (not wrapped). A run
    folder with prediction bands adds x_std ... r_std. The seconds before a window (never the window itself) give a
    current that fades and the state of the ship's lags, where that paid on trials that the run was not calibrated on,
    which it says; --adapt 0 turns it off, --adapt A uses A seconds whatever the run says. Of a hybrid it says which
    share of the predicted rows lies outside the range of the data that its network was trained on.

    --members predicts a hybrid or a black box by particles that follow the networks of its seeds, each its own
    (ts-infinity) or one drawn at every step (ts1): their mean, and as x_std ... r_std their spread, which is not the
    error of the prediction but what the trials leave open.

    Files that mmg check calls contradictory are refused. Every row is predicted, also those of broken stretches, which
    no score counts: it says which windows begin in one, as their measured state is not to be believed.

    Example: mmg predict runs/first held_out.csv --window 30 --stride 15 --out forecast.csv
    """
    from cases.io.campaigns import MEAN, TAKEN, campaigns_taken
    from cases.io.files import file_key
    from cases.shipfiles.network_file import is_black_box
    from cases.shipfiles.ship_file import load_ship
    from cases.trial import inside, spans_left_out
    from cases.trial_set import DOUBT, TrialSet, ready
    from fitting.prediction.predict import write_tables
    from fitting.prediction.score import past_to_use
    from mmg.messages import has_code
    from mmg_ident import api

    runs = TrialSet.of(trials)
    single = len(runs) == 1 and out.suffix.lower() == ".csv"
    if not single and out.suffix.lower() == ".csv":
        raise Conflict(f"--out {out}: {len(runs)} trials need a folder, not one CSV file")
    files = {run.name: out if single else out / f"{run.name}.csv" for run in runs}
    if len({file_key(name) for name in files}) < len(runs):
        raise Conflict("two trials have the same name (as files of Windows have it); rename one, or predict each alone")
    existing = [str(path) for path in files.values() if path.exists()]
    if existing and not force:
        raise TargetExists(f"{existing[0]}: exists already; choose another --out or add --force")
    (sound,) = ready(runs, unchecked=unchecked)  # says which rows no score would count; all rows are predicted
    ship = None if is_black_box(model) else load_ship(model)
    title = ship.title if ship else model
    if campaign is not None:
        runs = runs.said_campaign(campaign, ship or load_ship(model))
    predictions = api.predict(model, runs, window, stride, adapt, cli.progress(), unchecked, members)
    if all(p.diverged == len(p.windows) for p in predictions):
        raise NoSolution(f"{model}: every window diverges; nothing is written (see mmg check, and mmg score)")
    notes: list[str] = [*past_to_use(api.content_of(model), 0.0 if members else adapt)[1]]
    notes += [note for note in sound.remarks if has_code([note], DOUBT)]
    for p, trial in zip(predictions, sound, strict=True):
        left_out = inside(trial, spans_left_out(trial))  # rows (N,)
        if numbers := [str(w.number) for w in p.windows if left_out[w.first]]:
            words = f"{trial.name}: window(s) {', '.join(numbers)} begin in a broken stretch (mmg check)"
            notes.append(f"{words}, from a state that is not to be believed")
    # campaigns once for all trials, where each prediction has a note of its own
    notes += campaigns_taken(ship, runs) if ship else []
    notes += [note for p in predictions for note in p.notes if not (has_code([note], TAKEN) or has_code([note], MEAN))]
    write_tables({files[p.trial.name]: p.table for p in predictions})
    cli.say_notes(notes)
    counts, past = {p.trial.name: len(p.windows) for p in predictions}, predictions[0].past_s
    if json:
        outside = {p.trial.name: p.outside for p in predictions if p.outside is not None}
        content: dict[str, Any] = {"title": title, "files": {n: str(p) for n, p in files.items()}, "windows": counts}
        content |= {"past_s": past, "notes": notes}
        cli.print_json(content | ({"outside_envelope": outside} if outside else {}))
    else:
        how = f"with up to {past:g} s of past" if past else "without a past"
        cli.say(f"{sum(counts.values())} windows of {len(runs)} trial(s) by {title}, {how}, written to {out}")

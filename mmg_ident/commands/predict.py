"""``mmg predict``: open-loop windows from the measured state."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from typer import Option

from mmg.errors import Conflict, NoSolution, TargetExists
from mmg_ident.commands import options as o
from mmg_ident.commands.output import print_json, progress, say

if TYPE_CHECKING:
    from cases.trial import Trial
    from fitting.result import FitResult
    from mmg.ship import Ship
    from mmg_ident.prediction import Prediction


def predict(
    model: o.Ship,
    trials: o.Trials,
    out: Annotated[Path, Option(help="CSV file (one trial), or folder (NAME.csv for each).")],
    window: Annotated[float, Option(help="Window length [s]; 0 is the whole run.")] = 100.0,
    stride: Annotated[float | None, Option(help="Between window starts [s]; default the window.")] = None,
    adapt: Annotated[
        float | None,
        Option(help="Past of a window [s] that tells the disturbance, 0: none; default what the run folder says pays."),
    ] = None,
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

    Files that mmg check calls contradictory are refused. Every row is predicted, also those of broken stretches, which
    no score counts: it says which windows begin in one, as their measured state is not to be believed.

    Example: mmg predict runs/first held_out.csv --window 30 --stride 15 --out forecast.csv
    """
    from cases.checks import ready
    from cases.checks.trusted import DOUBT, remarks
    from cases.io.campaigns import MEAN, TAKEN, campaigns_taken, said_campaign
    from cases.io.files import file_key
    from cases.io.read import read_trials
    from cases.shipfiles.network_file import is_black_box
    from cases.shipfiles.ship_file import load_ship
    from fitting.prediction.predict import write_tables
    from fitting.prediction.score import past_to_use
    from mmg.messages import has_code
    from mmg_ident import api

    runs = read_trials(trials)
    single = len(runs) == 1 and out.suffix.lower() == ".csv"
    if not single and out.suffix.lower() == ".csv":
        raise Conflict(f"--out {out}: {len(runs)} trials need a folder, not one CSV file")
    files = {run.name: out if single else out / f"{run.name}.csv" for run in runs}
    if len({file_key(name) for name in files}) < len(runs):
        raise Conflict(
            "two trials have the same name (as files of Windows have it); rename one or predict them separately"
        )
    existing = [str(path) for path in files.values() if path.exists()]
    if existing and not force:
        raise TargetExists(f"{existing[0]}: exists already; choose another --out or add --force")
    (sound,) = ready(runs, unchecked=unchecked)
    known = _read_once(model)
    runs = said_campaign(runs, campaign, load_ship(model)) if campaign is not None else runs
    found = api.predict(known, runs, window, stride, adapt, progress())
    if all(p.diverged == len(p.windows) for p in found):
        raise NoSolution(f"{model}: every window diverges; nothing is written (see mmg check, and mmg score)")
    notes: list[str] = list(past_to_use(api.content_of(known), adapt)[1])
    notes += [note for note in remarks(sound) if has_code([note], DOUBT)]
    notes += [note for p, kept in zip(found, sound, strict=True) for note in _doubtful_starts(p, kept)]
    notes += campaigns_taken(load_ship(model), runs) if not is_black_box(model) else []
    notes += [note for p in found for note in p.notes if not (has_code([note], TAKEN) or has_code([note], MEAN))]
    write_tables({files[p.trial.name]: p.table for p in found})
    for note in notes:
        say(f"note: {note}")
    counts, past = {p.trial.name: len(p.windows) for p in found}, found[0].past_s
    if json:
        outside = {p.trial.name: p.outside for p in found}
        written = {
            "title": _title(known),
            "files": {n: str(p) for n, p in files.items()},
            "windows": counts,
            "past_s": past,
            "notes": notes,
        }
        print_json(written | ({"outside_envelope": outside} if any(v is not None for v in outside.values()) else {}))
    else:
        how = f"with up to {past:g} s of past" if past else "without a past"
        say(f"{sum(counts.values())} windows of {len(runs)} trial(s) by {_title(known)}, {how}, written to {out}")


def _read_once(model: str) -> str | Ship | FitResult:
    """The ship or calibration that ``model`` names, its name where it is a training."""
    from cases.shipfiles.network_file import is_black_box
    from cases.shipfiles.ship_file import load_ship
    from fitting.report.run_folder import RESULT, described_in
    from fitting.result import FitResult
    from mmg.ship import Ship
    from mmg_ident.api import load_run

    if is_black_box(model):
        return model
    folder = described_in(Path(model))
    run = load_run(folder) if (folder / RESULT).exists() else load_ship(model)
    return run if isinstance(run, (FitResult, Ship)) else model


def _title(model: str | Ship | FitResult) -> str:
    """What the ``model`` is called: of a ship her calibration."""
    from cases.shipfiles.network_file import is_black_box
    from cases.shipfiles.ship_file import load_ship

    if isinstance(model, str):
        return model if is_black_box(model) else load_ship(model).title
    return model.ship.title if hasattr(model, "ship") else model.title


def _doubtful_starts(found: Prediction, kept: Trial) -> list[str]:
    """A note on the windows of ``found`` that begin in a stretch that is left out of the trial ``kept``."""
    from cases.io.leave_out import inside, spans_left_out

    rows = inside(kept, spans_left_out(kept))
    begun = [str(w.number) for w in found.windows if rows[w.first]]
    words = f"{kept.name}: window(s) {', '.join(begun)} begin in a broken stretch (mmg check), from a state that is not"
    return [f"{words} to be believed"] if begun else []

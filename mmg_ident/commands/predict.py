"""``mmg predict``: open-loop windows from the measured state."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer


def predict(
    model: Annotated[str, typer.Argument(help="Ship or run folder.")],
    trials: Annotated[list[Path], typer.Argument(help="Trial files, or folders of them.")],
    out: Annotated[Path, typer.Option("--out", help="CSV file (one trial) or folder (NAME.csv for each).")],
    window: Annotated[float, typer.Option("--window", help="Window length [s]; 0 is the whole run.")] = 100.0,
    stride: Annotated[
        float | None, typer.Option("--stride", help="Seconds between window starts; default the window length.")
    ] = None,
    adapt: Annotated[
        float,
        typer.Option("--adapt", help="Seconds before each window that may tell of the run's disturbance; 0: none."),
    ] = 0.0,
    force: Annotated[bool, typer.Option("--force", help="Overwrite existing files.")] = False,
    json: Annotated[bool, typer.Option("--json", help="Print what was written as JSON.")] = False,
) -> None:
    """Predict open-loop windows of trials, each started from the measured state.

    A window shorter than asked is kept at the end of a run only when windows do not overlap. Rows carry the trial's
    own time stamps; the first row of a window is the measured state; psi is continuous (not wrapped). A run
    folder that knows how far its predictions are off adds x_std ... r_std. With --adapt, the seconds before a window
    (never the window itself) give a current that fades and what the ship's lags remember. Of a hybrid it says which
    share of the predicted rows lies outside the range of the data that its network was trained on.

    Example: mmg predict runs/first held_out.csv --window 30 --stride 15 --out forecast.csv
    """
    from cases.io.read import read_trials
    from fitting.prediction.adaptation import Adaptation, warnings_on_adaptation
    from fitting.prediction.bands import bands_of
    from fitting.prediction.predict import predict as windows_of
    from fitting.prediction.predict import prediction_rows, write_tables
    from fitting.prediction.training_range import outside_share
    from mmg.errors import UserError
    from mmg.rollout import Simulator
    from mmg_ident.commands.output import known_of, predictor, print_json, say

    if not (0 <= adapt < float("inf")):
        raise UserError("--adapt must be 0 or a positive number of seconds")
    if not window >= 0 or (stride is not None and not stride > 0):
        raise UserError("--window must be 0 or positive and --stride positive")
    step = stride or (window if window > 0 else 1.0)
    runs = read_trials(trials)
    single = len(runs) == 1 and out.suffix.lower() == ".csv"
    if not single and out.suffix.lower() == ".csv":
        raise UserError(f"--out {out}: {len(runs)} trials need a folder, not one CSV file")
    files = {run.name: out if single else out / f"{run.name}.csv" for run in runs}
    if len(files) < len(runs):
        raise UserError("two trials have the same name; rename one or predict them separately")
    existing = [str(path) for path in files.values() if path.exists()]
    if existing and not force:
        raise UserError(f"{existing[0]}: exists already; choose another --out or add --force")
    simulator = predictor(model)
    ship = simulator.ship if isinstance(simulator, Simulator) else None
    if adapt and not ship:
        raise UserError(f"--adapt: {model} is a black box, whose disturbance cannot be estimated; leave it out")
    known = known_of(model)
    bands = bands_of(known, ship) if ship else None
    past = Adaptation.of(ship, adapt) if adapt and ship else None
    notes: list[str] = [*warnings_on_adaptation(known)] if adapt else []
    tables, counts, outside = {}, {}, {}
    for run in runs:
        found, remarks = windows_of(
            simulator, run, window, step, short_last=window <= 0 or step >= window, adaptation=past, bands=bands
        )
        notes += remarks
        if not run.has_position:
            notes.append(f"{run.name}: no measured position; each window starts at x = y = 0")
        if not run.has_wind:
            notes.append(f"{run.name}: no wind columns; calm air is assumed")
        tables[files[run.name]] = prediction_rows(run, found)
        counts[run.name] = len(found)
        outside[run.name] = outside_share(simulator, run, found) if isinstance(simulator, Simulator) else None
        if outside[run.name]:
            notes.append(f"{run.name}: {outside[run.name]:.1%} of the rows lie outside the data the network knows")
    if not any(counts.values()):
        raise UserError(f"no window could be predicted; {'; '.join(notes) or 'the trials are shorter than --window'}")
    write_tables(tables)
    for note in notes:
        say(f"note: {note}")
    if json:
        written = {"files": {n: str(p) for n, p in files.items()}, "windows": counts, "notes": notes}
        print_json(written | ({"outside_envelope": outside} if ship and ship.network else {}))
    else:
        say(f"{sum(counts.values())} windows of {len(runs)} trial(s) written to {out}")

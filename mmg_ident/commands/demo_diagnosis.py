"""The last part of ``mmg demo``: a second campaign with an effect that nobody mentioned, and its diagnosis."""

from __future__ import annotations

from pathlib import Path
from typing import Any


def demo_diagnosis(folder: Path, seed: int) -> dict[str, Any]:
    """Simulate the campaign, diagnose it with the calibrated ship of ``folder``/run, write ``folder``/diagnosis."""
    from cases.io.read import read_trials
    from cases.shipfiles.ship_file import load_ship
    from cases.simulation.demo_trials import SECRET, demo_trials
    from cases.simulation.simulate import write_trial
    from diagnosis.diagnose import DiagnosisOptions, diagnose
    from mmg_ident.commands.output import say

    say("7. A second campaign, a year later: what is different?")
    made = dict(zip(("train", "test"), demo_trials(seed + 1000, effects=[SECRET]), strict=True))
    for role, trials in made.items():
        (folder / "second" / role).mkdir(parents=True)
        for trial in trials:
            write_trial(trial, folder / "second" / role / f"{trial.name}.csv")
    train, test = (read_trials([folder / "second" / role]) for role in made)
    command = f"mmg diagnose {folder / 'run'} {folder / 'second' / 'train'} --test {folder / 'second' / 'test'}"
    options, ship = DiagnosisOptions(seed=seed, command=command), load_ship(folder / "run" / "ship.toml")
    found = diagnose(ship, train, test, options=options, calibrated_on=folder / "run")
    found.save(folder / "diagnosis")
    say(f"   {found.sentence}")
    say(f"   (the truth behind it: {SECRET})")
    say(f"   Report: {folder / 'diagnosis' / 'report.html'}")
    content = found.to_dict()
    return {k: content[k] for k in ("verdict", "effects", "equivalence_class", "sentence")}

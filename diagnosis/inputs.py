"""What a diagnosis goes by, looked at first: options, test trials that are none, what the ship was calibrated on."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from cases.evidence.kinematics import Kinematics, consistency
from cases.inputs import assumed
from cases.io.campaigns import Groups, ship_in
from cases.io.read import read_trials
from cases.io.site import Site, read_site
from cases.shipfiles.effects import without_suspects
from cases.shipfiles.ship_file import load_ship
from cases.trial import Trial
from cases.trial_set import TrialSet
from diagnosis.estimation.candidates import FITTED_ALONG
from fitting.report.run_folder import (
    RESULT,
    SHIP,
    content_on,
    of_predictions,
    trial_rows,
)
from fitting.settings import setting
from mmg.errors import UserError, refusing
from mmg.messages import Message
from mmg.ship import Ship


@refusing
@dataclass(frozen=True)
class DiagnosisOptions:
    """How to diagnose.

    command: the words by which result.json says how it was made.
    """

    step: float | None = setting(None, "Step [s]; default 0.05 L/U.", gt=0, lt=60)
    seed: int = setting(0, "Seed of drawn probabilities and intervals.")
    workers: int = setting(1, "Processes over which tasks are spread.", ge=1)
    command: str = "mmg_ident.diagnose"
    between: str | None = setting(None, "What differs between: day, month, year, folder, group, kind.")
    time_limit: float | None = setting(None, "Limit of the diagnosis [s].", gt=0)


def parted(
    trials: Sequence[Trial], tests: Sequence[Trial], between: str | None = None
) -> tuple[TrialSet, list[Trial], list[Message]]:
    """The ``trials`` to diagnose by, those to check on, and messages on those whose role in trials.toml decides.

    trials with the role test or validate take no part and are checked on with the ``tests``; where groups are compared
    ``between`` roles, all take part. Raises UserError where none is left to diagnose by.
    """
    trials = TrialSet.of(trials)
    if between == "role":
        return trials, list(tests), []
    kept, held_out, messages = trials.by_role("diagnosed by")
    return kept, [*tests, *held_out], messages


def diagnosable(ship: Ship) -> tuple[Ship, list[str]]:
    """The ``ship`` without its learned residual, and remarks on it."""
    remarks: list[str] = []
    if ship.network is not None:
        ship = ship.without_network()
        words = "the learned residual is left out: the diagnosis is to explain what it learned"
        remarks.append(Message(words, "network_left_out"))
    if not any(c.prior_std is not None for c in ship.coefficients.values()):
        words = (
            f"{ship.name} was not calibrated: its coefficients are fitted here, from the priors that it states, and "
            "what these allow is not called a gap"
        )
        remarks.append(Message(words, "not_calibrated"))
    return ship, remarks


def independent_tests(train: Sequence[Trial], tests: Sequence[Trial]) -> tuple[list[Trial], list[Message]]:
    """The ``tests`` that share no rows with the training trials ``train``, and sentences on those left out."""
    if not tests:
        return [], []
    hashes, remarks, kept = {t.sha256: t.name for t in train if t.sha256}, list[Message](), list[Trial]()
    # of each test the first of the training trials
    copies = {j: train[i].name for i, j in reversed(TrialSet((*train, *tests)).sharing) if i < len(train)}
    for number, t in enumerate(tests, start=len(train)):
        if name := copies.get(number) or hashes.get(t.sha256):
            words = f"{t.name} shares rows with {name}, so it is no test and was left out of the check"
            remarks.append(Message(words, "shared_rows"))
        else:
            kept.append(t)
    if not kept:
        remarks.append(Message("no test trial is left: how far the gap closes was not checked", "no_test_left"))
    return kept, remarks


@dataclass(frozen=True)
class CalibrationTrials:
    """What a ship was calibrated on. other: on none of the trials of the diagnosis; reference: the trials, if they are
    others and can be read as they were; remarks: sentences."""

    other: bool = False
    reference: tuple[Trial, ...] = ()
    remarks: tuple[str, ...] = ()


def calibration_trials(
    ship: Ship, trials: Sequence[Trial], calibrated_on: Path | str | Sequence[Trial] | None
) -> CalibrationTrials:
    """What is known of the calibration behind ``ship`` and whether ``trials`` took part in it.

    calibrated_on: the trials of the calibration, or the folder that ``mmg fit`` wrote; a folder without result.json
    tells nothing. Its trials are a reference only for the model that was calibrated on them. Trials that share rows
    with them, under whatever name, took part.
    """
    if calibrated_on is None:
        return CalibrationTrials()
    if not isinstance(calibrated_on, (str, Path)):
        if len(independent_tests(trials, calibrated_on)[0]) < len(calibrated_on):
            return CalibrationTrials()
        return CalibrationTrials(bool(calibrated_on), tuple(calibrated_on), _faults(ship, calibrated_on))
    folder = Path(calibrated_on)
    if not (folder / RESULT).exists():
        return CalibrationTrials()
    rows = [row for row in trial_rows(folder) if row.get("sha256")]
    hashes = {row["sha256"] for row in rows}
    if not rows or {t.sha256 for t in trials} & hashes:
        return CalibrationTrials()
    known = "the ship was calibrated on other trials: its estimates and standard errors are the priors"
    fitted = load_ship(folder / SHIP)
    if (dict(fitted.components), fitted.effects) != (dict(ship.components), ship.effects):
        return CalibrationTrials(True, (), (Message(known, "calibrated_elsewhere"),))
    paths = [Path(row["path"]) for row in rows if row.get("path")]
    try:
        old = read_trials([p for p in paths if p.is_file()])
    except UserError:
        old = []
    same = [t for t in old if t.sha256 in hashes]
    if len(independent_tests(trials, same)[0]) < len(same):
        return CalibrationTrials()
    if len(same) < len(rows):
        words = f"{known}; they cannot be read as they were, so they are no reference for their usual misfit"
        return CalibrationTrials(True, (), (Message(words, "calibration_trials_missing"),))
    return CalibrationTrials(True, tuple(same), _faults(ship, same))


@dataclass(frozen=True)
class Case:
    """What a diagnosis goes by.

    ship: with her priors; trials: to diagnose by; tests: to check on; place: what is known of it; calibration: what the
    ship was calibrated on; groups: of the trials, to be compared (None: not asked); remarks: messages on all of these.
    """

    ship: Ship
    trials: TrialSet
    tests: Sequence[Trial] = ()
    place: Site = field(default_factory=lambda: Site({}, {}))
    calibration: CalibrationTrials = CalibrationTrials()
    groups: Groups | None = None
    remarks: tuple[str, ...] = ()

    @property
    def sensors(self) -> Kinematics:
        """What the columns of the trials say of one another."""
        return consistency(self.trials, self.ship)


def case_of(
    ship: Ship,
    trials: Sequence[Trial],
    tests: Sequence[Trial],
    site: Site | Path | None,
    between: str | None,
    calibrated_on: Path | str | Sequence[Trial] | None,
) -> Case:
    """What a diagnosis goes by. ship, trials, tests, site, calibrated_on: as given to ``diagnose``; between: the groups
    to compare, as of ``DiagnosisOptions``. Raises UserError for input from which nothing can be concluded."""
    trials, tests, by_role = parted(trials, tests, between)
    trials, copies = trials.moving("diagnose").once
    groups = trials.groups(between) if between else None
    ship, of_campaign = ship_in(ship, trials)
    ship, remarks = diagnosable(ship)
    place = site if isinstance(site, Site) else read_site(trials, ship, site)
    tests, shared = independent_tests(trials, tests)
    calibration = calibration_trials(ship, trials, calibrated_on)
    ship = without_suspects(ship, surroundings_only=calibration.other)
    every = TrialSet((*trials, *tests))
    remarks += [*of_campaign, *every.remarks, *by_role, *copies, *shared, *calibration.remarks, *place.notices]
    remarks += assumed(every, ship.inputs)
    return Case(ship, trials, tests, place, calibration, groups, tuple(remarks))


def told_of_predictions(ship: Ship, calibrated_on: Path | str | Sequence[Trial] | None) -> dict[str, Any]:
    """What the calibration behind ``ship`` tells of predictions by her; nothing for a model of other components.

    calibrated_on: as of ``calibration_trials``; trials tell nothing.
    """
    if not isinstance(calibrated_on, (str, Path)) or not (content := content_on(Path(calibrated_on))):
        return {}
    same = dict(load_ship(calibrated_on).components) == dict(ship.components)
    return of_predictions(content) if same else {}


def _faults(ship: Ship, trials: Sequence[Trial]) -> tuple[Message, ...]:
    """What columns of the ``trials`` of a calibration contradict each other, but for the usual lags and gains."""
    if not trials:
        return ()
    seen = consistency(trials, ship)
    words = [r.sentence for r in seen.found if r.effect not in FITTED_ALONG]
    words += [f"{run.name}: {fault}" for run in seen.runs for fault in run.faults]
    return tuple(Message(f"the trials of the calibration: {w}", "fault_in_calibration") for w in words)

"""From raw logs to a calibrated ship, her figures and an FMU: what ``mmg start`` does, step by step.

A step is left out where the folder holds what it makes, so that the same call goes on where one ended. ``answers.toml``
there says what was asked, answered, assumed and measured. It is made first, with the digest of the logs and the ship
alone, so that nothing is taken for the trials of a call that others put there.
"""

from __future__ import annotations

import hashlib
import math
import shutil
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Literal

from pydantic import Field, field_validator

from cases.criteria.own_rates import MEASURED, with_own_rates
from cases.io.files import file_hash, replace_text
from cases.io.read import read_trials, trial_files
from cases.io.sidecar import NAME as SIDECAR
from cases.io.site import NAME as SITE
from cases.io.toml_file import Section, number, read_toml, validated
from cases.shipfiles.effects import freeing_effects
from cases.shipfiles.new_ship import new_ship, parse_particulars
from cases.shipfiles.ship_file import dump_ship, load_ship
from cases.trial import Trial
from fitting.calibrate import FitOptions
from fitting.result import FitResult, read_fit
from mmg.components.coefficients import PARTICULARS
from mmg.errors import Conflict, Missing, TargetExists, UserError, name_fault, writing
from mmg.messages import OnProgress
from mmg.ship import Ship

ANSWERS, TRIALS, RUN, FMU = "answers.toml", "trials", "run", "ship.fmu"  # What the folder holds
TOML_HEAD = "What mmg start was told and what it found. The answers can be given to another call with --answers."


class Answers(Section):
    """What a person knows of trials and ship. ``record`` is written by ``mmg start`` and not read.

    antenna: where positions and velocities were measured, from midship, ahead and to starboard; draught: at the trials,
    None for that of the particulars; depth: of the water; current: none, one in all runs, one in each, or
    unknown, where one that the trials speak for is fitted along; rudder_rate: that the trials show, or a number.
    """

    antenna: Literal["unknown"] | list[float] = "unknown"
    draught: float | None = number("m", None, gt=0.0, le=50.0)
    depth: Literal["deep"] | float = "deep"
    current: Literal["unknown", "none", "steady", "per run"] = "unknown"
    rudder_rate: Literal["measured"] | float = "measured"
    record: dict[str, Any] = Field(default_factory=dict)

    @field_validator("antenna")
    @classmethod
    def _pair(cls, value: Any) -> Any:
        # 600 m: longer than any ship, so that a place on the globe or in millimetres is refused
        if value != "unknown" and (len(value) != 2 or max(map(abs, value)) > 600):
            raise ValueError('antenna must be "unknown" or two numbers [m] ahead and to starboard of midship, to 600')
        return value

    @field_validator("depth", "rudder_rate")
    @classmethod
    def _positive(cls, value: Any) -> Any:
        if not isinstance(value, str) and not 0 < value < 12_000:  # [m], deeper than any sea
            raise ValueError("must be a positive number (depth [m], rudder_rate [deg/s])")
        return value

    @property
    def given(self) -> dict[str, Any]:
        """The answers by name."""
        return self.model_dump(exclude={"record"})

    @property
    def is_asked(self) -> bool:
        """Whether these are the answers of a folder, not only its mark."""
        return "asked" in self.record


@dataclass(frozen=True)
class StartedRun:
    """What there is before the fit. folder; ship: as the answers make her; trials; answers; asked: names of those that
    a person gave."""

    folder: Path
    ship: Ship
    trials: tuple[Trial, ...]
    answers: Answers
    asked: tuple[str, ...] = ()


def read_answers(path: Path) -> Answers:
    """The answers in the file at ``path``. Raises UserError for a file that is none."""
    return validated(Answers, read_toml(path), str(path))


def starting_ship(ship: str | None, particulars: str | None, draught: float | None = None) -> Ship:
    """The ship of the library, of a file, or from main ``particulars`` such as "120,19,7,0.72,D_P=4.8" [SI]; draught:
    at the trials [m]. Raises UserError unless one of both is given."""
    if (ship is None) == (particulars is None):
        raise Missing("give --ship SHIP, or --particulars L,B,d,C_b[,NAME=VALUE] in SI units, one of them")
    if ship is not None:
        if draught:
            raise Conflict(f"draught {draught:g} m: that of --ship {ship} stands in her file; give --particulars")
        return load_ship(ship)
    values = parse_particulars(str(particulars).replace(",", " ").split())
    return new_ship("own_ship", {**values, "d": draught} if draught else values)


def are_trials(logs: Sequence[Path]) -> bool:
    """Whether the ``logs`` are trial files already, which are taken as they are."""
    try:
        read_trials(logs)
    except UserError:
        return False
    return True


def copy_trials(logs: Sequence[Path], folder: Path) -> None:
    """Copies the trial files ``logs`` and the sidecars beside them into a new ``folder``, by the folders that they come
    from."""
    files = trial_files(logs)
    parents = list(dict.fromkeys(path.parent for path in files))
    names = [parent.name or "trials" for parent in parents]
    if len(set(names)) < len(names):  # day1/a and day2/a: their files may share names
        names = [f"{number}_{name}" for number, name in enumerate(names, 1)]
    scratch = folder.with_name(f".{folder.name}")  # renamed when whole: a folder of trials is one that can be fitted
    shutil.rmtree(scratch, ignore_errors=True)
    for parent, name in zip(parents, names, strict=True):
        place = scratch if len(parents) == 1 else scratch / name
        place.mkdir(parents=True, exist_ok=True)
        sidecars = [parent / SIDECAR, parent / SITE]
        for path in [*(p for p in files if p.parent == parent), *(p for p in sidecars if p.is_file())]:
            shutil.copy2(path, place / path.name)
    scratch.rename(folder)


def digest(logs: Sequence[Path], ship: Ship) -> str:
    """What tells one set of ``logs`` and one starting ``ship`` from others."""
    files = sorted(f for path in logs for f in ([path] if path.is_file() else path.rglob("*")) if f.is_file())
    words = [*(file_hash(path) for path in files), dump_ship(ship)]
    return hashlib.sha256("\n".join(words).encode()).hexdigest()


def check_folder(folder: Path, mark: str, given: Answers | None = None) -> Answers | None:
    """The answers of a ``folder`` that was begun; None of a new one. Raises UserError for one that holds something
    else, or the start of other logs, of another ship or with other answers than ``mark``, as of ``digest``, and
    ``given``."""
    if not (folder / ANSWERS).exists():
        if folder.exists() and any(folder.iterdir()):
            raise TargetExists(f"--out {folder}: exists already and holds no {ANSWERS}; name a new folder")
        return None
    answers = read_answers(folder / ANSWERS)
    if answers.record.get("digest") != mark:
        raise Conflict(f"--out {folder}: was begun with other logs or another ship; name a new folder")
    if given and answers.is_asked and given.given != answers.given:
        raise Conflict(f"--out {folder}: was begun with other answers than --answers; name a new folder")
    return answers


def write_mark(folder: Path, mark: str) -> None:
    """Makes the ``folder``, and says there to which logs and ship it belongs; mark: as of ``digest``."""
    _write(folder, Answers(), {"digest": mark})


def take_back(folder: Path) -> None:
    """Leaves nothing of a ``folder`` without trials."""
    (folder / ANSWERS).unlink(missing_ok=True)
    if not any(folder.iterdir()):
        folder.rmdir()


def questions(
    ship: Ship, trials: Sequence[Trial], by_particulars: bool, antenna_known: bool
) -> list[tuple[str, str, str]]:
    """What data do not answer, at most five: field of the answers, words, and what an empty line stands for.

    by_particulars: the ``ship`` is from main particulars; trials: of which the rudder's rate is looked for;
    antenna_known: a sidecar says where the antenna is.
    """
    asked = []
    if not antenna_known:
        words = "Where is the antenna: metres ahead and to starboard of midship, such as '-42 0'?"
        asked.append(("antenna", words, "unknown"))
    if by_particulars:  # that of a ship file stands there
        asked.append(("draught", "Draught at the trials [m]?", f"{ship.particulars['d']:g}"))
    asked.append(("depth", "Depth of the water [m]?", "deep"))
    asked.append(("current", "Is a current likely: none, steady, 'per run'?", "unknown"))
    if rate := measured_particulars(with_own_rates(ship, trials)[0]).get("rudder_rate"):
        asked.append(("rudder_rate", f"Rudder rate {rate}: use it, or a number [deg/s]?", "measured"))
    return asked


def measured_particulars(ship: Ship) -> dict[str, str]:
    """Particulars of the ``ship`` that trials showed: name -> value and where it was measured."""
    measured = {}
    for name, source in ship.sources.items():
        if source.startswith(MEASURED):
            value = ship.particulars[name]
            is_angle = name in ("rudder_rate", "neutral_rudder")  # stored in rad and rad/s, as all particulars
            unit = "deg/s" if name == "rudder_rate" else "deg" if is_angle else PARTICULARS[name][1]
            measured[name] = f"{math.degrees(value) if is_angle else value:.3g} {unit}, {source}"
    return measured


def answered(known: Answers, name: str, text: str) -> Answers:
    """The ``known`` answers with that of a ``name``, as a person typed the ``text``. Raises UserError for another
    text."""
    words = text.strip().strip("'\"")  # the questions show answers in quotes, which people type too
    value: Any = words
    if name == "antenna" and words != "unknown":
        value = [_number(word, text) for word in words.replace(",", " ").split()]
    elif name in ("draught", "depth", "rudder_rate") and words not in ("deep", "measured"):
        value = _number(words, text)
    return validated(Answers, {**known.model_dump(exclude_none=True), name: value}, "answer")


def _number(word: str, text: str) -> float:
    try:
        return float(word)
    except ValueError:
        raise Conflict(f"'{text}' is none of the answers") from None


# Depth of water in draughts up to which no ship sails. Set by hand: a tenth of her draught below the keel.
AGROUND = 1.1


def with_answers(ship: Ship, answers: Answers) -> Ship:
    """The ``ship`` in water of the depth of the ``answers``, with a rudder of their rate and a current that is fitted.
    Raises UserError for water in which she is aground."""
    if not isinstance(answers.rudder_rate, str):
        # without a source it counts as stated, which the fit does not measure again
        particulars = {**ship.particulars, "rudder_rate": math.radians(answers.rudder_rate)}
        sources = {name: source for name, source in ship.sources.items() if name != "rudder_rate"}
        ship = replace(ship, particulars=particulars, sources=sources)
    if not isinstance(answers.depth, str) and "shallow_water" not in ship.effects:
        if answers.depth <= AGROUND * ship.particulars["d"]:
            raise Conflict(f"depth {answers.depth:g} m: a ship of {ship.particulars['d']:g} m draught is aground there")
        ship = ship.with_effect("shallow_water", {"d_h": ship.particulars["d"] / answers.depth})
        # fixed, as the depth is known: the trials are not asked for it
        shallow = {s: c.with_(fixed=True) for s, c in ship.coefficients.items() if s.startswith("shallow_water.")}
        ship = ship.with_coefficients(shallow)
    return freeing_effects(ship, ["current"]) if answers.current == "steady" else ship


def write_sidecars(folder: Path, keys: Mapping[str, Any]) -> None:
    """Sets ``keys`` of the default of each trials.toml below a ``folder`` of trials, which is made where it lacks."""
    import tomlkit  # keeps comments and order of a file that a person wrote

    for place in dict.fromkeys(path.parent for path in trial_files([folder])):
        path = place / SIDECAR
        document = tomlkit.parse(path.read_text(encoding="utf-8")) if path.exists() else tomlkit.document()
        document.setdefault("all" if "all" in document else "default", tomlkit.table()).update(keys)
        replace_text(path, tomlkit.dumps(document))


def antenna_is_known(folder: Path) -> bool:
    """Whether a sidecar below a ``folder`` of trials says where the antenna is."""
    return any("reference_point" in path.read_text(encoding="utf-8") for path in folder.rglob(SIDECAR))


def write_answers(started: StartedRun, mark: str, command: str, fitted_ship: Ship | None = None) -> None:
    """Writes what was asked, answered, assumed and measured of a ``started`` run; mark: as of ``digest``; command: that
    made it; fitted_ship: with what her trials showed."""
    given, ship = started.answers.given, fitted_ship or started.ship
    record = {
        "digest": mark,
        "command": command,
        "asked": list(started.asked),
        "assumed": [name for name in given if name not in started.asked],
        "measured": measured_particulars(ship),
        "rules": [str(notice) for notice in started.ship.notices],
    }
    _write(started.folder, started.answers, record)


def _write(folder: Path, answers: Answers, record: dict[str, Any]) -> None:
    """The file of ``answers`` in the ``folder``, which is made, with a ``record``."""
    import tomlkit

    document = tomlkit.document()
    document.add(tomlkit.comment(TOML_HEAD))
    for name, value in answers.given.items():
        if value is not None:
            document.add(name, value)
    document.add("record", record)
    with writing(folder, "choose another --out"):
        folder.mkdir(parents=True, exist_ok=True)
        replace_text(folder / ANSWERS, tomlkit.dumps(document))


def write_depth(folder: Path, depth: float) -> None:
    """Says the ``depth`` of the water [m] in a site.toml beside the trials in a ``folder`` that have none."""
    for place in dict.fromkeys(path.parent for path in trial_files([folder])):
        if not (place / SITE).exists():
            replace_text(place / SITE, f"[water]\ndepth = {depth:g}\n")


def fitted(started: StartedRun, command: str, progress: OnProgress | None = None) -> FitResult:
    """The calibration in the folder of a ``started`` run, made, resumed or read.

    Where the trials show inputs that were sampled, their sidecar says so from then on. command: that is stored;
    progress: called at each iteration. Raises UserError as ``calibrate``.
    """
    from mmg_ident.api import calibrate

    run = started.folder / RUN
    earlier = read_fit(run) if (run / "result.json").exists() else None
    if earlier and earlier.converged:
        return earlier
    per_run = ("current",) if started.answers.current == "per run" else ()
    name = started.folder.resolve().name
    surroundings = started.answers.current != "none"  # whether a current that the trials speak for is fitted along
    options = FitOptions(
        command=command, name="" if name_fault(name) else name, resume=earlier, per_run=per_run,
        surroundings=surroundings,
    )  # fmt: skip
    result = calibrate(earlier.start if earlier else started.ship, started.trials, (), None, options, progress)
    # the trials told how their inputs were logged: figures and another call read them so
    if any(m.code == "suspect" and 'inputs = "sampled"' in m.text for m in result.messages):
        write_sidecars(started.folder / TRIALS, {"inputs": "sampled"})
    # the page comes with the standard manoeuvres
    return result.save(run, replace=earlier is not None, report=False)

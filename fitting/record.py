"""What result.json of a calibration holds, as typed values: the same in memory and after reading.

A number that is not finite is None here and null in the file.
"""

from __future__ import annotations

import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from pydantic import BeforeValidator

from cases.trial import Trial
from cases.trial_set import TrialSet, in_own_water
from fitting.prediction.score import ScorePair
from fitting.report.run_folder import SCHEMA_VERSION, adapter, plain
from fitting.settings import Settings, Start
from mmg.errors import BadValue
from mmg.messages import Message
from mmg.rollout import Simulator

if TYPE_CHECKING:  # slow to import, and not needed to read a result
    from fitting.calibration import Calibration
    from fitting.uncertainty.posterior import Posterior

# Attributes by those keys of result.json that have another name, and the other way round.
RENAMED = {"ship": "ship_name", "calibration": "mark", "coefficients": "estimates"}
KEYS = {attribute: key for key, attribute in RENAMED.items()}
SHOWN = 8  # Faults of a file named at once. Set by hand: a screen.


@dataclass(frozen=True)
class CoefficientRow:
    """One free coefficient: estimate and prior in its own unit, bounds, the prior's share of its variance, a verdict.

    at_bound: "lower", "upper" or None.
    """

    value: float
    std: float | None
    prior_value: float | None
    prior_std: float | None
    lower: float | None
    upper: float | None
    at_bound: str | None
    prior_share: float | None
    verdict: str
    description: str
    unit: str
    prime: str


@dataclass(frozen=True)
class ConstantRow:
    """A constant of one run: estimate, standard error, unit and prior."""

    value: float
    std: float | None
    unit: str
    prior_value: float
    prior_std: float


@dataclass(frozen=True)
class EffectValue:
    """Estimate of an effect's parameter and its standard error [unit of the coefficient]."""

    value: float
    std: float


@dataclass(frozen=True)
class EffectTest:
    """Whether a freed effect is more than chance (``diagnosis.for_calibration``).

    p_value: of the likelihood ratio with and without it, in which a random force acts beside the noise of the sensors,
    for this effect alone; p_fit: by the standard errors of the fit (None where they are not known); parameters: symbol
    -> its estimate with the random force; force_memory_s: its correlation time; sentence: both in words; in_doubt:
    apart.
    """

    name: str
    p_value: float
    p_fit: float | None
    parameters: dict[str, EffectValue]
    force_memory_s: float
    sentence: str
    in_doubt: bool


@dataclass(frozen=True)
class StateNoise:
    """Residuals of one state: rms in ``unit`` and correlation time [samples]."""

    rms: float | None
    correlation_time_samples: float | None
    unit: str


@dataclass(frozen=True)
class TrialRow:
    """A trial: name, file, hash, length and rate, and the notices of reading it."""

    name: str
    path: str | None
    sha256: str | None
    samples: int
    duration_s: float
    dt_s: float
    kind: str | None
    has_position: bool
    has_wind: bool
    notices: tuple[str, ...]


@dataclass(frozen=True)
class SolveRow:
    """One solve: objective, status and iterations of IPOPT, seconds, windows, sigma (6,), whether solved again."""

    objective: float | None
    status: str
    iterations: int
    seconds: float
    windows: int
    sigma: tuple[float, ...]
    restarted: bool


@dataclass(frozen=True)
class Correlation:
    """Correlation of the estimates: symbols (P,) and matrix (P, P)."""

    symbols: tuple[str, ...]
    matrix: tuple[tuple[float | None, ...], ...]


@dataclass(frozen=True)
class FigureRow:
    """A figure of the run: file in figures/, title and caption."""

    file: str
    title: str
    caption: str


@dataclass(frozen=True)
class MessageRow:
    """A message: level "warning" or "notice", code and sentence."""

    level: str
    code: str
    text: str


def _with_nan(row: Any) -> Any:
    """The ``row`` of a start of which the objective is not finite, where the model explodes: null in JSON."""
    return {k: math.nan if v is None else v for k, v in row.items()} if isinstance(row, dict) else row


@dataclass(frozen=True, kw_only=True, eq=False)
class FitRecord:
    """What a calibration found, as result.json holds it; ``docs/reference/files.md`` lists the keys.

    envelope: quantity -> range (lowest, highest) that the training trials held, SI (``fitting.report.use``);
    estimates: the free coefficients by symbol (key "coefficients");
    mark: name, date, hash of the data, and the ship that it began from (``mmg.ship.CalibrationMark``);
    posterior: what draws from it say (``fitting.uncertainty.posterior``);
    left_out: what stretches left out of the trials were worth (``fitting.prediction.score``);
    campaigns: their runs, values and what was tried (``fitting.selection.campaigns``); scaling: of a ship
    scaled from a model, what changed and what was assumed (``delivery.full_scale.result``).
    Attributes with a default are absent from the file where they are None.
    """

    created: str
    command: str
    ship_name: str
    converged: bool
    status: str
    advice: str
    objective: float | None
    constraint_violation: float | None  # largest gap between intervals [scaled states]
    condition_number: float | None  # of the covariance in prior standard deviations [-]
    iterations: int  # of the last solve
    passes: tuple[SolveRow, ...]  # in the order in which they were made
    starts: tuple[Annotated[Start, BeforeValidator(_with_nan)], ...]
    settings: Settings
    versions: dict[str, str]
    compiled: bool  # else interpreted
    timings_s: dict[str, float]
    data: tuple[TrialRow, ...]
    validation_data: tuple[TrialRow, ...]
    windows: int
    intervals: int
    seconds_used: float  # of data in the windows
    sigma: dict[str, float | None]  # by state, that the last solve assumed [SI]
    noise: dict[str, StateNoise]  # by state, of its residuals
    estimates: dict[str, CoefficientRow]
    fixed: tuple[str, ...]  # symbols
    correlation: Correlation
    scores: dict[str, ScorePair]  # of "validation" and "training" trials, before and after
    identifiability: dict[str, Any]
    messages: tuple[MessageRow, ...]
    figures: tuple[FigureRow, ...] = ()
    mark: dict[str, str] | None = None
    effects: tuple[EffectTest, ...] | None = None
    per_run: dict[str, dict[str, ConstantRow]] | None = None  # run -> symbol -> constant
    uncertainty: dict[str, Any] | None = None
    bootstrap: dict[str, Any] | None = None
    profiles: tuple[dict[str, Any], ...] | None = None
    posterior: dict[str, Any] | None = None
    bands: dict[str, Any] | None = None
    adaptation: dict[str, Any] | None = None
    random_force: dict[str, float] | None = None  # "X", "Y" [N], "N" [N m], "memory_s"
    envelope: dict[str, list[float]] | None = None
    left_out: dict[str, Any] | None = None
    campaigns: dict[str, Any] | None = None
    scaling: dict[str, Any] | None = None

    @classmethod
    def of(cls, content: Mapping[str, Any]) -> FitRecord:
        """The record of the ``content`` of result.json, plain or typed. Raises pydantic's error for wrong keys."""
        named = {RENAMED.get(str(key), str(key)): value for key, value in content.items()}
        # through JSON, so that a record in memory is what would be read again; strict: no text for a number
        record: FitRecord = adapter(FitRecord).validate_json(json.dumps(plain(named)), strict=True)
        return record

    @property
    def warnings(self) -> tuple[Message, ...]:
        """What must be known before the estimates are used."""
        return self._messages("warning")

    @property
    def notices(self) -> tuple[Message, ...]:
        """What was assumed or left out on the way."""
        return self._messages("notice")

    def _messages(self, level: str) -> tuple[Message, ...]:
        return tuple(Message(m.text, m.code) for m in self.messages if m.level == level)

    def __eq__(self, other: object) -> bool:
        """Whether both would have the same result.json; arrays among the attributes have no one truth."""
        return self.to_dict() == other.to_dict() if isinstance(other, FitRecord) else NotImplemented

    def to_dict(self) -> dict[str, Any]:
        """The content of result.json."""
        content: dict[str, Any] = {"kind": "calibration", "schema_version": SCHEMA_VERSION}
        for field in fields(FitRecord):  # of this class: a FitResult has more
            value = getattr(self, field.name)
            if value is not None or field.name in ("objective", "constraint_violation", "condition_number"):
                content[KEYS.get(field.name, field.name)] = plain(value)
        texts = {f"{level}s": [str(m) for m in self._messages(level)] for level in ("warning", "notice")}
        return content | {"seed": self.settings.seed, **texts}


@dataclass(frozen=True)
class FitObjects:
    """What stands behind a result and is not stored: figures are drawn from it.

    before, after: simulators of the ship before and after; validation: trials held out; posterior: draws, None: not
    asked for.
    """

    calibration: Calibration
    before: Simulator
    after: Simulator
    validation: Sequence[Trial] = ()
    posterior: Posterior | None = None

    @cached_property
    def trials(self) -> TrialSet:
        """Calibrated on, through the water where each has a current of its own."""
        trials, own = self.calibration.trials, self.calibration.constants
        return TrialSet.of(in_own_water(trials, own.rows())) if own else trials

    @property
    def sets(self) -> dict[str, Sequence[Trial]]:
        """The trials by what they are for: "validation" and "training"."""
        return {"validation": self.validation, "training": self.trials}


def read_record(path: Path, content: Mapping[str, Any]) -> FitRecord:
    """The record in ``content``, the JSON of the file ``path``. Raises UserError that names every key at fault."""
    from pydantic import ValidationError

    if content.get("kind") != "calibration":
        raise BadValue(f"{path}: kind = {content.get('kind')!r}: not that of a calibration; give a run of mmg fit")
    if isinstance(settings := content.get("settings"), dict):  # a loss still to be chosen was null in earlier versions
        content = {**content, "settings": {key: value for key, value in settings.items() if value is not None}}
    try:
        return FitRecord.of(content)
    except ValidationError as error:
        faults = []
        for fault in error.errors():
            first, *rest = fault["loc"]  # an attribute; in the file it may be called otherwise
            faults.append(f"{'.'.join(map(str, (KEYS.get(str(first), first), *rest)))}: {fault['msg'].lower()}")
        more = f"; and {len(faults) - SHOWN} more" if len(faults) > SHOWN else ""
        raise BadValue(f"{path}: {'; '.join(faults[:SHOWN])}{more}") from None

"""The rows of a fleet: what its table and its page say of each ship, as plain values; the tables and the page."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any
from urllib.parse import quote

import numpy as np

from cases.io.files import replaced
from diagnosis.groups.between import difference, nature
from fitting.report import page
from fitting.report.plot_style import FigureFolder
from fitting.report.run_folder import SCHEMA_VERSION, plain, versions, write_json
from fitting.report.sections import plus_minus
from mmg.effects import EFFECTS
from mmg.errors import writing

if TYPE_CHECKING:
    import pandas as pd

    from diagnosis.findings import Between, GroupDifference
    from diagnosis.result import Diagnosis
    from fitting.prediction.score import ScorePair
    from fitting.result import FitResult
    from fitting.selection.sisters import SisterWidths
    from mmg_ident.fleets.plan import PlannedShip

SHIPS, DIAGNOSIS = "ships", "diagnosis"  # Folder of the run folders in that of a fleet, of a diagnosis in a run folder
ALIKE = 2.0  # Log Bayes factors within which two names of a difference between campaigns are alike. Set by hand.
CHANCE = 0.01  # Chance below which a difference between campaigns is one. Set by hand.
MOVED = 1.0  # Standard deviations of its start from which a coefficient is said to have moved. Set by hand.
SURE = 2.576  # And of its own: the two-sided 99 % quantile of a normal distribution
SAME = 0.05  # Width, in standard deviations of the prior, below which sisters do not differ. Set by hand.
SETS = {"held_out": "validation", "training": "training"}  # Sets of trials in a row, and in a calibration
# Keys of a row whose values the table holds as texts: lists of names, and words
LISTS = ("campaigns", "moved", "instruments", "warnings")
TEXTS = ("name", "sisters", "status", "reason", "start", "verdict", "sentence")
# What a diagnosis and sisters add to a row, without them.
EMPTY: dict[str, Any] = {
    "verdict": "", "sentence": "", "effects": [], "compared": [], "between": "", "between_sentence": "", "drifted": [],
    "reduction": None, "diagnosis_failed": "",
}  # fmt: skip


@dataclass(frozen=True)
class SisterGroup:
    """A group of sisters: its name, the ships whose fits told of each other, and what these said."""

    name: str
    ships: tuple[str, ...]
    widths: SisterWidths

    @property
    def mean(self) -> tuple[np.ndarray, np.ndarray]:
        """Mean of the coefficients over the sisters and its standard error, (P,) each, in their own units."""
        w = self.widths  # scaled: a coefficient is centre + unit * x, with the standard deviation of its prior as unit
        return w.centre + w.unit * w.mean, w.unit * np.sqrt(np.diag(w.mean_covariance))

    def to_dict(self) -> dict[str, Any]:
        """Widths in units of the prior, by coefficient and for all, and the chance of a sister as far off as each."""
        w = self.widths
        columns = zip(w.symbols, *self.mean, w.unit * w.width, w.width, strict=True)
        return {
            "ships": self.ships,
            "common_width": w.common,
            "common_width_90": w.common_90,
            "coefficients": {
                s: {"mean": m, "mean_std": e, "width": t, "width_of_prior": share} for s, m, e, t, share in columns
            },
            "p_alike": dict(zip(self.ships, w.p_alike, strict=True)),
        }


@dataclass(frozen=True)
class Fleet:
    """What was found of a fleet. name; rows: of each ship, in the order of the plan (``mmg_ident.fleets.rows``);
    groups: of sisters; command: that made it."""

    name: str
    rows: tuple[Mapping[str, Any], ...]
    groups: tuple[SisterGroup, ...]
    command: str = ""

    def __repr__(self) -> str:
        return f"<Fleet {self.name}: {len(self.rows)} ships, {len(self.failed)} failed, {len(self.groups)} groups>"

    @property
    def failed(self) -> tuple[str, ...]:
        """Names of the ships that have no calibration that can be used."""
        return tuple(row["name"] for row in self.rows if row["status"] != "done")

    def to_dict(self) -> dict[str, Any]:
        """The content of fleet.json."""
        return plain({
            "kind": "fleet",
            "schema_version": SCHEMA_VERSION,
            "name": self.name,
            "command": self.command,
            "ships": [{key: value for key, value in row.items() if key != "coefficients"} for row in self.rows],
            "sisters": {group.name: group for group in self.groups},
            "failed": self.failed,
            "versions": versions(),
        })  # fmt: skip


def _row(ship: PlannedShip, **values: Any) -> dict[str, Any]:
    """The row of a ``ship`` with these ``values``."""
    return {**EMPTY, "name": ship.name, "sisters": ship.sisters, "start": ship.start.title, **values}


def failed_row(ship: PlannedShip, reason: str) -> dict[str, Any]:
    """The row of a ``ship`` that could not be done, for a ``reason``."""
    return _row(
        ship, status="failed", reason=reason, trials=len(ship.trials), held_out=len(ship.held_out), seconds_used=0.0,
        campaigns=[], scores={}, coefficients={}, moved=[], instruments=[], warnings=[],
    )  # fmt: skip


def ship_row(
    ship: PlannedShip,
    result: FitResult,
    diagnosis: Diagnosis | None,
    left_out: Sequence[str],
    alone: Mapping[str, Any] | None,
) -> dict[str, Any]:
    """The row of a ``ship`` that was calibrated (``result``); diagnosis: of it, None for none; left_out: sentences on
    files; alone: what her fit without her sisters gave, None without any. Returns plain values."""
    coefficients = _coefficients(ship, result)
    moved = [s for s, c in coefficients.items() if c["beyond_chance"] and abs(c["moved"]) >= MOVED]
    by_campaign = result.campaigns or {}
    row = _row(
        ship,
        status="done" if result.converged else "not converged",
        reason="" if result.converged else result.advice or result.status,
        trials=len(result.data),
        held_out=len(result.validation_data),
        seconds_used=result.seconds_used,
        campaigns=list(by_campaign.get("runs", {})),
        scores={key: _scores(result.scores[name]) for key, name in SETS.items() if name in result.scores},
        coefficients=coefficients,
        moved=sorted(moved, key=lambda s: -abs(coefficients[s]["moved"])),
        instruments=[*left_out, *by_campaign.get("sentences", [])],
        warnings=list(result.warnings),
    )
    if diagnosis:
        row |= _diagnosed(row, diagnosis)
    for key, name in SETS.items():  # whether her sisters told well of her
        if alone and key in row["scores"] and name in alone["scores"]:
            row["scores"][key]["alone"] = alone["scores"][name]["after"]["window"]
    return plain(row)


def _coefficients(ship: PlannedShip, result: FitResult) -> dict[str, dict[str, Any]]:
    """Estimate and start of each coefficient, and by how many standard deviations of the start it moved."""
    rows = {}
    for symbol, c in result.estimates.items():
        start = ship.start.coefficients.get(symbol)
        value, std = (start.value, start.std) if start else (c.prior_value, c.prior_std)
        # in the start's own deviations, as coefficients have no common unit
        moved = (c.value - value) / std if value is not None and std else math.nan
        sure = value is not None and c.std is not None and abs(c.value - value) > SURE * c.std
        estimate = {"value": c.value, "std": c.std, "unit": c.unit, "description": c.description}
        rows[symbol] = estimate | {"start": value, "start_std": std, "moved": moved, "beyond_chance": sure}
    return rows


def _scores(pair: ScorePair) -> dict[str, Any]:
    """Both metrics before and after, and errors in units after."""
    errors: dict[str, Any] = {
        name: {"before": getattr(pair.before, name), "after": getattr(pair.after, name)} for name in ("window", "paper")
    }
    if units := pair.after.units:
        pooled = units.pooled
        errors |= {"window_s": units.window_s, "position_m": pooled.position_m, "heading_deg": pooled.heading_deg}
    return errors


def _diagnosed(row: Mapping[str, Any], diagnosis: Diagnosis) -> dict[str, Any]:
    """What a diagnosis adds to a row: verdict, effects, what drifted between campaigns, what instruments show."""
    between = diagnosis.between
    differences = between.differences if between else ()
    drifted = [_drift(d, d.name, difference(d)) for d in differences if d.nature == "ship"]
    drifted += one_of_several(between) if between else []
    instruments = [
        *row["instruments"],
        *(f"{e.name}: {_sizes(e.parameters)}" for e in diagnosis.effects if nature(e.name) == "instrument"),
        *(fault.sentence for fault in diagnosis.instruments),
        *diagnosis.kinematics,
        *(f"between campaigns: {difference(d)}" for d in differences if d.nature == "instrument"),
    ]
    # what is named is said by its row
    unnamed = between and not drifted and not any(d.nature == "surroundings" for d in differences)
    return {
        "verdict": diagnosis.verdict,
        "sentence": diagnosis.sentence,
        "effects": [{"name": e.name, "p_value": e.p_value, "text": _sizes(e.parameters)} for e in diagnosis.effects],
        "compared": list(between.groups) if between else [],
        "between": between.verdict if between else "",
        # the groups that a fleet compares are campaigns, which the diagnosis does not know
        "between_sentence": between.sentence.replace("groups by group", "campaigns") if between and unnamed else "",
        "drifted": drifted,
        "instruments": list(dict.fromkeys(instruments)),
        "reduction": diagnosis.held_out.reduction if diagnosis.held_out else None,
        "warnings": [*row["warnings"], *diagnosis.warnings, *(between.warnings if between else ())],
    }


def one_of_several(between: Between) -> list[dict[str, Any]]:
    """What drifted by the comparison ``between`` campaigns where several names explain it equally well, of which one at
    least is of the ship. Returns rows, [] where there is none."""
    if between.verdict != "unknown" or not between.candidates:
        return []
    best = between.candidates[0]
    least = max(ALIKE, best.log_bayes - ALIKE)  # nearly as likely as the best, and more so than no difference
    alike = [d for d in between.candidates if d.p_value < CHANCE and d.log_bayes > least]
    if not any(d.nature == "ship" for d in alike):
        return []
    alike.sort(key=lambda d: d.name not in EFFECTS)  # causes before the coefficients that they change
    best = alike[0]
    rest = ", ".join(d.name for d in alike[1:])
    words = difference(best) + (f"; {rest} would explain it as well" if rest else "; it explains a part of it")
    return [_drift(best, " or ".join(d.name for d in alike), words)]


def _drift(d: GroupDifference, name: str, text: str) -> dict[str, Any]:
    """The row of a difference ``d`` between campaigns, by its name and in words."""
    return {"name": name, "campaign": d.group, "p_value": d.p_value, "text": text}


def _sizes(parameters: Mapping[str, Any]) -> str:
    """Estimates of the parameters of an effect in words."""
    return ", ".join(f"{k} = {p.value:.3g} ± {p.std:.2g} {p.unit}".rstrip() for k, p in parameters.items())


def ship_table(fleet: Fleet) -> pd.DataFrame:
    """A row for each ship of ``fleet``: what became of her, scores, what drifted, failed and moved, in words separated
    by "; "."""
    import pandas as pd

    rows = []
    for row in fleet.rows:
        out = {key: value for key, value in row.items() if key in TEXTS or isinstance(value, (float, int, type(None)))}
        for name in SETS:
            score = row["scores"].get(name, {})
            for metric in ("window", "paper"):
                pair = score.get(metric, {})
                out |= {f"{name}_{metric}_{when}": pair.get(when) for when in ("before", "after")}
            out |= {f"{name}_{key}": score.get(key) for key in ("position_m", "heading_deg")}
        # nan for None: a column of numbers and None would be one of objects in Parquet
        numbers = {key: math.nan if value is None else float(value) for key, value in out.items() if key not in TEXTS}
        words = {key: "; ".join(row[key]) for key in LISTS}
        words["drifted"] = "; ".join(d["text"] for d in row["drifted"])
        words["effects"] = "; ".join(f"{e['name']}: {e['text']}" for e in row["effects"])
        rows.append({key: out[key] for key in TEXTS} | numbers | words)
    return pd.DataFrame(rows).set_index("name")


def write_tables(fleet: Fleet, folder: Path) -> None:
    """Write the table and fleet.json of ``fleet`` to ``folder``, each whole or not at all. Raises UserError where they
    cannot be written."""
    with writing(folder):
        with replaced(folder / "fleet.parquet") as scratch:
            ship_table(fleet).to_parquet(scratch, engine="pyarrow", write_page_checksum=True)
        write_json(folder / "fleet.json", fleet)


PAGE = "fleet.html"  # In the folder of the fleet
SHOWN = 12  # Coefficients in the table of a group of sisters, and in what moved. Set by hand.
# Probability below which a ship does not seem to be drawn from the distribution of her sisters. Set by hand.
SISTERLY = 0.01


def write_page(fleet: Fleet, folder: Path) -> None:
    """Write the page of ``fleet`` into its ``folder``; what cannot be made is a warning."""
    moved = Counter(symbol for row in fleet.rows for symbol in row["moved"])
    with FigureFolder(folder).making(PAGE):
        text = page.rendered(
            "fleet", "mmg_ident.fleets",
            fleet=fleet,
            rows=[_shown(row, folder) for row in fleet.rows],
            groups=[_group(group) for group in fleet.groups],
            moved=", ".join(f"{symbol} ({count})" for symbol, count in moved.most_common(SHOWN)),
        )  # fmt: skip
        page.write_page(text, folder / PAGE)


def _shown(row: Mapping[str, Any], folder: Path) -> dict[str, Any]:
    """A row as the page shows it."""
    pages = {
        words: f"{SHIPS}/{quote(row['name'])}/{below}report.html"
        for words, below in (("calibration", ""), ("diagnosis", f"{DIAGNOSIS}/"))
        if (folder / SHIPS / row["name"] / below / "report.html").exists()
    }
    score = row["scores"].get("held_out") or row["scores"].get("training") or {}
    return dict(row) | {
        "pages": pages,
        "moved_words": ", ".join(f"{s} {row['coefficients'][s]['moved']:+.1f}" for s in row["moved"][:SHOWN]),
        "score": score,
        "score_of": "held out" if "held_out" in row["scores"] else "training" if score else "",
    }


def _group(group: SisterGroup) -> dict[str, Any]:
    """A group of sisters as the page shows it: coefficients by width, widest first, and each sister's distance."""
    w = group.widths
    mean, error = group.mean
    values, errors = w.centre + w.unit * w.estimate, w.unit * w.std  # (N, P) of N sisters
    distance = (w.estimate - w.mean) / w.used_width  # of each from the mean, in widths
    far = [sorted(range(len(w.symbols)), key=lambda i: -abs(row[i]))[:3] for row in distance]  # the three farthest
    return {
        "name": group.name,
        "ships": group.ships,
        "common": w.common,
        "common_90": w.common_90,
        "alike": int((w.width < SAME).sum()),
        "count": len(w.symbols),
        "rows": [
            {"symbol": w.symbols[i], "mean": plus_minus(mean[i], error[i]), "width": w.unit[i] * w.width[i],
             "share": w.width[i],
             "values": [plus_minus(v, e) for v, e in zip(values[:, i], errors[:, i], strict=True)]}
            for i in np.argsort(-w.width)[:SHOWN] if w.width[i] > 0
        ],
        "sisters": [
            {"name": name, "rms": float(np.sqrt(np.mean(distance[k] ** 2))), "p": w.p_alike[k],
             "strange": w.p_alike[k] < SISTERLY,
             "far": ", ".join(f"{w.symbols[i]} {distance[k, i]:+.1f}".replace("-", "−") for i in far[k])}
            for k, name in enumerate(group.ships)
        ],
    }  # fmt: skip

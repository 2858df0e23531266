"""The first screen of a report, for a master or a yard: is the ship right, for what, and how sure.

It compares the figures of the standard manoeuvres that the trials hold with those of the model. Scores and coefficients
come behind it.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from cases.shipfiles.particulars import BY_RULE
from fitting.report.use import Delivered
from mmg.ship import Ship

if TYPE_CHECKING:
    from fitting.report.imo_form import FormRow, FormSide, ImoForm

OUTSIDE = " (!)"  # Mark of a tested figure that the model contradicts
SIDES = ("port", "starboard")
MOST_MEASURED = 10  # Rows of figures of measured runs on the first screen. Set by hand: with more the track leaves it.


@dataclass(frozen=True)
class FirstScreen:
    """What a report says first.

    verdict: whether she is right; doubtful: whether that is a contradiction; causes: likely ones of it; errors: of
    predictions, in units, "" where none were scored; columns, groups, rows: table of tested and model's figures, as the
    macro ``table`` takes it; note: on the table; good, bad: uses in a few words each; rules: rules of thumb, and what
    hangs on them.
    """

    verdict: str
    doubtful: bool
    causes: tuple[str, ...]
    errors: str
    columns: tuple[str, ...]
    groups: tuple[tuple[str, tuple[str, ...]], ...]
    rows: tuple[tuple[str, ...], ...]
    note: str
    good: tuple[str, ...]
    bad: tuple[str, ...]
    rules: tuple[str, ...]

    @property
    def by_side(self) -> tuple[tuple[str, ...], list[tuple[str, ...]]]:
        """Columns and rows of the table with a row for each side, as narrow as a terminal."""
        if not self.groups:
            return self.columns, list(self.rows)
        rows = []
        for name, *cells in self.rows:
            for number, side in enumerate(SIDES):  # cells: port and starboard in turn; a stop fills the first alone
                if any(cells[number::2]):
                    rows.append((name, side if any(cells[1::2]) else "", *cells[number::2]))
        return (*self.columns, "side", *(f"{title}|n" for title, _ in self.groups)), rows


def first_screen(
    result: Mapping[str, Any], ship: Ship, known: Delivered, good: Sequence[str], bad: Sequence[str]
) -> FirstScreen:
    """The first screen on a ``result``, content of result.json, and its ``ship``. known: trials and form at hand; good,
    bad: as of ``fitting.report.use.use_rows``."""
    form = known.form
    doubtful = bool(form and form.contradiction) or bool(doubts(result)) or not result["converged"]
    rules = [f"{rule} ({_hanging(names, form)})" for rule, names in form.rules.items()] if form else []
    particulars = [name for name, source in ship.sources.items() if source.startswith(BY_RULE)]
    rules += [f"particulars {', '.join(particulars)}"] if particulars else []
    columns: tuple[str, ...] = ("figure",)
    if form:
        groups, rows, note = _form_table(form)
    else:
        columns, groups, rows = ("run", "figure", "measured|n", "predicted|n"), (), _measured(result)
        note = "Predicted from the order on, with the measured rudder and revolutions. " * bool(rows)
        note += f"Standard manoeuvres of the model: {known.no_form}"
    return FirstScreen(
        verdict=_verdict(result, form),
        doubtful=doubtful,
        causes=form.causes if form and form.contradiction else (),
        errors=_errors(result, ship.particulars["L"]),
        columns=columns,
        groups=groups,
        rows=tuple(rows),
        note=note,
        good=tuple(use.partition(":")[0] for use in good),
        bad=tuple(use.partition(":")[0] for use in bad),
        rules=tuple(rules),
    )


# Codes of messages on a calibration by which no ship is right, whatever her figures are.
DOUBTS = ("not_converged", "worse_than_persistence")


def doubts(result: Mapping[str, Any]) -> list[str]:
    """What of a ``result`` speaks against its ship by itself: sentences of its messages with one of DOUBTS."""
    said = {m["code"]: m["text"] for m in reversed(result.get("messages", []))}
    return [said[code] for code in DOUBTS if code in said]


def _verdict(result: Mapping[str, Any], form: ImoForm | None) -> str:
    """Whether the ship is right, by the strongest evidence there is."""
    against = doubts(result)
    if not result["converged"]:
        return "Not usable: the calibration did not converge."
    if form and form.contradiction:
        return form.contradiction
    judged = [side for row in form.rows for side in row.sides if side.contradicts is False] if form else []
    if judged:
        which = f"all {len(judged)} tested figures lie" if len(judged) > 1 else "the one tested figure lies"
        words = f"{which} inside of the model's 90 % intervals of a single trial"
        vague = sum(side.is_vague for side in judged)
        if against:
            return f"Doubtful: {words}, but {against[0]}."
        if 2 * vague > len(judged):
            return f"Undecided: {words}, but {vague} of these are wider than the figure itself."
        return f"Right so far: {words}."
    if against:
        return f"Doubtful: {against[0]}."
    if result.get("scaling"):
        return "Not tested: she is scaled from a model, and no trial of the ship herself took part."
    if "validation" in result["scores"]:
        return "No figure of a standard manoeuvre is compared here: she is judged by predictions of held-out trials."
    return "Not judged: no trial was held out, and no figure of a standard manoeuvre is compared here."


def _errors(result: Mapping[str, Any], length: float) -> str:
    """How far predictions end from the measured runs; "" where none were scored in units. length: of the ship [m]."""
    held_out = "validation" in result["scores"]
    pair = result["scores"].get("validation" if held_out else "training")
    units = pair and pair["after"].get("units")
    if not units or units["pooled"]["position_end_m"] is None:
        return ""
    pooled, count = units["pooled"], sum(run["windows"] > 0 for run in units["runs"])
    which = f"{count} {'held-out' if held_out else 'training'} trial{'s' * (count != 1)}"
    position, heading = pooled["position_end_m"], pooled["heading_end_deg"]
    words = f"On {which} predictions of {units['window_s']:g} s end {position:.2g} m ({position / length:.2g} L) "
    words += f"and {heading:.2g} deg off (rms)"
    return words + (", on the trials that she was fitted to." if not held_out else ".")


def _hanging(names: Sequence[str], form: ImoForm) -> str:
    """What hangs on a rule of thumb, of the groups of figures ``names``."""
    missing = {row.group for row in form.rows} - set(names)
    return ", ".join(name.split(",")[0].lower() for name in names) if missing else "all figures"


def _form_table(form: ImoForm) -> tuple[tuple[tuple[str, tuple[str, ...]], ...], list[tuple[str, ...]], str]:
    """Groups of columns, rows and note of the table of tested and model's figures."""
    model = ("model [90 %]" if form.intervals else "model", SIDES)
    rows = []
    for row in form.rows:
        sides = [*row.sides, None][:2]  # a stop has one
        tested = [_tested(side, row) for side in sides] if form.tested else []
        modelled = [side.model.words(row.unit, of_trial=True) if side and side.model else "" for side in sides]
        name = f"{row.group.split(',')[0]}: {row.name.lower().removesuffix(' angle')} [{row.unit}]"
        rows.append((name, *tested, *modelled))
    note = f"{OUTSIDE.strip()} lies outside of the interval. " * bool(form.contradiction)
    note += "90 % of single trials of ships that the trials allow. " * form.intervals
    read = any("±" in cell for row in rows for cell in row)
    note += "±: what a tested figure changes by between two samples. " * read
    return (("tested", SIDES), model) if form.tested else (model,), rows, note + "L: ship lengths."


def _tested(side: FormSide | None, row: FormRow) -> str:
    """The tested figure of a side, marked where the model contradicts it."""
    if side is None or side.tested is None:
        return ""
    return side.tested.words(row.unit) + OUTSIDE * bool(side.contradicts)


def _measured(result: Mapping[str, Any]) -> list[tuple[str, ...]]:
    """Figures of measured runs and their predictions, of held-out trials where there are any."""
    pair = result["scores"].get("validation") or result["scores"].get("training")
    units = (pair and pair["after"].get("units")) or {"runs": []}
    rows = [
        (run["name"], f"{maneuver['title']}: {f['figure'].replace('_', ' ')} [{f['unit']}]",
         *("" if f[key] is None else f"{f[key]:.3g}" for key in ("measured", "predicted")))
        for run in units["runs"]
        for maneuver in run["maneuvers"]
        for f in maneuver["figures"]
    ]  # fmt: skip
    return rows[:MOST_MEASURED]

"""What the report says of the use of a calibrated ship: conditions of its trials, figures for IMO, limits, advice."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

from cases.trial import Trial
from fitting.prediction.envelope import trial_envelope
from fitting.report.run_folder import rows_by_role, trials_again
from fitting.report.use import condition_rows, limit_rows, use_rows
from mmg.errors import UserError
from mmg.ship import Ship

if TYPE_CHECKING:
    from fitting.report.imo_form import ImoForm

LATER = "mmg report RUN adds it (without --no-imo): its figures are simulated with draws of the coefficients."


@dataclass(frozen=True)
class Delivered:
    """What a page needs beside the record of a run.

    trials: those at hand; absent: sentences on the others; form: None where it was not asked for or cannot be made,
    with the reason in ``no_form``; full_load: draught [m] of the fully loaded ship, None where it is not known;
    figure: of ``imo_form.drawn_maneuvers``.
    """

    trials: tuple[Trial, ...] = ()
    absent: tuple[str, ...] = ()
    form: ImoForm | None = None
    no_form: str = LATER
    full_load: float | None = None
    figure: dict[str, Any] | None = None


def delivered(result: Mapping[str, Any], ship: Ship, full_load: float | None = None, imo: bool = True) -> Delivered:
    """Trials read again and the form for IMO of a run, of whose calibrated or hybrid ``ship`` the ``result`` speaks.

    result: content of result.json; full_load: draught [m] of the fully loaded ship; imo: with the form. Raises
    UserError for a draught that the model cannot be carried to.
    """
    found, absent = trials_again(rows_by_role(result))
    known = Delivered(tuple(trial for _, trial in found), tuple(absent), full_load=full_load)
    if not imo:
        return known
    from fitting.report.imo_form import drawn_maneuvers, imo_form, standard_figures  # late: a fit leaves the form out

    try:
        model = standard_figures(result, ship)
        form = imo_form(ship, known.trials, model, result, full_load)
        return replace(known, form=form, figure=drawn_maneuvers(model))
    except UserError as error:
        if full_load is not None and "--full-load-draught" in str(error):
            raise
        return replace(known, no_form=f"It cannot be made: {error}.")


def delivery_sections(result: Mapping[str, Any], ship: Ship, known: Delivered) -> dict[str, Any]:
    """What the template shows of a ``result`` and its ``ship`` in the sections on use.

    result: content of result.json; known: beside it.
    """
    envelope: Mapping[str, Sequence[float]] = result.get("envelope") or trial_envelope(ship, known.trials)
    good, bad = use_rows(envelope, ship, any(row.get("has_wind") for row in result["data"]))
    return {
        "known": known,
        "conditions": condition_rows(ship, known.trials, known.full_load) if known.trials else [],
        "limits": limit_rows(envelope, ship.particulars["L"]),
        "hybrid_form": ship.network is not None,
        "good": good,
        "bad": bad,
    }

"""``mmg scale``: from a calibrated model to the ship."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, Any

from typer import Option

from mmg_ident.commands import options as o
from mmg_ident.commands import output as cli

if TYPE_CHECKING:
    from fitting.result import FitResult


@o.options(Scaling="speed rho form_factor roughness froude_only")
def scale(
    run: o.Ship,
    length: Annotated[float, Option(help="Of the ship between perpendiculars [m].")],
    out: o.RunFolder,
    speed: Annotated[float | None, Option(help="Of the ship [m/s], for friction; default the model's, scaled.")] = None,
    rho: Annotated[float | None, Option(help="Density of water [kg/m^3]; default sea water.")] = None,
    form_factor: Annotated[float | None, Option(help="k; default from the model's resistance.")] = None,
    roughness: Annotated[float, Option(help="Roughness of the ship's hull [m].")] = 150e-6,
    froude_only: Annotated[bool, Option("--froude-only", help="Similarity alone, no viscous effect.")] = False,
    name: Annotated[str, Option(help="Of the ship; default the model's, with the length.")] = "",
    json: o.Json = False,
) -> None:
    """Carry a calibrated model to the ship: Froude's law, and friction, wake and rudder inflow at her Reynolds number.

    The run folder is complete for mmg predict, imo, report and export. Errors of the coefficients are carried along and
    grow by what scaling leaves open; result.json and report.html say what is assumed.

    Example: mmg scale runs/first --length 325 --out runs/ship
    """
    from delivery.full_scale.result import scaled_result
    from delivery.full_scale.scaled_ship import Scaling
    from fitting.report.run_folder import check_target, reserved

    scaling = Scaling(length, speed, rho, form_factor, roughness, froude_only, name)
    scaling.check()  # before the run is read: most faults are in the options
    check_target(out)
    with reserved(out), cli.working("scaling"):
        result = scaled_result(run, scaling, cli.command_line()).save(out)
    if json:
        cli.print_json(result.to_dict())
        return
    cli.say_remarks(result)
    _print(result)
    cli.say(f"run folder: {out} (ship.toml, result.json, report.html; model/ holds the run of the model)")


def _print(result: FitResult) -> None:
    """What changed, as a table on stdout."""
    account: dict[str, Any] = result.scaling or {}  # there in each result of mmg scale
    model = account["model"]
    print(f"{result.ship_name}: {model['ship']} of {model['length_m']:g} m at the scale {account['scale']:.6g}")
    points, rows = account["self_propulsion"], []
    for key, words in (("speed_m_s", "speed [m/s]"), ("n", "revolutions [1/s]"), ("C_Th", "propeller loading C_Th")):
        pair = [points[side][key] for side in ("model", "ship")]
        if None not in pair:  # None: what a model does not give
            rows.append((words, *(f"{value:.4g}" for value in pair), ""))
    changed = [row for row in account["coefficients"] if row["changed"]]
    rows += [(r["symbol"], f"{r['model']:.4g}", f"{r['ship']:.4g}", f"{r['ship_std']:.2g}") for r in changed]
    cli.print_table(("", "model|n", "ship|n", "std|n"), rows)
    if unchanged := [row["symbol"] for row in account["coefficients"] if not row["changed"]]:
        print(f"kept, with wider errors: {', '.join(unchanged)}")

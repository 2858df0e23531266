"""``mmg scale``: from a calibrated model to the ship."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from typer import Argument, Option

from mmg_ident.commands.output import command_line, print_json, say, say_remarks, ship_names, working

if TYPE_CHECKING:
    from fitting.result import FitResult


def scale(
    run: Annotated[
        str,
        Argument(
            help="Run folder of mmg fit, a ship file, or a ship of the package.",
            metavar="RUN|SHIP",
            autocompletion=ship_names,
        ),
    ],
    length: Annotated[float, Option(help="Length of the ship between perpendiculars [m].")],
    out: Annotated[Path, Option(help="New run folder to write.")],
    speed: Annotated[
        float | None,
        Option(
            help="Speed of the ship [m/s] at which friction and wake are taken; default the model's, Froude scaled."
        ),
    ] = None,
    rho: Annotated[float | None, Option(help="Density of the ship's water [kg/m^3]; default sea water.")] = None,
    form_factor: Annotated[
        float | None, Option(help="Form factor k where it was measured; default from the model's own resistance.")
    ] = None,
    roughness: Annotated[float, Option(help="Roughness of the ship's hull [m].")] = 150e-6,
    froude_only: Annotated[
        bool, Option("--froude-only", help="Similarity alone: resistance, wake and rudder inflow stay the model's.")
    ] = False,
    name: Annotated[str, Option(help="Name of the ship; default the model's, with the length.")] = "",
    json: Annotated[bool, Option("--json", help="Print result.json on stdout.")] = False,
) -> None:
    """Carry a calibrated model to the ship: Froude's law, and friction, wake and rudder inflow at her Reynolds number.

    The run folder is complete for mmg predict, imo, report and export. Errors of the coefficients are carried along and
    grow by what scaling leaves open; result.json and report.html say what is assumed.

    Example: mmg scale runs/first --length 325 --out runs/ship
    """
    from delivery.full_scale.figure import write_scaled
    from delivery.full_scale.result import scaled_result
    from delivery.full_scale.scaled_ship import Scaling
    from fitting.report.run_folder import check_target, reserved

    scaling = Scaling(length, speed, rho, form_factor, roughness, froude_only, name)
    scaling.check()
    check_target(out)
    with reserved(out), working("scaling"):
        result = write_scaled(scaled_result(run, scaling, command_line()), out)
    if json:
        print_json(result.to_dict())
        return
    say_remarks(result)
    _print(result)
    say(f"run folder: {out} (ship.toml, result.json, report.html; model/ holds the run of the model)")


def _print(result: FitResult) -> None:
    """What changed, as a table on stdout."""
    account: dict[str, Any] = result.scaling or {}
    model = account["model"]
    print(f"{result.ship_name}: {model['ship']} of {model['length_m']:g} m at the scale {account['scale']:.6g}")
    points = account["self_propulsion"]
    for key, words in (("speed_m_s", "speed [m/s]"), ("n", "revolutions [1/s]"), ("C_Th", "propeller loading C_Th")):
        pair = [points[side][key] for side in ("model", "ship")]
        if None not in pair:
            print(f"  {words:24s} {pair[0]:10.4g} -> {pair[1]:10.4g}")
    for row in account["coefficients"]:
        if row["changed"]:
            values = f"{row['model']:10.4g} -> {row['ship']:10.4g} +- {row['ship_std']:.2g}"
            print(f"  {row['symbol']:24s} {values}")
    kept = [row["symbol"] for row in account["coefficients"] if not row["changed"]]
    if kept:
        print(f"  kept, with wider errors: {', '.join(kept)}")

"""``mmg export``: a calibrated or hybrid ship for use elsewhere."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from typer import Option

from mmg.messages import message_rows
from mmg_ident.commands import options as o
from mmg_ident.commands import output as cli
from mmg_ident.settings import names_of


def _formats(incomplete: str) -> list[str]:
    """Names of formats, for the completion of a shell."""
    from delivery.export import FORMATS

    return [name for name in FORMATS if name.startswith(incomplete)]


def export(
    model: o.Ship,
    format: Annotated[
        str,
        Option(
            help="c, c-tracker, matlab, fmu, fmu3, fmu-tracker, toml, json, casadi, onnx, shipmmg, pvs, gazebo.",
            autocompletion=_formats,
        ),
    ],
    out: Annotated[Path, Option(help="Folder or file to write.")],
    without: Annotated[list[str] | None, Option(help="Leave out this effect of the ship; may be repeated.")] = None,
    platforms: Annotated[
        list[str] | None,
        Option(
            help="Of an FMU: libraries for these, such as x86_64-windows or aarch64-linux, or none; may be repeated. "
            "Default: this platform, where there is a compiler."
        ),
    ] = None,
    coefficients: Annotated[
        list[str] | None, Option(help="Of a tracker: coefficients to estimate along; may be repeated.")
    ] = None,
    force: Annotated[bool, Option("--force", help="Also what is not calibrated; replace what exists.")] = False,
    json: o.Json = False,
) -> None:
    """Deliver a calibrated or hybrid ship: code that runs without this program.

    What did not converge and what was never calibrated is refused; with --force it leaves, and says so itself.

    Example: mmg export runs/first --format c --out ship_c

    Example: mmg export runs/first --format casadi --out ship_casadi
    """
    from delivery.export import export as write
    from delivery.product import product_of

    with cli.working("reading"):
        product = product_of(model, force, names_of(without))
    selections = {"platforms": names_of(platforms), "coefficients": names_of(coefficients)}
    # a format refuses options that it does not have
    options = {name: names for name, names in selections.items() if names}
    with cli.working(f"exporting {product.ship.name}"):
        messages = write(product, format, out, force, **options)
    if json:
        cli.print_json({"format": format, "out": str(out), **product.about(), "notes": message_rows(messages)})
        return
    cli.say_notes((*product.caveats, *messages))
    cli.say(f"written: {out}")

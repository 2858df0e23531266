"""``mmg export``: a calibrated or hybrid ship for use elsewhere."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from typer import Argument, Option

from mmg_ident.commands.output import names_of, print_json, say


def export(
    model: Annotated[str, Argument(help="Run folder of mmg fit or mmg train, ship file, or ship.", metavar="RUN|SHIP")],
    format: Annotated[str, Option(help="c, toml, json, casadi, onnx, shipmmg, pvs, gazebo or vrx (docs/formats.md).")],
    out: Annotated[Path, Option(help="Folder or file to write.")],
    without: Annotated[list[str] | None, Option(help="Leave out this effect of the ship; may be repeated.")] = None,
    force: Annotated[
        bool,
        Option("--force", help="Deliver also what did not converge or was never calibrated; replace what exists."),
    ] = False,
    json: Annotated[bool, Option("--json", help="Print what was written, and its caveats, as JSON.")] = False,
) -> None:
    """Deliver a calibrated or hybrid ship: code that runs without this program.

    What did not converge and what was never calibrated is refused; with --force it leaves, and says so itself.

    Example: mmg export runs/first --format c --out ship_c

    Example: mmg export runs/first --format casadi --out ship_casadi
    """
    from delivery.export import export as write
    from delivery.product import product_of

    product = product_of(model, force, names_of(without))
    write(product, format, out, force)
    if json:
        print_json({"format": format, "out": str(out), **product.about()})
        return
    for caveat in product.caveats:
        say(f"note: {caveat}")
    say(f"written: {out}")

"""``mmg ships``: the ships that come with the package, and a starting ship from main particulars."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Annotated

from typer import Argument, Option

from mmg.errors import Conflict, Missing, writing
from mmg_ident.commands import options as o
from mmg_ident.commands import output as cli


def ships(
    name: Annotated[
        str | None,
        Argument(help="Ship, ship file or run folder to print.", metavar="SHIP", autocompletion=cli.ship_names),
    ] = None,
    new: Annotated[
        list[str] | None,
        Option(
            help="Main particulars, SI: L B d C_b [D_P pitch_ratio A_R U_0] in this order, or NAME=VALUE (also x_G, "
            "aspect_ratio, rho, rudder_rate in rad/s, A_T, y_P for twin screws, D_BT for a bow thruster, ...); "
            "A_R=0 for no rudder; D_az, x_az, y_az, x_az_2, ... for pods."
        ),
    ] = None,
    called: Annotated[str | None, Option("--name", help="Name of the new ship; default from --out.")] = None,
    hull: Annotated[
        str | None,
        Option(help="Hull model: unified, harbour (linear damping too; default with pods) or polynomial (ahead)."),
    ] = None,
    out: Annotated[Path | None, Option(help="Ship file to write; default: print it.")] = None,
    force: o.Force = False,
    json: o.Json = False,
) -> None:
    """List the ships that come with the package, print one as a ship file, or write a starting ship of your own.

    Example: mmg ships esso_osaka_3m > my_ship.toml

    Example: mmg ships --new 320 58 20.8 0.81 9.86 0.72 112.5 7.97 --out my_ship.toml
    """
    from cases.io.files import replace_text
    from cases.shipfiles.new_ship import new_ship, parse_particulars
    from cases.shipfiles.ship_file import dump_ship, dump_ship_json, library, load_ship
    from mmg.messages import has_code

    if name is not None and new:
        raise Conflict(f"give either a ship ({name}) or --new, one of them")
    if name is not None or new:
        called = called or (out.stem if out else "my_ship")
        ship = new_ship(called, parse_particulars(new), hull) if new else load_ship(str(name))
        for notice in ship.notices if new else ():
            cli.say(f"{'warning' if has_code([notice], 'unusual_particular') else 'note'}: {notice}")
        text = dump_ship(ship, _HEAD if new else "")
        if out is not None:
            cli.refuse_target("--out", out, force)
            with writing(out):
                replace_text(out, text)
            cli.say(f"{ship.name}: {len(ship.coefficients)} coefficients, written to {out}")
        else:
            sys.stdout.write(dump_ship_json(ship) if json else text)  # as the file: no line end of print behind it
        return
    if out is not None:
        raise Missing("--out needs a ship to write: name one, or describe it with --new")
    ships_of = {key: load_ship(key) for key in library()}
    if json:
        summaries = [
            {"name": key, "description": ship.description, "L": ship.particulars["L"],
             "model": dict(ship.components), "coefficients": len(ship.coefficients)}
            for key, ship in ships_of.items()
        ]  # fmt: skip
        cli.print_json({"ships": summaries})
        return
    table = []
    for key, ship in ships_of.items():
        models = ", ".join(f"{role} {model}" for role, model in ship.components.items())
        table.append((key, f"{ship.particulars['L']:g}", str(len(ship.coefficients)), models))
    cli.print_table(("name", "L [m]|n", "coefficients|n", "models"), table)


_HEAD = """Starting ship from main particulars, by regressions of the literature: expect errors of a quarter in turning
circles and of 40 % in overshoots. Calibrate it on trials with mmg fit; correct by hand what you know better."""

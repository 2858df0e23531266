"""``mmg ships``: the ships that come with the package."""

from __future__ import annotations

import sys
from typing import TYPE_CHECKING, Annotated, Any

import typer

if TYPE_CHECKING:
    from mmg.ship import Ship


def ships(
    name: Annotated[str | None, typer.Argument(help="Ship, ship file or run folder to print as TOML.")] = None,
    json: Annotated[bool, typer.Option("--json", help="Print as JSON.")] = False,
) -> None:
    """List the ships that come with the package, or print one as a ship file.

    Example: mmg ships esso_osaka_3m > my_ship.toml
    """
    from cases.ships import dump_ship, library, load_ship
    from commands.output import print_json

    if name is not None:
        ship = load_ship(name)
        if json:
            print_json(_document(ship))
        else:
            sys.stdout.write(dump_ship(ship))
        return
    known = {key: load_ship(key) for key in library()}
    if json:
        print_json({"ships": [_row(key, ship) for key, ship in known.items()]})
        return
    rows = [("name", "L [m]", "coefficients", "models")]
    for key, ship in known.items():
        models = ", ".join(f"{role} {model}" for role, model in ship.components.items())
        rows.append((key, f"{ship.particulars['L']:g}", str(len(ship.coefficients)), models))
    widths = [max(len(row[i]) for row in rows) for i in range(3)]
    for a, b, c, models in rows:
        print(f"{a:<{widths[0]}}  {b:>{widths[1]}}  {c:>{widths[2]}}  {models}")


def _row(key: str, ship: Ship) -> dict[str, Any]:
    return {
        "name": key,
        "description": ship.description,
        "L": ship.particulars["L"],
        "model": dict(ship.components),
        "coefficients": len(ship.coefficients),
    }


def _document(ship: Ship) -> dict[str, Any]:
    """A ship file as JSON: the same tables; bounds that are infinite are null."""
    import dataclasses
    import math

    def plain(value: Any) -> Any:
        return None if isinstance(value, float) and not math.isfinite(value) else value

    return {
        "ship": {"name": ship.name, "description": ship.description, "reference": ship.reference}
        | dict(ship.particulars),
        "model": dict(ship.components),
        "coefficients": {
            symbol: {key: plain(value) for key, value in dataclasses.asdict(c).items() if key != "symbol"}
            for symbol, c in ship.coefficients.items()
        },
    }

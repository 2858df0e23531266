"""``mmg effects``: the effects that can be simulated, freed and screened."""

from __future__ import annotations

from typing import Annotated, Any

from typer import Argument, Option

from mmg.errors import UnknownName
from mmg_ident.commands import options as o
from mmg_ident.commands import output as cli


def effects(
    name: Annotated[str | None, Argument(help="One effect: its physics and its parameters.")] = None,
    ship: Annotated[str, Option(help="Ship for whose size and models the numbers are given.")] = "esso_osaka_3m",
    json: o.Json = False,
) -> None:
    """List the effects, or explain one: parameters, neutral value, typical size, where it enters.

    Example: mmg effects current
    """
    from cases.shipfiles.effects import parameters
    from cases.shipfiles.ship_file import load_ship
    from mmg.effects import EFFECTS

    if name is not None and name not in EFFECTS:
        raise UnknownName(f"unknown effect '{name}'; known: {', '.join(sorted(EFFECTS))}")
    model = load_ship(ship)
    rows: list[dict[str, Any]] = [
        {"name": key, "enters": EFFECTS[key].enters, "needs": list(EFFECTS[key].needs),
         "physics": EFFECTS[key].summary, "parameters": [vars(p) for p in parameters(model, key)]}
        for key in ([name] if name else sorted(EFFECTS))
    ]  # fmt: skip
    if json:
        cli.print_json({"ship": model.name, "effects": rows})
        return
    if name:
        print(f"{name} (enters: {rows[0]['enters']})\n\n{rows[0]['physics']}\n")
    print(f"for {model.name}; * held in a fit unless named (--with NAME:PARAMETER)")
    lines = [
        (f"{row['name']}:{p['symbol']}", f"{p['neutral']:.4g}", f"{p['typical']:.3g}",
         f"{p['unit'] or '-'}{'*' * p['held']}", p["description"])
        for row in rows for p in row["parameters"]
    ]  # fmt: skip
    cli.print_table(("effect:parameter", "neutral|n", "typical|n", "unit", ""), lines)

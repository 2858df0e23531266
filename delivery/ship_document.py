"""The ship file and its JSON as products: one file that holds the whole ship, its network too, and reads back exactly.

``mmg`` takes both wherever it takes a ship.
"""

from __future__ import annotations

from pathlib import Path

from cases.shipfiles.ship_file import dump_whole_ship
from cases.shipfiles.ship_json import dump_ship_json
from delivery.product import Product


def write_toml(product: Product, target: Path) -> None:
    """Write ``product`` to the ship file ``target``: values, standard errors, verdicts; provenance as comments."""
    source = product.provenance
    origin = f"{product.ship.title}, exported by mmg export from {source['source']}"
    lines = [f"{origin}; std is the standard error of each estimate."]
    if source.get("created"):
        lines.append(f"Calibrated {source['created']} by {source.get('command') or 'mmg'}.")
    for name, (low, high) in product.ranges.items():
        lines.append(f"The trials held {name} from {low:.4g} to {high:.4g} (SI).")
    lines += [f"Mind: {words}." for words in product.caveats]
    target.write_text(dump_whole_ship(product.ship, "\n".join(lines)), encoding="utf-8")


def write_json_ship(product: Product, target: Path) -> None:
    """Write ``product`` as JSON to the file ``target``: every number with its unit, and where the ship comes from."""
    about = {key: value for key, value in product.about().items() if key != "coefficients"}
    target.write_text(dump_ship_json(product.ship, {"product": about}), encoding="utf-8")

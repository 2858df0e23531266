"""The network of a hybrid ship inside a ship file: the table [network], so that one file holds the whole ship.

Either ``file``, the name of a network file beside the ship file, or the numbers themselves: ``features``,
``feature_scales`` and the range ``lower``, ``upper`` of each, ``output_scales``, and per member its ``weights`` (one
matrix per layer, by rows) and ``biases`` (of the hidden layers).
"""

from __future__ import annotations

import json
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np
from pydantic import Field

from cases.io.toml_file import Name, Section
from cases.shipfiles.network_file import load_network
from cases.shipfiles.schema import Bound
from mmg.errors import BadValue, Missing, UserError
from mmg.network import Layers, Network
from mmg.ship import Ship

PLAIN = ("feature_scales", "output_scales", "lower", "upper")


class MemberTable(Section):
    """it holds weights and biases of one network"""

    weights: list[list[list[float]]]
    biases: list[list[float]]


class NetworkTable(Section):
    """it holds a learned residual, or the name of its file"""

    file: Name = ""
    features: list[str] = Field(default_factory=list)
    feature_scales: list[float] = Field(default_factory=list)
    lower: list[Bound] = Field(default_factory=list)
    upper: list[Bound] = Field(default_factory=list)
    output_scales: list[float] = Field(default_factory=list)
    members: list[MemberTable] = Field(default_factory=list)


def network_of(table: NetworkTable, ship: Ship, folder: Path | None) -> Network:
    """The network in a ``table`` of the file of ``ship``, which lies in ``folder`` (None: it is a text on its own).

    Raises UserError where it cannot be read or does not fit the ship.
    """
    if table.file:
        if folder is None:
            raise Missing(f"[network] file = '{table.file}': a text has no folder; read the ship file itself")
        return load_network(folder / table.file, ship)
    try:
        members = tuple(Layers(_arrays(m.weights, 2), _arrays(m.biases, 1)) for m in table.members)
        arrays = {name: np.array(getattr(table, name), dtype=float) for name in PLAIN}
    except ValueError:
        raise BadValue("[network] the rows of a matrix must be of one length") from None
    network = Network(tuple(table.features), members=members, **arrays)
    try:
        network.check(ship.name, ship.actuators)
    except UserError as error:
        raise type(error)(f"[network] {error}") from None
    return network


def _arrays(rows: Iterable[Any], dimensions: int) -> tuple[np.ndarray, ...]:
    found = tuple(np.array(r, dtype=float) for r in rows)
    if any(a.ndim != dimensions for a in found):
        raise ValueError("ragged")
    return found


def network_table(network: Network) -> dict[str, Any]:
    """The table of a ``network``: lists of numbers, ranges that are not known as infinite ones."""
    members = [
        {"weights": [W.tolist() for W in m.weights], "biases": [b.tolist() for b in m.biases]} for m in network.members
    ]
    arrays: dict[str, Any] = {name: getattr(network, name).tolist() for name in PLAIN}
    return {"features": list(network.features), **arrays, "members": members}


def network_text(network: Network) -> str:
    """The table of a ``network`` as TOML, every number with all its digits."""
    table = network_table(network)
    lines = ["[network]", f"features = {json.dumps(table['features'])}"]
    lines += [f"{name} = {table[name]!r}" for name in PLAIN]
    for member in table["members"]:
        lines += ["", "[[network.members]]", f"weights = {member['weights']!r}", f"biases = {member['biases']!r}"]
    return "\n".join(lines) + "\n"

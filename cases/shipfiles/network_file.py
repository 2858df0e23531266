"""Network files: the network of a hybrid ship as safetensors, beside its ``ship.toml``.

Tensors are float64; the metadata say for which ship it was trained (a hash of particulars and components, not of the
coefficients, which may be edited) and name its features.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from safetensors import SafetensorError, safe_open

from cases.io.files import parse_json
from cases.io.tensors import read_tensors, save_tensors
from mmg.errors import BadValue, Conflict, NotWritable, UserError
from mmg.network import OTHER, Layers, Network
from mmg.ship import Ship

NETWORK = "network.safetensors"
"""Its name in a run folder."""
FORMAT, BLACK_BOX = "mmg network 1", "mmg black box 1"
"""Formats of a network on a ship and of one that stands alone (``residual.papers.black_box``)."""
_PLAIN = ("feature_scales", "output_scales", "lower", "upper")


def ship_hash(ship: Ship) -> str:
    """Hash of a ``ship``: text that differs between ships of different particulars or force models."""
    what = [sorted(ship.particulars.items()), sorted(ship.components.items())]
    return hashlib.sha256(json.dumps(what).encode()).hexdigest()[:16]


def is_black_box(where: str | Path) -> bool:
    """Whether the file or run folder ``where`` holds a network that stands alone instead of a ship."""
    path = Path(where) / NETWORK if Path(where).is_dir() else Path(where)
    if path.suffix != ".safetensors" or not path.is_file() or path.with_name("ship.toml").exists():
        return False
    try:
        with safe_open(path, framework="numpy") as file:
            return (file.metadata() or {}).get("format") == BLACK_BOX
    except (OSError, SafetensorError, ValueError, TypeError):
        return False


def save_network(path: str | Path, network: Network, ship: Ship) -> None:
    """Write the ``network`` of a ``ship`` to ``path``. Raises UserError where it does not fit the ship or cannot
    be written.
    """
    network.check(ship.name, ship.actuators)
    arrays = {name: getattr(network, name) for name in _PLAIN}
    for k, member in enumerate(network.members):
        arrays |= {f"{k}.weight.{i}": W for i, W in enumerate(member.weights)}
        arrays |= {f"{k}.bias.{i}": b for i, b in enumerate(member.biases)}
    about = {"format": FORMAT, "ship": ship.name, "ship_hash": ship_hash(ship)}
    about |= {"features": json.dumps(network.features), "members": str(len(network.members))}
    try:
        save_tensors(Path(path), {name: np.asarray(a, dtype=float) for name, a in arrays.items()}, about)
    except (OSError, SafetensorError) as error:
        raise NotWritable(f"{path}: cannot be written ({error})") from None


def load_network(path: str | Path, ship: Ship) -> Network:
    """The network of a ``ship`` in the file ``path``. Raises UserError when it cannot be read or is another ship's."""
    about, arrays = read_tensors(Path(path), FORMAT, "network file")
    if about.get("ship_hash") != ship_hash(ship):
        raise Conflict(
            f"{path}: {OTHER}: it was trained on {about.get('ship') or 'a ship'}, whose particulars or "
            f"force models differ from those of {ship.name or 'this ship'}; train it again or remove the file"
        )
    try:
        features = tuple(str(name) for name in parse_json(about["features"]))
        members = tuple(_member(arrays, k) for k in range(members_in(about, arrays)))
        network = Network(features, members=members, **{name: arrays[name] for name in _PLAIN})
    except (KeyError, ValueError, TypeError) as error:
        raise BadValue(f"{path}: is incomplete ({error}); train it again") from None
    try:
        network.check(ship.name, ship.actuators)
    except UserError as error:
        raise type(error)(f"{path}: {error}") from None
    return network


def members_in(about: Mapping[str, str], arrays: Mapping[str, Any]) -> int:
    """How many networks a file holds, by what it says ``about`` itself. Raises KeyError or ValueError for a number that
    its ``arrays`` cannot be."""
    count = int(about["members"])
    if not 0 < count <= len(arrays):
        raise ValueError(f"{count} members in {len(arrays)} arrays")
    return count


def _member(arrays: dict[str, np.ndarray], k: int) -> Layers:
    """Member k; its layers are numbered from 0 without gaps."""
    counts = {kind: sum(name.startswith(f"{k}.{kind}.") for name in arrays) for kind in ("weight", "bias")}
    return Layers(*(tuple(arrays[f"{k}.{kind}.{i}"] for i in range(count)) for kind, count in counts.items()))

"""Network files: the network of a hybrid ship as safetensors, beside its ``ship.toml``.

Tensors are float64; the metadata say for which ship it was trained (a hash of particulars and components, not of the
coefficients, which may be edited) and name its features.
"""

from __future__ import annotations

import hashlib
import json
import math
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Annotated, Any

import numpy as np
from pydantic import AfterValidator, Field
from safetensors import SafetensorError, safe_open
from safetensors.numpy import save

from cases.io.files import check_file, parse_json
from cases.io.toml_file import Section
from mmg.errors import BadValue, Conflict, NotWritable, Unreadable, UserError
from mmg.network import OTHER, Layers, Network
from mmg.ship import Ship

NETWORK = "network.safetensors"  # Its name in a run folder
# Formats of a network on a ship and of one that stands alone (``residual.papers.black_box``).
FORMAT, BLACK_BOX = "mmg network 1", "mmg black box 1"


def _not_nan(value: float) -> float:
    if math.isnan(value):
        raise ValueError("must be a number or inf")
    return value


Bound = Annotated[float, Field(allow_inf_nan=True), AfterValidator(_not_nan)]  # Of a file, may be infinite
PLAIN = ("feature_scales", "output_scales", "lower", "upper")


def ship_hash(ship: Ship) -> str:
    """Hash of a ``ship``: text that differs between ships of different particulars or force models."""
    # as floats, which a ship file reads: 3 and 3.0 are the same length
    numbers = {name: float(value) for name, value in ship.particulars.items()}
    what = [sorted(numbers.items()), sorted(ship.components.items())]
    return hashlib.sha256(json.dumps(what).encode()).hexdigest()[:16]


def is_black_box(where: str | Path) -> bool:
    """Whether the file or run folder ``where`` holds a network that stands alone instead of a ship."""
    try:
        path = Path(where) / NETWORK if Path(where).is_dir() else Path(where)
        if path.suffix != ".safetensors" or not path.is_file() or path.with_name("ship.toml").exists():
            return False
        with safe_open(path, framework="numpy") as file:
            return (file.metadata() or {}).get("format") == BLACK_BOX
    except (OSError, SafetensorError, ValueError, TypeError):
        return False


def save_network(path: str | Path, network: Network, ship: Ship) -> None:
    """Write the ``network`` of a ``ship`` to ``path``. Raises UserError where it does not fit the ship or cannot be
    written."""
    network.check(ship.name, ship.actuators)
    arrays = {name: getattr(network, name) for name in PLAIN}
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
        network = Network(features, members=members, **{name: arrays[name] for name in PLAIN})
    except (KeyError, ValueError, TypeError) as error:
        raise BadValue(f"{path}: is incomplete ({error}); train it again") from None
    return _fitting(network, ship, f"{path}:")


def _fitting(network: Network, ship: Ship, where: str) -> Network:
    """The ``network``, if it fits the ``ship``. Raises UserError, which begins with ``where``, where it does not."""
    try:
        network.check(ship.name, ship.actuators)
    except UserError as error:
        raise type(error)(f"{where} {error}") from None
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


class MemberTable(Section):
    """it holds weights and biases of one network"""

    weights: list[list[list[float]]]
    biases: list[list[float]]


class NetworkTable(Section):
    """it holds a learned residual"""

    features: list[str] = Field(default_factory=list)
    feature_scales: list[float] = Field(default_factory=list)
    lower: list[Bound] = Field(default_factory=list)
    upper: list[Bound] = Field(default_factory=list)
    output_scales: list[float] = Field(default_factory=list)
    members: list[MemberTable] = Field(default_factory=list)


def network_of(table: NetworkTable, ship: Ship) -> Network:
    """The network in a ``table`` of the file of ``ship``. Raises UserError where it cannot be read or does not fit."""
    try:
        members = tuple(Layers(_arrays(m.weights, 2), _arrays(m.biases, 1)) for m in table.members)
        arrays = {name: np.array(getattr(table, name), dtype=float) for name in PLAIN}
    except ValueError:
        raise BadValue("[network] the rows of a matrix must be of one length") from None
    return _fitting(Network(tuple(table.features), members=members, **arrays), ship, "[network]")


def _arrays(rows: Iterable[Any], dimensions: int) -> tuple[np.ndarray, ...]:
    arrays = tuple(np.array(r, dtype=float) for r in rows)
    if any(a.ndim != dimensions for a in arrays):
        raise ValueError("ragged")
    return arrays


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


def save_tensors(path: Path, arrays: Mapping[str, np.ndarray], about: Mapping[str, str]) -> None:
    """Write ``arrays``, such as (K, N), with the metadata ``about`` to ``path``; equal content gives equal bytes.

    The library itself writes metadata in an order that changes from run to run: here it is that of the alphabet.
    Raises OSError where the file cannot be written, SafetensorError for arrays of a kind that the format lacks.
    """
    content = save({name: np.ascontiguousarray(array) for name, array in arrays.items()}, dict(about))
    end = 8 + int.from_bytes(content[:8], "little")  # safetensors: length of the header, header (JSON), numbers
    header = json.loads(content[8:end])
    header = {"__metadata__": dict(sorted(about.items())), **{k: v for k, v in header.items() if k != "__metadata__"}}
    text = json.dumps(header, separators=(",", ":")).encode()
    text += b" " * (-len(text) % 8)  # numbers begin at a multiple of eight bytes
    path.write_bytes(len(text).to_bytes(8, "little") + text + content[end:])
    path.chmod(0o644)


def read_tensors(path: Path, form: str, what: str) -> tuple[dict[str, str], dict[str, np.ndarray]]:
    """The metadata and the arrays, such as (K, N), of the file ``path`` of this ``form``; what: it is, in words. Raises
    UserError where it cannot be read or is of another form."""
    check_file(path)
    try:
        with safe_open(path, framework="numpy") as file:
            about = file.metadata() or {}
            arrays = {name: np.asarray(file.get_tensor(name), dtype=float) for name in file.keys()}  # noqa: SIM118
    except (OSError, SafetensorError, ValueError, TypeError) as error:
        raise Unreadable(f"{path}: cannot be read as a {what} ({error}); train it again") from None
    if about.get("format") != form:
        raise BadValue(f"{path}: is no {what} of this program (format {about.get('format')!r}, not {form!r})")
    return about, arrays

"""The ship for MATLAB and Octave: an M file of words, states and inputs, the C ship as MEX source, an example."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from delivery.c.source import COLUMNS, FEATURES, FORCES, RATES, SETTLED, approach, c_files, equations
from delivery.product import Product, filled, unit_of
from mmg.compile.portable import WHEN, MEmitter, m_number
from mmg.errors import Unsupported
from mmg.model import INVERSIONS
from mmg.ship import Ship

TEMPLATES = Path(__file__).parent / "templates"


def write_matlab(product: Product, target: Path) -> None:
    """Write the MATLAB product of ``product`` into the folder ``target``. Raises UserError where it cannot hold it."""
    p, fields = product.identifier, [c.identifier for c in product.coefficients]
    files = c_files(product) | {
        f"{p}.m": function_m(product),
        f"{p}_mex.c": filled(TEMPLATES / "gateway.c", product, FIELDS=", ".join(f'"{name}"' for name in fields)),
        "example_turn.m": example_m(product),
        "README.md": filled(TEMPLATES / "README.md", product, FIRST=fields[0]),
    }
    for name, text in files.items():
        (target / name).write_text(text, encoding="utf-8", newline="\n")


def example_m(product: Product) -> str:
    """A script that steers ``product`` through 600 s with the rudder held."""
    controls, (speed, inputs) = list(product.model.controls), approach(product)
    settings = "".join(f"inputs({controls.index(name) + 1}) = {x!r};  % {name}\n" for name, x in inputs.items())
    # M counts from 1
    clock = f"  inputs({controls.index('time') + 1}) = 0.1 * (k - 1);\n" if "time" in controls else ""
    return filled(TEMPLATES / "example_turn.m", product, SETTINGS=settings, SPEED=speed, CLOCK=clock)


def m_text(words: str) -> str:
    """M string of these ``words``: ASCII, one line."""
    plain = " ".join(words.split()).encode("ascii", "replace").decode()
    return "'" + plain.replace("'", "''") + "'"


def m_column(name: str, values: np.ndarray) -> str:
    """Statement that gives ``name`` the matrix of ``values`` (N, M) or the column of (N,)."""
    rows = np.atleast_2d(values.T).T
    return f"{name} = [\n" + "\n".join(" ".join(m_number(float(x)) for x in row) for row in rows) + "];"


def function_m(product: Product) -> str:
    """The M file ``IDENTIFIER.m`` of a ``product``. Raises UserError for equations that cannot be written in it."""
    model, program, ship, ranges = product.model, equations(product), product.ship, product.ranges
    emitter = MEmitter(program, {0: "state({0})", 1: "inputs({0})", 2: "theta({0})"}, {})

    def body(output: int, target: str, rows: int) -> list[str]:
        places = program.results[output]
        columns = len(places) // max(rows, 1)
        values = [[emitter.name(places[i + j * rows]) for j in range(columns)] for i in range(rows)]  # by columns
        text = "; ...\n    ".join(", ".join(row) for row in values)
        return [*emitter.statements(program.needed([output])), f"{target} = [{text}];"]

    S, F = len(model.states), len(ship.features)
    try:
        functions = {
            "rates = rates_of(state, inputs, theta)": body(RATES, "rates", S),
            "forces = forces_of(state, inputs, theta)": body(FORCES, "forces", len(model.roles)),
            "columns = columns_of(state, theta)": body(COLUMNS, "columns", 6),
            "state = settled(state, inputs, theta)": body(SETTLED, "state", S),
            "features = features_of(state, inputs, theta)": body(FEATURES, "features", F),
        }
    except NotImplementedError as error:
        raise Unsupported(f"the equations of this ship cannot be written in M ({error})") from None
    if ship.network:  # the program holds the ship without it
        added = "rates(4:6) = rates(4:6) + network(features_of(state, inputs, theta));"
        functions["rates = rates_of(state, inputs, theta)"].append(added)
    lines = [f"% {line}".encode("ascii", "replace").decode().replace("\n", " ") for line in product.sentences]
    named = {
        "states": model.states, "state_units": [unit_of(s) for s in model.states], "inputs": model.controls,
        "input_units": [unit_of(s) for s in model.controls], "roles": model.roles,
    }  # fmt: skip
    ends = zip(("low", "high"), np.array(list(ranges.values())).reshape(-1, 2).T, strict=True)
    low, high = (m_column(word, values) for word, values in ends)
    return filled(
        TEMPLATES / "ship.m", product, ABOUT="\n".join(lines), STATES=", ".join(model.states),
        INPUTS=", ".join(model.controls), FUNCTIONS=functions.items(), **_network_words(ship),
        MEASURED=model.measured, INVERSIONS=INVERSIONS, RANGES=ranges, LOW=low, HIGH=high, SLOW=product.slow_squared,
        FEATURE={name: i for i, name in enumerate(ship.features, 1)}, number=_number, text=m_text, NAME=ship.called,
        SENTENCES=" ".join(product.sentences), COEFFICIENTS=product.coefficients, WHEN=WHEN,
        NAMED={name: ", ".join(map(m_text, words)) for name, words in named.items()},
    )  # fmt: skip


def _number(x: float | None) -> str:
    """M text of ``x``, of which None is not known."""
    return "NaN" if x is None else m_number(x)


def _network_words(ship: Ship) -> dict[str, Any]:
    """What the template takes of the network of a ``ship``.

    Its matrices are made once: Octave takes longer to read them than to use them.
    """
    network = ship.network
    if network is None:
        return {"MEMBERS": ()}
    made = [m_column("c.features", network.feature_scales), m_column("c.outputs", network.output_scales)]
    for k, member in enumerate(network.members, 1):  # c.W1_2: layer 2 of member 1
        for i, (W, b) in enumerate(zip(member.weights[:-1], member.biases, strict=True), 1):
            made += [m_column(f"c.W{k}_{i}", W), m_column(f"c.b{k}_{i}", b)]
        made.append(m_column(f"c.W{k}", member.weights[-1]))
    places = [ship.features.index(name) + 1 for name in network.features]
    return {"MEMBERS": [len(m.biases) for m in network.members], "WEIGHTS": made, "PLACES": places}

"""The ship for MATLAB and Octave: an M file of words, states and inputs, the C ship as MEX source, an example."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from delivery.c.source import COLUMNS, FEATURES, FORCES, RATES, SETTLED, approach, c_files, equations
from delivery.product import Product, filled, unit_of
from mmg.compile.portable_m import WHEN, MEmitter, m_number
from mmg.errors import Unsupported
from mmg.model import INVERSIONS
from mmg.network import Network

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
    model, program = product.model, equations(product)
    emitter = MEmitter(program, {0: "state({0})", 1: "inputs({0})", 2: "theta({0})"})

    def body(output: int, target: str, rows: int) -> list[str]:
        places = program.results[output]
        columns = len(places) // max(rows, 1)
        values = [[emitter.name(places[i + j * rows]) for j in range(columns)] for i in range(rows)]
        text = "; ...\n    ".join(", ".join(row) for row in values)
        return [*emitter.statements(program.needed([output])), f"{target} = [{text}];"]

    lines = [f"% {line}" for line in product.sentences]
    words = "\n".join(line.encode("ascii", "replace").decode().replace("\n", " ") for line in lines)
    inputs = ", ".join(model.controls)
    try:
        S, F = len(model.states), len(product.ship.features)
        rates = [*body(RATES, "rates", S)]
        if product.ship.network:
            rates.append("rates(4:6) = rates(4:6) + network(features_of(state, inputs, theta));")
        parts = [
            filled(TEMPLATES / "ship.m", product, ABOUT=words, STATES=", ".join(model.states), INPUTS=inputs),
            _local("rates = rates_of(state, inputs, theta)", rates),
            _local("forces = forces_of(state, inputs, theta)", body(FORCES, "forces", len(model.roles))),
            _local("columns = columns_of(state, theta)", body(COLUMNS, "columns", 6)),
            _local("state = settled(state, inputs, theta)", body(SETTLED, "state", S)),
            _local("features = features_of(state, inputs, theta)", body(FEATURES, "features", F)),
        ]
    except NotImplementedError as error:
        raise Unsupported(f"the equations of this ship cannot be written in M ({error})") from None
    if product.ship.network:
        parts.append(_network(product.ship.network, product.ship.features))
    parts += [_settle(model.measured), _range(product), _parameters(product), WHEN]
    return "".join(parts)


def _local(head: str, lines: Sequence[str]) -> str:
    return f"\nfunction {head}\n  " + "\n  ".join(lines) + "\nend\n"


def _settle(measured: bool) -> str:
    """The state behind logged columns, as ``mmg.model.states_behind`` finds it."""
    lines = ["six = logged;", "state = settled(six, inputs, theta);"]
    if measured:
        lines += [
            f"for k = 1:{INVERSIONS}",
            "  difference = columns_of(state, theta) - logged;",
            "  six = six - difference;",
            "  state = settled(six, inputs, theta);",
            "  if ~(max(abs(difference)) > 1e-12)",
            "    break",
            "  end",
            "end",
        ]
    return _local("state = settle(logged, inputs, theta)", lines)


def _network(network: Network, features: Sequence[str]) -> str:
    """The network as products of matrices, which are made once: Octave takes longer to read them than to use them."""
    places = ", ".join(str(features.index(name) + 1) for name in network.features)
    lines = ["persistent c", "if isempty(c)", "  c = weights_of_network();", "end"]
    lines += [f"x = features([{places}]) ./ c.features;", "total = zeros(3, 1);"]
    made = [m_column("c.features", network.feature_scales), m_column("c.outputs", network.output_scales)]
    for k, member in enumerate(network.members, 1):
        lines.append("h = x;")
        for i, (W, b) in enumerate(zip(member.weights[:-1], member.biases, strict=True), 1):
            made += [m_column(f"c.W{k}_{i}", W), m_column(f"c.b{k}_{i}", b)]
            lines.append(f"h = tanh(c.W{k}_{i} * h + c.b{k}_{i}) - tanh(c.b{k}_{i});")
        made.append(m_column(f"c.W{k}", member.weights[-1]))
        lines.append(f"total = total + c.W{k} * h;")
    lines.append(f"added = c.outputs .* total / {len(network.members)};")
    return _local("added = network(features)", lines) + _local("c = weights_of_network()", made)


def _range(product: Product) -> str:
    """Distance to what the trials held, as the C source has it."""
    ranges, features = product.ranges, product.ship.features
    if not ranges:
        return _local("e = extrapolation(state, inputs, theta)", ["e = -1;"])
    u, v = (f"f({features.index(axis) + 1})" for axis in "uv")
    lines = ["if ~all(isfinite(state))", "  e = realmax;", "  return", "end", "f = features_of(state, inputs, theta);"]
    lines.append(f"x = zeros({len(ranges)}, 1);")
    for k, name in enumerate(ranges, 1):
        if name in features:
            lines.append(f"x({k}) = f({features.index(name) + 1});")
        else:
            fastest = max(abs(x) for x in ranges["u"])
            lines += [f"x({k}) = {m_number(0.5 * sum(ranges[name]))};", f"if {u}^2 + {v}^2 > {(0.1 * fastest) ** 2!r}",
                      f"  x({k}) = atan2(-{v}, {u});", "end"]  # fmt: skip
    low, high = (
        m_column(word, np.array([pair[i] for pair in ranges.values()])) for i, word in enumerate(("low", "high"))
    )
    lines += [low, high, "width = max(max(high - low, 0.1 * max(abs(low), abs(high))), 1e-12);"]
    return _local(
        "e = extrapolation(state, inputs, theta)", [*lines, "e = max(max(max(x - high, low - x), 0) ./ width);"]
    )


def _parameters(product: Product) -> str:
    """The struct of parameters."""
    model = product.model

    def cell(names: Sequence[str]) -> str:
        return "{" + ", ".join(m_text(name) for name in names) + "}"

    def or_nan(x: float | None) -> str:
        return "NaN" if x is None or math.isnan(x) else m_number(x)

    lines = [
        f"p.ship = {m_text(product.ship.called)};",
        f"p.title = {m_text(product.ship.title)};",
        f"p.about = {m_text(' '.join(product.sentences))};",
        f"p.states = {cell(model.states)};",
        f"p.state_units = {cell([unit_of(s) for s in model.states])};",
        f"p.inputs = {cell(model.controls)};",
        f"p.input_units = {cell([unit_of(s) for s in model.controls])};",
        f"p.roles = {cell(model.roles)};",
        f"p.longest_step = {product.longest_step!r};",
        "p.ranges = struct();",
    ]
    for name, (low, high) in product.ranges.items():
        lines.append(f"p.ranges.{name} = [{m_number(low)}, {m_number(high)}];")
    for c in product.coefficients:
        fields: Mapping[str, str] = {
            "value": m_number(c.value), "std": or_nan(c.std), "unit": m_text(c.unit), "lower": m_number(c.lower),
            "upper": m_number(c.upper), "fixed": str(c.fixed).lower(), "verdict": m_text(c.verdict),
            "description": m_text(c.description), "symbol": m_text(c.symbol),
        }  # fmt: skip
        content = ", ".join(f"'{name}', {value}" for name, value in fields.items())
        lines.append(f"p.coefficients.{c.identifier} = struct({content});")
    return _local("p = parameters()", lines)

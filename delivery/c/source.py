"""The C product: its equations as one staged program, Runge-Kutta steps, derivatives, extrapolation, and an example.

The residual network of a hybrid ship in C is loops over arrays of weights, and its derivatives. Rows are filled up with
zeros to whole blocks, whose loops have a fixed length: compilers make vector instructions of them, and other code stays
in registers. ``step_many`` has the network of LANES ships: weights once, lanes inside.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from functools import reduce
from math import factorial
from pathlib import Path
from typing import Any

import casadi as ca
import numpy as np

from cases.maneuvers import self_propulsion
from delivery.product import Product, filled, identifiers, unit_of
from mmg.compile.codegen import Program
from mmg.compile.portable import LANES, LaneEmitter, PortableEmitter, functions_used, lane_functions, literal, prelude
from mmg.effects import effect
from mmg.errors import Unsupported, UserError
from mmg.model import INVERSIONS
from mmg.network import Layers, Network

# Rows of a block whose sums a compiler keeps in registers: one AVX-512 register, two AVX2 ones.
BLOCK = 8  # Set by hand: speed alone
# With |y| <= 0.625 a series of 15 terms is exact to rounding; doubled six times it serves |2 x| <= 40, beyond which
# tanh is 1 to rounding. Taylor's remainder bounds the error: 0.625^16 / 16! is 3e-17.
TERMS, DOUBLINGS = 15, 6


def array(name: str, values: np.ndarray) -> str:
    """C text of the constant array ``name`` with ``values`` (N,) in their order."""
    numbers = [literal(float(x)) for x in np.ravel(values)]
    lines = ",\n  ".join(", ".join(numbers[i : i + 4]) for i in range(0, len(numbers), 4))
    return f"static const real {name}[{len(numbers)}] = {{\n  {lines}}};\n"


def tanh_statements(x: str) -> str:
    """Statements that make p, exp(2 x) - 1, of the number with the name ``x``.

    Even and odd terms of the series are apart, so that both may be worked at once.
    """
    terms = [f"R({1 / factorial(k)!r})" for k in range(1, TERMS + 1)]  # of exp(h) - 1, from h on
    # by Horner's rule in q = h^2; terms of odd powers of h come first in the list
    odd, even = (reduce(lambda total, c: f"({total}) * q + {c}", reversed(terms[i::2])) for i in (0, 1))
    doubled = " ".join(["p = p * (p + R(2.0));"] * DOUBLINGS)  # exp(2 y) - 1 of p = exp(y) - 1
    halved = f"const real h = {x} * R({2.0 ** (1 - DOUBLINGS)!r});\n    const real q = h * h;"
    return f"{halved}\n    real p = ({odd}) * h + ({even}) * q;\n    {doubled}"


def _filled(values: np.ndarray, columns: int = 0) -> np.ndarray:
    """Rows of ``values`` (rows,) or (rows, N) filled up with zeros to whole blocks, and to so many ``columns``."""
    return np.pad(values, [(0, -len(values) % BLOCK), (0, columns - values.shape[-1])][: values.ndim])


class Member:
    """One network of a hybrid: its arrays, and the calls of its layers, as the templates take them.

    number: among the networks; share: by which its outputs are multiplied (3,).
    """

    def __init__(self, number: int, layers: Layers, scales: np.ndarray, share: np.ndarray) -> None:
        self.number, self.depth = number, len(layers.biases)
        columns = [len(scales), *(len(_filled(b)) for b in layers.biases)]
        self.shapes = list(zip(columns[1:], columns[:-1], strict=True))  # (rows, columns) of its layers, filled up
        self.width = columns[-1]
        weights = [layers.weights[0] / scales[None, :], *layers.weights[1:-1]]  # of features unscaled
        # transposed, (width, 4): du, dv, dr and a zero of one hidden neuron side by side
        last = np.zeros((self.width, 4))
        last[: len(layers.biases[-1]), :3] = (share[:, None] * layers.weights[-1]).T
        self.arrays = ""
        for i, (W, b) in enumerate(zip(weights, layers.biases, strict=True)):
            # (blocks, columns, BLOCK): the loop over columns then reads the weights one after the other
            blocks = _filled(W, columns[i]).reshape(-1, BLOCK, columns[i]).transpose(0, 2, 1)
            rows = {"weight": blocks, "bias": _filled(b), "offset": _filled(np.tanh(b))}
            self.arrays += "".join(array(f"network_{number}_{name}_{i}", values) for name, values in rows.items())
        self.arrays += array(f"network_{number}_last", last)

    def _constants(self, i: int) -> str:
        return ", ".join(f"network_{self.number}_{name}_{i}" for name in ("weight", "bias", "offset"))

    def layers(self, *results: str) -> list[str]:
        """Calls of its layers one after the other, from x into ``results`` in turn."""
        names, shapes = ["x", *(results[i % len(results)] for i in range(self.depth))], enumerate(self.shapes)
        return [f"{rows}x{n}({self._constants(i)}, {names[i]}, {names[i + 1]})" for i, (rows, n) in shapes]

    @property
    def lane_layers(self) -> list[str]:
        """The same calls for several ships at once, from x into two arrays in turn."""
        names, shapes = ["x", *(f"y[{i % 2}]" for i in range(self.depth))], enumerate(self.shapes)
        return [f"layer({self._constants(i)}, {rows}, {n}, {names[i]}, {names[i + 1]})" for i, (rows, n) in shapes]


def network_words(network: Network) -> dict[str, Any]:
    """What the templates of a ``network`` take."""
    share = network.output_scales / len(network.members)  # the members are added up: their mean needs no division
    members = [Member(k, m, network.feature_scales, share) for k, m in enumerate(network.members)]
    deepest = max(member.depth for member in members)
    return {
        "MEMBERS": members, "ARRAYS": [member.arrays for member in members], "DEEPEST": deepest,
        "SHAPES": sorted({shape for member in members for shape in member.shapes}),
        "WIDEST": max(max(map(max, member.shapes)) for member in members), "T": [f"t[{i}]" for i in range(deepest)],
        "BLOCK": BLOCK, "DOUBLINGS": DOUBLINGS, "SHARE": 2 ** (DOUBLINGS - 1), "tanh": tanh_statements,
    }  # fmt: skip


TEMPLATES = Path(__file__).parent / "templates"
LONGEST_STRING = 4000  # Most bytes of a string constant: C99 promises 4095. (C99, 5.2.4.1: a limit of translation.)


def quoted(text: str, most: int = LONGEST_STRING) -> str:
    """C string constant of ``text`` in UTF-8, of which at most ``most`` bytes are kept."""
    content = text.encode()[:most]  # may cut a character in two: bytes beyond ASCII are written as octal escapes
    plain = {ord('"'): '\\"', ord("\\"): "\\\\", ord("?"): "\\?", ord("\n"): "\\n"}
    return '"' + "".join(plain.get(b) or (chr(b) if 32 <= b < 127 else f"\\{b:03o}") for b in content) + '"'


def comment(lines: Iterable[str]) -> str:
    """C comment of these ``lines``: characters that are not ASCII become ?, and nothing in them ends it early."""
    safe = [line.encode("ascii", "replace").decode().replace("*/", "* /").replace("/*", "/ *") for line in lines]
    # no trigraphs, and no backslash at the end, which would join the next line
    safe = [line.replace("??", "? ?").rstrip("\\").rstrip() for line in safe]
    return "/* " + "\n * ".join(safe) + "\n */\n"


def number(value: float | None) -> str:
    """C text of the double ``value``; unknown (None) is -1, an infinite one DBL_MAX."""
    if value is None or math.isnan(value):
        return "-1.0"
    if math.isinf(value):
        return "DBL_MAX" if value > 0 else "-DBL_MAX"
    return repr(float(value))


def tables(product: Product) -> list[tuple[str, Sequence[str]]]:
    """Tables of a ``product``, empty ones left out: declaration, elements as C text."""
    model, coefficients = product.model, product.coefficients
    words, units = "const char *const", {s: c.unit for s, c in product.ship.coefficients.items()}
    named: list[tuple[str, str, Sequence[str]]] = [
        (words, "state_names", [quoted(s) for s in model.states]),
        (words, "state_units", [quoted(unit_of(s) or units.get(s, "")) for s in model.states]),
        (words, "input_names", [quoted(s) for s in model.controls]),
        (words, "input_units", [quoted(unit_of(s)) for s in model.controls]),
        (words, "role_names", [quoted(s) for s in model.roles]),
        (words, "coefficient_names", [quoted(c.symbol) for c in coefficients]),
        (words, "coefficient_units", [quoted(c.unit) for c in coefficients]),
        (words, "coefficient_verdicts", [quoted(c.verdict, 500) for c in coefficients]),
        (words, "coefficient_descriptions", [quoted(c.description, 500) for c in coefficients]),
        ("const double", "coefficient_defaults", [number(c.value) for c in coefficients]),
        ("const double", "coefficient_lower", [number(c.lower) for c in coefficients]),
        ("const double", "coefficient_upper", [number(c.upper) for c in coefficients]),
        ("const double", "coefficient_stds", [number(c.std) for c in coefficients]),
        (words, "range_names", [quoted(s) for s in product.ranges]),
        (words, "range_units", [quoted(unit_of(s)) for s in product.ranges]),
        ("const double", "range_lower", [number(low) for low, _ in product.ranges.values()]),
        ("const double", "range_upper", [number(high) for _, high in product.ranges.values()]),
    ]
    return [
        (f"{kind} {product.identifier}_{name}[{len(elements)}]", elements) for kind, name, elements in named if elements
    ]


def definitions(product: Product) -> str:
    """C text that defines the tables of a ``product`` and its words about itself."""
    text = [declared + " = {\n  " + ",\n  ".join(elements) + "};\n" for declared, elements in tables(product)]
    return (
        "".join(text) + f"const char {product.identifier}_about[] =\n  " + quoted("\n".join(product.sentences)) + ";\n"
    )


def header_c(product: Product, kept: int, more: str = "") -> str:
    """The header of a ``product`` whose coefficient stage leaves ``kept`` numbers behind. more: declarations after its
    own."""
    p, model = product.identifier, product.model
    S, C, P, R = (len(names) for names in (model.states, model.controls, model.symbols, model.roles))
    sizes = {"STATES": S, "INPUTS": C, "COEFFICIENTS": P, "ROLES": R, "COLUMNS": 6, "RANGES": len(product.ranges)}
    places = "".join(
        f"enum {{ {', '.join(f'{p}_{kind}_{name} = {i}' for i, name in enumerate(identifiers(names)))} }};\n"
        for kind, names in (("state", model.states), ("input", model.controls), ("role", model.roles))
    )
    return filled(
        TEMPLATES / "ship.h", product, PLACES=places, P1=max(P, 1), KEPT=max(kept, 1), MORE=more,
        ABOUT=comment([*product.sentences, "SI units and radians. Names and units are in the tables at the end."]),
        SIZES="".join(f"#define {p.upper()}_{name} {count}\n" for name, count in sizes.items()),
        TABLES="".join(f"extern {declared};\n" for declared, _ in tables(product)),
    )  # fmt: skip


# Stages: what depends on the coefficients alone, on these and the inputs, and on the state.
COEFFICIENTS, INPUTS, STATE = 1, 2, 3
# Outputs: rates without network (S,), forces (R, 3), logged columns (6,), state with settled memory (S,) from the first
# six, features (F,); derivatives of rates and features by state (S) and inputs (C), of logged columns by state.
EVERY = RATES, FORCES, COLUMNS, SETTLED, FEATURES, RATES_Z, RATES_C, FEATURES_Z, FEATURES_C, COLUMNS_Z = tuple(
    range(10)
)
RUDDER = 0.3  # Rudder angle [rad] of the turn in an example. Set by hand.
# Ships with more values than this are stepped one by one: their arrays would not fit into a small stack.
MOST_VALUES = 1500  # Set by hand: 12 kB a ship, 8 bytes a value


def equations(product: Product) -> Program:
    """The equations of a ``product`` without its network, whose accelerations other code adds, as one staged program.

    Arguments: state (S,), inputs (C,), coefficients (P,); outputs: EVERY.
    """
    model = product.model_of(product.ship.without_network())
    z, c = ca.SX.sym("state", len(model.states)), ca.SX.sym("inputs", len(model.controls))
    theta = ca.SX.sym("coefficients", len(model.symbols))
    rates, features, columns = model.rates(z, c, theta), model.features(z, c, theta), model.columns(z, theta)
    outputs = [rates, model.forces(z, c, theta), columns, model.initial(z[:6], c, theta), features]
    outputs += [ca.jacobian(of, by) for of in (rates, features) for by in (z, c)]
    outputs.append(ca.jacobian(columns, z))
    function = ca.Function("ship", [z, c, theta], outputs, {"cse": True})
    return Program.of(function, (STATE, INPUTS, COEFFICIENTS))


def source_c(product: Product, more: str = "") -> tuple[str, int]:
    """The whole source file of a ``product``, and how many numbers its coefficient stage leaves behind.

    more: functions after its own. Raises UserError for equations that cannot be written.
    """
    program, network, features = equations(product), product.ship.network, product.ship.features
    model, S, C = product.model, len(product.model.states), len(product.model.controls)
    shown = (RATES, FEATURES) if network else (RATES,)  # what a Runge-Kutta stage needs
    # what one stage leaves behind for the next: in the model until coefficients change, in a step while inputs are held
    kept = {place: f"model->kept[{i}]" for i, place in enumerate(program.handed_on(EVERY, COEFFICIENTS))}
    held = {place: f"held[{i}]" for i, place in enumerate(program.handed_on(shown, INPUTS))}
    arguments = {0: "state[{0}]", 1: "inputs[{0}]", 2: "model->coefficients[{0}]"}
    first, emitter, later = (PortableEmitter(program, arguments, known) for known in ({}, kept, kept | held))

    def stage(outputs: Sequence[int], after: int) -> list[int]:
        """Values of the one stage that follows ``after`` and lead to ``outputs``."""
        return [i for i in program.needed(outputs, after) if program.values[i].stage == after + 1]

    def stored(output: int, target: str, width: int = 1, by: PortableEmitter = emitter) -> list[str]:
        """Statements that store an output of ``width`` columns row by row in ``target``."""
        places = program.results[output]
        rows = len(places) // width
        order = [places[i + j * rows] for i in range(rows) for j in range(width)]  # CasADi has them column by column
        return [f"{target}[{i}] = {by.name(place)};" for i, place in enumerate(order)]

    def made(output: int, target: str, width: int = 1) -> list[str]:
        """Statements that lead to an output and store it."""
        return [*emitter.statements(program.needed([output], COEFFICIENTS)), *stored(output, target, width)]

    def passed(values: Mapping[int, str], by: PortableEmitter) -> list[str]:
        """Statements that hand ``values`` on to the next stage."""
        return [f"{text} = {by.name(place)};" for place, text in values.items()]

    try:
        # all of a function's outputs in one list of statements: what they share is computed once
        derivatives = [RATES_Z, RATES_C] + ([FEATURES, FEATURES_Z, FEATURES_C] if network else [])
        jacobians = emitter.statements(program.needed(derivatives, COEFFICIENTS))
        jacobians += stored(RATES_Z, "by_state", S) + stored(RATES_C, "by_inputs", C)
        state_stage = later.statements(program.needed(shown, INPUTS)) + stored(RATES, "rates", by=later)
        if network:
            state_stage += stored(FEATURES, "features", by=later)
            jacobians += stored(FEATURES, "features") + stored(FEATURES_Z, "feature_z", S)
            jacobians += stored(FEATURES_C, "feature_c", C)
        feature = {name: emitter.name(place) for name, place in zip(features, program.results[FEATURES], strict=True)}
        drift = ("u", "v") if any(name not in feature for name in product.ranges) else ()  # what beta is made of
        wanted = [program.results[FEATURES][features.index(n)] for n in (*drift, *product.ranges) if n in feature]
        words: dict[str, Any] = {
            "INIT": first.statements(stage(EVERY, 0)) + passed(kept, first),
            "INPUT_STAGE": emitter.statements(stage(shown, COEFFICIENTS)) + passed(held, emitter),
            "STATE_STAGE": state_stage, "JACOBIANS": jacobians, "FORCES": made(FORCES, "forces", 3),
            "COLUMNS": made(COLUMNS, "columns"), "SETTLED": made(SETTLED, "settled"),
            "COLUMNS_Z": made(COLUMNS_Z, "by_state", S), "FEATURE": feature,
            "RANGE_STATEMENTS": emitter.statements(program.leading_to(wanted, COEFFICIENTS)),
            "RANGES": product.ranges, "SLOW": product.slow_squared,
        }  # fmt: skip
        places = [features.index(name) for name in network.features] if network else []
        words |= {"F": len(features), "HELD": max(len(held), 1), "PLACES": places, "NETWORK": ""}
        if network:
            words |= network_words(network)
            words["NETWORK"] = filled(TEMPLATES / "network.c", product, **words)
        if len(program.needed(shown, COEFFICIENTS)) <= MOST_VALUES:
            words |= _lanes(product, program, shown, kept, held, words)
    except NotImplementedError as error:
        reason = f"the equations of this ship cannot be written as portable C ({error})"
        raise Unsupported(f"{reason}; leave the effect that needs it out with --without") from None
    used = sorted({*functions_used(program, EVERY), "fabs"})  # which the measure of extrapolation takes
    text = filled(
        TEMPLATES / "ship.c", product, **{"LANES": 0} | words, ABOUT=comment(product.sentences),
        PRELUDE=prelude(used, f"{product.identifier.upper()}_SINGLE"), TABLES=definitions(product),
        MEASURED=model.measured, INVERSIONS=INVERSIONS, MORE=more,
        UNDONE=["real", "R", *(f"m_{name}" for name in used)],
    )  # fmt: skip
    return text, len(kept)


def _lanes(
    product: Product,
    program: Program,
    shown: Sequence[int],
    kept: Mapping[int, str],
    held: Mapping[int, str],
    words: dict[str, Any],
) -> dict[str, Any]:
    """Words for ``step_many``: LANES ships at once in loops of fixed length; words: those of the network."""
    loop, arguments = f"for (l = 0; l < {LANES}; l++)", {0: "state[{0}][l]", 1: "inputs[{0}][l]"}
    arguments[2] = "model->coefficients[{0}]"
    lanes = {place: f"{text}[l]" for place, text in held.items()}
    first, later = (LaneEmitter(program, arguments, known) for known in (kept, {**kept, **lanes}))
    places = [i for i in program.needed(shown, COEFFICIENTS) if program.values[i].stage == INPUTS]
    rates = later.lines(program.needed(shown, INPUTS))
    rates += [f"{loop} rates[{i}][l] = {later.name(place)};" for i, place in enumerate(program.results[RATES])]
    at = program.results[FEATURES]
    rates += [f"{loop} x[{i}][l] = {later.name(at[place])};" for i, place in enumerate(words["PLACES"])]
    network = filled(TEMPLATES / "lanes_network.c", product, **words, LANES=LANES) if words["NETWORK"] else ""
    return {
        "LANES": LANES, "LANES_RATES": rates, "LANES_NETWORK": network,
        "LANES_INPUT": first.lines(places) + [f"{loop} {to} = {first.name(place)};" for place, to in lanes.items()],
        "LANE_FUNCTIONS": lane_functions(program, list(shown), tanh_statements("x[l]")),
    }  # fmt: skip


def c_files(product: Product) -> dict[str, str]:
    """Text of the header and of the source of a ``product``, by file name; the same product gives the same bytes.

    Raises UserError for an effect that C cannot hold and for equations that it cannot be written in.
    """
    for name in product.ship.effects:
        if effect(name).input_delay(product.ship.parameters_of(name)) is not None:
            late = f"feed it rudder and revolutions that late, and leave it out with --without {name}"
            raise Unsupported(f"the effect {name} is an exact delay, which the C code does not hold: {late}")
    (text, kept), p = source_c(product), product.identifier
    return {f"{p}.h": header_c(product, kept), f"{p}.c": text}


def write_c(product: Product, target: Path) -> None:
    """Write the C product of ``product`` into the folder ``target``. Raises UserError where C cannot hold it."""
    files = c_files(product) | {"example.c": example_c(product), "README.md": filled(TEMPLATES / "README.md", product)}
    for name, text in files.items():
        (target / name).write_text(text, encoding="utf-8", newline="\n")


def example_c(product: Product) -> str:
    """A program that steers ``product`` through 600 s with the rudder held, and prints its motion as CSV."""
    p, (speed, inputs) = product.identifier, approach(product)
    build = f"Compile: cc -std=c99 -O2 {p}.c example.c -lm -o example"
    timed = "time" in product.model.controls
    return filled(
        TEMPLATES / "example.c", product, SPEED=speed,
        ABOUT=comment(["How to use the ship: a turn of 600 s in steps of 0.1 s.", build]),
        SETTINGS="".join(f"  inputs[{p}_input_{name}] = ({p}_real){value!r};\n" for name, value in inputs.items()),
        CLOCK=f"    inputs[{p}_input_time] = ({p}_real)(0.1 * k);\n" if timed else "",
    )  # fmt: skip


def approach(product: Product) -> tuple[float, dict[str, float]]:
    """Speed [m/s] and inputs by name of the turn in an example of ``product``.

    It begins at the highest revolutions that the trials held and the speed that they give, else as ``mmg simulate``
    begins: at the ship's own speed.
    """
    ship, highest = product.ship, product.ranges.get("n", (0.0, 0.0))[1]
    try:
        speed, n = self_propulsion.approach(ship, highest if highest > 0 else None, None)
    except UserError:  # a ship before its calibration may hold no speed
        speed = self_propulsion.own_speed(ship)
        # at the advance coefficient 0.6 of a usual screw, of 3 % of the ship's length where it is not known; by hand
        n = speed / (0.6 * ship.particulars.get("D_P", 0.03 * ship.particulars["L"]))
    inputs = self_propulsion.actuator_positions(ship, n, RUDDER)
    named = {name: round(float(value), 3) for name, value in inputs.items() if name in product.model.controls}
    return round(speed, 3), {name: value for name, value in named.items() if value}  # inputs begin at zero

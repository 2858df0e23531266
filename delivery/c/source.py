"""The C product: its equations as one staged program, Runge-Kutta steps, derivatives, extrapolation, and an example."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import casadi as ca

from cases.maneuvers import self_propulsion
from delivery.c.header import TEMPLATES, about, comment, definitions, filled, header_c
from delivery.c.network import lanes_network_c, network_c, tanh_statements
from delivery.product import Product
from mmg.compile.portable_c import LANES, Emitter, LaneEmitter, functions_used, lane_functions, prelude
from mmg.compile.stages import Program
from mmg.effects import effect
from mmg.errors import Unsupported, UserError
from mmg.model import INVERSIONS, Model

COEFFICIENTS, INPUTS, STATE = 1, 2, 3
"""Stages: what depends on the coefficients alone, on these and the inputs, and on the state."""
EVERY = RATES, FORCES, COLUMNS, SETTLED, FEATURES, RATES_Z, RATES_C, FEATURES_Z, FEATURES_C = tuple(range(9))
"""Outputs: rates without network (S,), forces (R, 3), logged columns (6,), state with settled memory (S,) from the
first six, features (F,); derivatives of rates and features by state (S) and inputs (C)."""
RUDDER = 0.3
"""Rudder angle [rad] of the turn in an example."""
MOST_VALUES = 1500
"""Ships with more values than this are stepped one by one: their arrays would not fit into a small stack."""


def equations(product: Product) -> Program:
    """The equations of a ``product`` without its network, whose accelerations other code adds, as one staged program.

    Arguments: state (S,), inputs (C,), coefficients (P,); outputs: EVERY.
    """
    model: Model = product.model_of(product.ship.without_network())
    z, c = ca.SX.sym("state", len(model.states)), ca.SX.sym("inputs", len(model.controls))
    theta = ca.SX.sym("coefficients", len(model.symbols))
    rates, features = model.rates(z, c, theta), model.features(z, c, theta)
    outputs = [rates, model.forces(z, c, theta), model.columns(z, theta), model.initial(z[:6], c, theta), features]
    outputs += [ca.jacobian(of, by) for of in (rates, features) for by in (z, c)]
    function = ca.Function("ship", [z, c, theta], outputs, {"cse": True})
    return Program.of(function, (STATE, INPUTS, COEFFICIENTS))


class Source:
    """Writes the source of a product, part by part."""

    def __init__(self, product: Product) -> None:
        self.product, self.p, self.model = product, product.identifier, product.model
        self.program = equations(product)
        self.S, self.C, self.P = len(self.model.states), len(self.model.controls), len(self.model.symbols)
        self.features = product.ship.features
        self.network = product.ship.network
        self.kept = {place: f"model->kept[{i}]" for i, place in enumerate(self.program.handed_on(EVERY, COEFFICIENTS))}
        arguments = {0: "state[{0}]", 1: "inputs[{0}]", 2: "model->coefficients[{0}]"}
        self.emitter = Emitter(self.program, arguments, self.kept)
        self.shown = (RATES, FEATURES) if self.network else (RATES,)
        """What a Runge-Kutta stage needs."""
        self.held = {place: f"held[{i}]" for i, place in enumerate(self.program.handed_on(self.shown, INPUTS))}
        self.places = [self.features.index(name) for name in self.network.features] if self.network else []
        """Where the inputs of the network stand among the features of the ship."""

    def text(self) -> str:
        """The whole source file. Raises UserError for equations that cannot be written."""
        size = max(len(self.held), 1)
        try:
            parts = [self._init(), self._stages(), self._entries(), self._jacobians()]
            parts += [filled(TEMPLATES / "steps.c", self.product, HELD=size), self._many(), self._range()]
        except NotImplementedError as error:
            words = f"the equations of this ship cannot be written as portable C ({error})"
            raise Unsupported(f"{words}; leave the effect that needs it out with --without") from None
        used = sorted({*functions_used(self.program, EVERY), "fabs"})
        networks = network_c(self.network, self.places) if self.network else ""
        head = f'#include "{self.p}.h"\n\n' + "".join(
            f"#include <{name}.h>\n" for name in ("float", "math", "stddef", "string")
        )
        macros = f"\n#define real {self.p}_real\n{prelude(used, f'{self.p.upper()}_SINGLE')}\n"
        undo = "".join(f"#undef {name}\n" for name in ("real", "R", *(f"m_{name}" for name in used)))
        return (
            comment(about(self.product)) + head + macros + definitions(self.product) + networks + "".join(parts) + undo
        )

    def _body(self, outputs: Sequence[int], after: int, emitter: Emitter | None = None) -> list[str]:
        """Statements of all stages later than ``after`` that lead to ``outputs``."""
        return (emitter or self.emitter).statements(self.program.needed(outputs, after))

    def _store(self, output: int, target: str, emitter: Emitter | None = None, width: int = 1) -> list[str]:
        """Statements that store an output of ``width`` columns row by row in ``target``."""
        places, name = self.program.results[output], (emitter or self.emitter).name
        height = len(places) // width
        return [
            f"{target}[{i * width + j}] = {name(places[i + j * height])};" for i in range(height) for j in range(width)
        ]

    def _function(self, head: str, lines: Sequence[str], unused: Sequence[str] = ()) -> str:
        body = "\n  ".join([*lines, *(f"(void){name};" for name in unused)])
        return f"\n{head} {{\n  {body}\n}}\n"

    def _init(self) -> str:
        places = [i for i in self.program.needed(EVERY, 0) if self.program.values[i].stage == COEFFICIENTS]
        plain = Emitter(self.program, self.emitter.arguments, {})
        lines = [
            "int i;",
            f"for (i = 0; i < {self.P}; i++)",
            f"  model->coefficients[i] = coefficients ? coefficients[i] : (real){self.p}_coefficient_defaults[i];",
            "{",
            *plain.statements(places),
            *(f"{text} = {plain.name(place)};" for place, text in self.kept.items()),
            "}",
        ]
        return self._function(f"void {self.p}_init({self.p}_model *model, const real *coefficients)", lines)

    def _stages(self) -> str:
        """Input stage and state stage of the rates, and the rates themselves."""
        model, size = f"const {self.p}_model *model", max(len(self.held), 1)
        wanted = [i for i in self.program.needed(self.shown, COEFFICIENTS) if self.program.values[i].stage == INPUTS]
        inputs = [*self.emitter.statements(wanted), *(f"{t} = {self.emitter.name(i)};" for i, t in self.held.items())]
        later = Emitter(self.program, self.emitter.arguments, {**self.kept, **self.held})
        state = [*self._body(self.shown, INPUTS, later), *self._store(RATES, "rates", later)]
        if self.network:
            state = [f"real features[{len(self.features)}];", *state, *self._store(FEATURES, "features", later)]
            state.append("network_add(features, rates);")
        head = f"static void input_stage({model}, const real *inputs, real *held)"
        text = self._function(head, inputs, ("model", "inputs", "held"))
        head = f"static void state_stage({model}, const real *held, const real *state, const real *inputs, real *rates)"
        text += self._function(head, state, ("model", "held", "state", "inputs"))
        calls = ["input_stage(model, inputs, held);", "state_stage(model, held, state, inputs, rates);"]
        head = f"void {self.p}_rates({model}, const real *state, const real *inputs, real *rates)"
        return text + self._function(head, [f"real held[{size}];", *calls])

    def _entries(self) -> str:
        """Forces, columns and the settled state."""
        p, model = self.p, f"const {self.p}_model *model"
        forces = [*self._body([FORCES], COEFFICIENTS), *self._store(FORCES, "forces", width=3)]
        columns = [*self._body([COLUMNS], COEFFICIENTS), *self._store(COLUMNS, "columns")]
        settled = [*self._body([SETTLED], COEFFICIENTS), *self._store(SETTLED, "settled")]
        loop = [
            f"real six[6]{', logged[6]' if self.model.measured else ''};",
            "int i;" + (" int k;" if self.model.measured else ""),
            "for (i = 0; i < 6; i++) six[i] = columns[i];",
            "settle(model, six, inputs, state);",
        ]
        if self.model.measured:
            loop += [
                f"for (k = 0; k < {INVERSIONS}; k++) {{",
                "  real most = R(0.0);",
                f"  {p}_columns(model, state, logged);",
                "  for (i = 0; i < 6; i++) {",
                "    const real error = logged[i] - columns[i];",
                "    most = error > most ? error : (-error > most ? -error : most);",
                "    six[i] -= error;",
                "  }",
                "  settle(model, six, inputs, state);",
                "  if (!(most > R(1e-12))) break;",
                "}",
            ]
        at, every = f"{model}, const real *state", ("model", "state", "inputs")
        return (
            self._function(f"void {p}_forces({at}, const real *inputs, real *forces)", forces, every)
            + self._function(f"void {p}_columns({at}, real *columns)", columns, every[:1])
            + self._function(f"static void settle({at}, const real *inputs, real *settled)", settled, every)
            + self._function(f"void {p}_settle({model}, const real *columns, const real *inputs, real *state)", loop)
        )

    def _jacobians(self) -> str:
        S, C, F = self.S, self.C, len(self.features)
        outputs = [RATES_Z, RATES_C] + ([FEATURES, FEATURES_Z, FEATURES_C] if self.network else [])
        lines = [*self._body(outputs, COEFFICIENTS)]
        lines += [*self._store(RATES_Z, "by_state", width=S), *self._store(RATES_C, "by_inputs", width=C)]
        if self.network:
            places = self.places
            arrays = f"real features[{F}], by[{3 * len(places)}], feature_z[{F * S}], feature_c[{F * C}];"
            where = f"static const int at[{len(places)}] = {{{', '.join(map(str, places))}}};"
            lines = [arrays, where, "int i, j, k;", *lines]
            lines += [*self._store(FEATURES, "features"), *self._store(FEATURES_Z, "feature_z", width=S)]
            lines += [*self._store(FEATURES_C, "feature_c", width=C), "network_jacobian(features, by);"]
            for target, source, width in (("by_state", "feature_z", S), ("by_inputs", "feature_c", C)):
                lines.append(
                    f"for (i = 0; i < 3; i++) for (k = 0; k < {len(places)}; k++) for (j = 0; j < {width}; j++)\n"
                    f"    {target}[(3 + i) * {width} + j] += by[i * {len(places)} + k] * {source}[at[k] * {width} + j];"
                )
        head = f"void {self.p}_jacobians(const {self.p}_model *model, const real *state, const real *inputs,\n"
        return self._function(f"{head}  real *by_state, real *by_inputs)", lines, ("model", "state", "inputs"))

    def _many(self) -> str:
        """``step_many``: LANES ships at once in loops of fixed length, where their values fit into a small stack."""
        program, loop = self.program, f"for (l = 0; l < {LANES}; l++)"
        if len(program.needed(self.shown, COEFFICIENTS)) > MOST_VALUES:
            return filled(TEMPLATES / "one_by_one.c", self.product)
        arguments = {0: "state[{0}][l]", 1: "inputs[{0}][l]", 2: "model->coefficients[{0}]"}
        held = {place: f"{text}[l]" for place, text in self.held.items()}
        first, later = (
            LaneEmitter(program, arguments, self.kept),
            LaneEmitter(program, arguments, {**self.kept, **held}),
        )
        places = [i for i in program.needed(self.shown, COEFFICIENTS) if program.values[i].stage == INPUTS]
        scratch = [f"real a0[{LANES}], a1[{LANES}];", "int l, odd = 0;"]
        unused = "(void)model; (void)held; (void)inputs; (void)a0; (void)a1; (void)"
        into = [f"{loop} {target} = {first.name(place)};" for place, target in held.items()]
        state = [*scratch, *later.lines(program.needed(self.shown, INPUTS))]
        state += [f"{loop} rates[{i}][l] = {later.name(place)};" for i, place in enumerate(program.results[RATES])]
        if self.network:
            state.insert(0, f"real x[{len(self.places)}][{LANES}];")
            features = program.results[FEATURES]
            state += [f"{loop} x[{i}][l] = {later.name(features[place])};" for i, place in enumerate(self.places)]
            state.append("lanes_network(x, rates);")
        row, model = f"real {{}}[][{LANES}]", f"const {self.p}_model *model"
        head = f"static int lanes_input({model}, {row.format('inputs')}, {row.format('held')})"
        lines = [*scratch, *first.lines(places), *into, f"{unused}l;", "return odd;"]
        text = lane_functions(program, list(self.shown), tanh_statements("x[l]"))
        text += self._function(head, lines)[1:] + "\n"
        text += lanes_network_c(self.network) if self.network else ""
        head = f"static int lanes_rates({model}, {row.format('held')}, {row.format('state')},\n"
        head += f"  {row.format('inputs')}, {row.format('rates')})"
        text += self._function(head, [*state, f"{unused}state;", "return odd;"])[1:]
        size = max(len(self.held), 1)
        return text + filled(TEMPLATES / "lanes_steps.c", self.product, LANES=LANES, HELD=size)

    def _range(self) -> str:
        """Distance to what the trials held."""
        p, ranges = self.p, self.product.ranges
        head = f"double {p}_extrapolation(const {p}_model *model, const real *state, const real *inputs)"
        if not ranges:
            return self._function(head, ["(void)model; (void)state; (void)inputs;", "return -1.0;"])
        index, places = {name: i for i, name in enumerate(self.features)}, self.program.results[FEATURES]
        u, v = (self.emitter.name(places[index[name]]) for name in "uv")
        drift = ("u", "v") if any(name not in index for name in ranges) else ()
        wanted = [places[index[name]] for name in (*drift, *ranges) if name in index]
        lines = self.emitter.statements(self.program.leading_to(wanted, COEFFICIENTS))
        lines += [f"double x[{len(ranges)}], most = 0.0;", "int i;"]
        for k, name in enumerate(ranges):
            if name in index:
                lines.append(f"x[{k}] = (double)({self.emitter.name(places[index[name]])});")
            else:  # the drift angle, which has no meaning near rest
                fastest = max(abs(x) for x in ranges["u"])
                lines.append(f"x[{k}] = {0.5 * sum(ranges[name])!r};")
                lines.append(f"if ((double)({u} * {u} + {v} * {v}) > {(0.1 * fastest) ** 2!r})")
                lines.append(f"  x[{k}] = atan2((double)(-({v})), (double)({u}));")
        lines += [
            f"for (i = 0; i < {len(ranges)}; i++) {{",
            f"  const double low = {p}_range_lower[i], high = {p}_range_upper[i];",
            "  const double size = 0.1 * (fabs(low) > fabs(high) ? fabs(low) : fabs(high));",
            "  const double width = high - low > size ? high - low : size;",
            "  const double beyond = x[i] > high ? x[i] - high : (x[i] < low ? low - x[i] : 0.0);",
            "  const double share = beyond > 0.0 ? beyond / (width > 1e-12 ? width : 1e-12) : 0.0;",
            "  if (share > most) most = share;",
            "}",
            "return most;",
        ]
        return self._function(head, ["(void)model; (void)inputs;", "if (!finite_state(state)) return DBL_MAX;", *lines])


def c_files(product: Product) -> dict[str, str]:
    """Text of the header and of the source of a ``product``, by file name; the same product gives the same bytes.

    Raises UserError for an effect that C cannot hold and for equations that it cannot be written in.
    """
    for name in product.ship.effects:
        if effect(name).input_delay(product.ship.parameters_of(name)) is not None:
            late = f"feed it rudder and revolutions that late, and leave it out with --without {name}"
            raise Unsupported(f"the effect {name} is an exact delay, which the C code does not hold: {late}")
    source = Source(product)
    text, p = source.text(), product.identifier
    return {f"{p}.h": header_c(product, len(source.kept)), f"{p}.c": text}


def write_c(product: Product, target: Path) -> None:
    """Write the C product of ``product`` into the folder ``target``. Raises UserError where C cannot hold it."""
    files = c_files(product) | {
        "example.c": example_c(product),
        "README.md": filled(TEMPLATES / "README.md", product),
    }
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
        n = speed / (0.6 * ship.particulars.get("D_P", 0.03 * ship.particulars["L"]))
    inputs = self_propulsion.actuator_positions(ship, n, RUDDER)
    named = {name: round(float(value), 3) for name, value in inputs.items() if name in product.model.controls}
    return round(speed, 3), {name: value for name, value in named.items() if value}

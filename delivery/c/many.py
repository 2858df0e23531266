"""``step_many`` of an exported ship: LANES ships of one model at once, in loops of fixed length."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from delivery.c.equations import COEFFICIENTS, FEATURES, INPUTS, RATES
from delivery.c.network import BLOCK, tanh_statements
from mmg.compile.portable_lanes import LANES, LaneEmitter, lane_functions
from mmg.compile.stages import Program
from mmg.network import Network

MOST_VALUES = 1500
"""Ships with more values than this are stepped one by one: their arrays would not fit into a small stack."""


@dataclass(frozen=True)
class Many:
    """What ``many_c`` needs of a ship.

    prefix: of its names; program, kept: its equations, and where the coefficient stage has left its values; sizes:
    states and inputs; network, places: of a hybrid, and where its inputs stand among the features of the ship; shapes:
    (rows, columns) of the layers of each member.
    """

    prefix: str
    program: Program
    kept: Mapping[int, str]
    sizes: tuple[int, int]
    network: Network | None
    places: Sequence[int]
    shapes: Sequence[Sequence[tuple[int, int]]]

    @property
    def shown(self) -> list[int]:
        """Outputs that a Runge-Kutta stage needs."""
        return [RATES, FEATURES] if self.network else [RATES]


def many_c(of: Many) -> str:
    """C text of ``PREFIX_step_many``, after that of ``PREFIX_step``. of: the ship."""
    S, C = of.sizes
    if len(of.program.needed(of.shown, COEFFICIENTS)) > MOST_VALUES:
        return _ONE_BY_ONE.replace("SHIP", of.prefix).replace("STATES", str(S)).replace("INPUTS", str(C))
    text = lane_functions(of.program, of.shown, tanh_statements("x[l]")) + _stages(of)
    steps = _STEPS.replace("SHIP", of.prefix).replace("LANES", str(LANES))
    return text + steps.replace("STATES", str(S)).replace("INPUTS", str(C)).replace(
        "HELD", str(max(len(_staged(of)), 1))
    )


def _staged(of: Many) -> list[int]:
    return of.program.handed_on(of.shown, INPUTS)


def _stages(of: Many) -> str:
    """Input stage and state stage of LANES ships; both return whether a lane could not be served."""
    program = of.program
    arguments = {0: "state[{0}][l]", 1: "inputs[{0}][l]", 2: "model->coefficients[{0}]"}
    held = {place: f"held[{i}][l]" for i, place in enumerate(_staged(of))}
    first, later = LaneEmitter(program, arguments, of.kept), LaneEmitter(program, arguments, {**of.kept, **held})
    places = [i for i in program.needed(of.shown, COEFFICIENTS) if program.values[i].stage == INPUTS]
    model = f"const {of.prefix}_model *model"
    loop = f"for (l = 0; l < {LANES}; l++)"
    scratch = f"real a0[{LANES}], a1[{LANES}];\n  int l, odd = 0;"
    unused = "(void)model; (void)held; (void)inputs; (void)a0; (void)a1;"
    into = [f"{loop} {target} = {first.name(place)};" for place, target in held.items()]
    body = "\n  ".join([scratch, *first.lines(places), *into, unused + " (void)l;", "return odd;"])
    constant = f"real {{0}}[][{LANES}]"
    text = (
        f"static int lanes_input({model}, {constant.format('inputs')}, {constant.format('held')}) {{\n  {body}\n}}\n\n"
    )
    lines = [scratch, *later.lines(program.needed(of.shown, INPUTS))]
    lines += [f"{loop} rates[{i}][l] = {later.name(place)};" for i, place in enumerate(program.results[RATES])]
    if of.network:
        lines.insert(0, f"real x[{len(of.places)}][{LANES}];")
        features = program.results[FEATURES]
        lines += [f"{loop} x[{i}][l] = {later.name(features[place])};" for i, place in enumerate(of.places)]
        lines.append("lanes_network(x, rates);")
        text += _network(of)
    body = "\n  ".join([*lines, unused + " (void)state;", "return odd;"])
    head = f"static int lanes_rates({model}, {constant.format('held')}, {constant.format('state')},\n"
    return text + f"{head}  {constant.format('inputs')}, {constant.format('rates')}) {{\n  {body}\n}}\n"


def _network(of: Many) -> str:
    """The network of LANES ships: weights once, lanes inside."""
    assert of.network is not None
    widest = max(max(shape) for shapes in of.shapes for shape in shapes)
    lines = [f"real a[3][{LANES}], y[2][{widest}][{LANES}];", "int i, j, l;"]
    lines.append(f"for (i = 0; i < 3; i++) for (l = 0; l < {LANES}; l++) a[i][l] = R(0.0);")
    for k, shapes in enumerate(of.shapes):
        source = "x"
        for i, (rows, columns) in enumerate(shapes):
            arrays = ", ".join(f"network_{k}_{name}_{i}" for name in ("weight", "bias", "offset"))
            target = f"y[{i % 2}]"
            lines.append(f"lanes_layer({arrays}, {rows}, {columns}, {source}, {target});")
            source = target
        lines += [
            f"for (j = 0; j < {shapes[-1][0]}; j++) for (i = 0; i < 3; i++) for (l = 0; l < {LANES}; l++)",
            f"  a[i][l] += network_{k}_last[4 * j + i] * {source}[j][l];",
        ]
    lines.append(f"for (i = 0; i < 3; i++) for (l = 0; l < {LANES}; l++) rates[3 + i][l] += a[i][l];")
    grouped = tanh_statements("(*(const lane_group *)s)").replace("real ", "lane_group ")
    layer = _LAYER.replace("GROUP_TANH", grouped).replace("TANH", tanh_statements("s[l]"))
    layer = layer.replace("BLOCK", str(BLOCK)).replace("LANES", str(LANES))
    body = "\n  ".join(lines)
    return f"{layer}\nstatic void lanes_network(real x[][{LANES}], real rates[][{LANES}]) {{\n  {body}\n}}\n\n"


_LAYER = """
/* LANES numbers as one, where the compiler has such types; loops over them elsewhere */
#if defined(__clang__) || (defined(__GNUC__) && __GNUC__ >= 5)
typedef real lane_group __attribute__((vector_size(LANES * sizeof(real)), aligned(sizeof(real)), may_alias));
#define GROUPED 1
#else
#define GROUPED 0
#endif

static void lanes_layer(const real *weight, const real *bias, const real *offset, int rows, int columns,
  real x[][LANES], real y[][LANES]) {
  int b, i, j, l;
  for (b = 0; b < rows; b += 4) {
    const real *w = weight + b / BLOCK * columns * BLOCK + b % BLOCK;
#if GROUPED
    const lane_group zero = *(const lane_group *)x[0] * R(0.0);
    lane_group s0 = zero + bias[b], s1 = zero + bias[b + 1], s2 = zero + bias[b + 2], s3 = zero + bias[b + 3];
    for (j = 0; j < columns; j++) {
      const lane_group a = *(const lane_group *)x[j];
      s0 += w[0] * a; s1 += w[1] * a; s2 += w[2] * a; s3 += w[3] * a;
      w += BLOCK;
    }
    *(lane_group *)y[b] = s0; *(lane_group *)y[b + 1] = s1; *(lane_group *)y[b + 2] = s2; *(lane_group *)y[b + 3] = s3;
#else
    real s0[LANES], s1[LANES], s2[LANES], s3[LANES];
    for (l = 0; l < LANES; l++) { s0[l] = bias[b]; s1[l] = bias[b + 1]; s2[l] = bias[b + 2]; s3[l] = bias[b + 3]; }
    for (j = 0; j < columns; j++) {
      const real w0 = w[0], w1 = w[1], w2 = w[2], w3 = w[3];
      for (l = 0; l < LANES; l++) {
        const real a = x[j][l];
        s0[l] += w0 * a; s1[l] += w1 * a; s2[l] += w2 * a; s3[l] += w3 * a;
      }
      w += BLOCK;
    }
    for (l = 0; l < LANES; l++) { y[b][l] = s0[l]; y[b + 1][l] = s1[l]; y[b + 2][l] = s2[l]; y[b + 3][l] = s3[l]; }
#endif
  }
  for (i = 0; i < rows; i++) {
    const real o = offset[i];
    real *s = y[i];
    for (l = 0; l < LANES; l++) {
      if (s[l] > R(20.0)) s[l] = R(20.0);
      if (s[l] < R(-20.0)) s[l] = R(-20.0);
    }
#if GROUPED
    {
      GROUP_TANH
      *(lane_group *)s = p / (p + R(2.0)) - o;
    }
#else
    for (l = 0; l < LANES; l++) {
      TANH
      s[l] = p / (p + R(2.0)) - o;
    }
#endif
  }
}
#undef GROUPED
"""

_STEPS = """
/* LANES ships at once; 1 where one of them cannot be served so */
static int lanes_advance(const SHIP_model *model, real *states, const real *inputs, double h, int steps) {
  real held[HELD][LANES], c[INPUTS][LANES], z[STATES][LANES], at[STATES][LANES], k[STATES][LANES];
  real sum[STATES][LANES], one[STATES];
  const real step = (real)(h / steps), half = R(0.5) * step;
  int i, l, n, s, odd = 0;
  for (l = 0; l < LANES; l++) {
    for (i = 0; i < STATES; i++) z[i][l] = states[l * STATES + i];
    for (i = 0; i < INPUTS; i++) c[i][l] = inputs[l * INPUTS + i];
  }
  odd |= lanes_input(model, c, held);
  for (n = 0; n < steps && !odd; n++) {
    for (s = 0; s < 4; s++) {
      const real weight = s == 0 || s == 3 ? R(1.0) : R(2.0), next = s == 2 ? step : half;
      odd |= lanes_rates(model, held, s ? at : z, c, k);
      for (i = 0; i < STATES; i++)
        for (l = 0; l < LANES; l++) {
          sum[i][l] = s ? sum[i][l] + weight * k[i][l] : k[i][l];
          at[i][l] = z[i][l] + next * k[i][l];
        }
    }
    for (i = 0; i < STATES; i++)
      for (l = 0; l < LANES; l++) z[i][l] += step / R(6.0) * sum[i][l];
  }
  for (l = 0; l < LANES && !odd; l++) {
    for (i = 0; i < STATES; i++) one[i] = z[i][l];
    odd |= !finite_state(one);
  }
  if (odd) return 1;
  for (l = 0; l < LANES; l++)
    for (i = 0; i < STATES; i++) states[l * STATES + i] = z[i][l];
  return 0;
}

int SHIP_step_many(const SHIP_model *model, int count, real *states, const real *inputs, double h) {
  const int steps = steps_of(h);
  int i, j, failed = 0;
  if (steps < 0) return count > 0 ? count : 0;
  if (steps == 0) return 0;
  for (i = 0; i < count; i += LANES) {
    const int several = count - i < LANES ? count - i : LANES;
    real *z = states + (size_t)i * STATES;
    const real *c = inputs + (size_t)i * INPUTS;
    if (several == LANES && !lanes_advance(model, z, c, h, steps)) continue;
    for (j = 0; j < several; j++) failed += advance(model, z + (size_t)j * STATES, c + (size_t)j * INPUTS, h, steps);
  }
  return failed;
}
"""
_ONE_BY_ONE = """
int SHIP_step_many(const SHIP_model *model, int count, real *states, const real *inputs, double h) {
  int i, failed = 0;
  for (i = 0; i < count; i++) failed += SHIP_step(model, states + (size_t)i * STATES, inputs + (size_t)i * INPUTS, h);
  return failed;
}
"""

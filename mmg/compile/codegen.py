"""C of the instructions of a CasADi function, on vectors of LANES points (GCC/Clang vector extension).

CasADi's own C evaluates one point per call. Here each instruction acts on a vector, so that simulation, sensitivities
and Hessians of thousands of points run at SIMD speed from the very expression that defines the ship.

The instructions are values, each computed once, in stages by what they depend on: those of a ship's right-hand side
that hang on the coefficients alone need no second evaluation within an interval, those of the inputs none within a
step. Each stage becomes the body of a C function; what it hands on lies in arrays.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import casadi as ca

# Points per vector: 8 doubles fill an AVX-512 register, two AVX2 ones, four NEON ones.
LANES = 8  # set by hand: speed, and rounding

# Functions of the C library that CasADi has an operation for, of one and of two arguments.
OF_ONE = ("sqrt", "exp", "log", "expm1", "log1p", "erf", "fabs", "floor", "ceil", "sin", "cos", "tan", "asin", "acos",
          "atan", "sinh", "cosh", "tanh")  # fmt: skip
OF_TWO = ("pow", "atan2", "fmin", "fmax", "fmod", "hypot", "copysign")
# Operations on operands that are written alike in C and in MATLAB, and the signs of comparisons in C.
ARITHMETIC = {ca.OP_ASSIGN: "{0}", ca.OP_ADD: "{0} + {1}", ca.OP_SUB: "{0} - {1}", ca.OP_MUL: "{0} * {1}",
              ca.OP_NEG: "-{0}", ca.OP_SQ: "{0} * {0}"}  # fmt: skip
COMPARISONS = {ca.OP_LT: "<", ca.OP_LE: "<=", ca.OP_EQ: "==", ca.OP_NE: "!="}


def calls(prefix: str) -> dict[int, str]:
    """CasADi operation -> C text of a call of the function of OF_ONE or OF_TWO, each behind ``prefix``."""
    one = {getattr(ca, f"OP_{name.upper()}"): f"{prefix}{name}({{0}})" for name in OF_ONE}
    two = {getattr(ca, f"OP_{name.upper()}"): f"{prefix}{name}({{0}}, {{1}})" for name in OF_TWO}
    return {**one, **two, ca.OP_CONSTPOW: f"{prefix}pow({{0}}, {{1}})"}


# C expression of each CasADi operation on its operands; a truth is 1 or 0, as CasADi has it.
EXPRESSIONS: dict[int, str] = {
    **calls("v_"),
    **ARITHMETIC,
    **{operation: f"compare({{0}} {sign} {{1}})" for operation, sign in COMPARISONS.items()},
    ca.OP_DIV: "quotient({0}, {1})",
    ca.OP_TWICE: "2.0 * {0}",
    ca.OP_INV: "quotient(fill(1.0), {0})",
    ca.OP_NOT: "compare({0} == 0.0)",
    ca.OP_AND: "compare(({0} != 0.0) & ({1} != 0.0))",  # &, not &&: vectors have no logical operators
    ca.OP_OR: "compare(({0} != 0.0) | ({1} != 0.0))",
    ca.OP_SIGN: "compare({0} > 0.0) - compare({0} < 0.0)",
    ca.OP_IF_ELSE_ZERO: "when({0}, {1})",
}

# What a function is that Python calls.
EXPORT = """#ifdef _WIN32
#define EXPORT __declspec(dllexport)
#else
#define EXPORT
#endif
"""
# What a function is that is called from another unit of the same library alone.
HIDDEN = """#if defined(_WIN32) || !defined(__GNUC__)
#define HIDDEN
#else
#define HIDDEN __attribute__((visibility("hidden")))
#endif
"""
_COMMON = (
    "#include <math.h>\n#include <string.h>\n#define INLINE static inline __attribute__((always_inline))\n" + EXPORT
)
_OWN = ("sqrt", "exp", "tanh", "sin", "cos", "atan2")  # Functions that do without the C library

# exp, tanh, sin, cos and atan2 on vectors, free of branches, within a few units of the last bit: a C library
# evaluates one number per call, with branches that scattered ships mispredict. Arguments are reduced by multiples of
# ln 2 or pi / 2 given in parts (Cody & Waite 1980), the rest are Taylor polynomials. exp gives 0 below -708; sin and
# cos of more than 1e5 rad are the C library's. The reduction needs every product rounded: compile with -ffp-
# contract=off.


def horner(coefficients: Sequence[float], term: str, number: str) -> str:
    """C expression of the polynomial c_0 + z (c_1 + z (...)) of ``coefficients``. term: text of {0} z + {1}; number: of
    a literal."""
    text = number.format(repr(coefficients[-1]))
    for c in coefficients[-2::-1]:
        text = term.format(text, number.format(repr(c)))
    return text


def inverse_factorials(first: int, step: int, count: int, alternate: bool) -> list[float]:
    """1 / k! for ``count`` numbers k = first, first + step, ..., with signs that ``alternate`` or not."""
    return [(-1.0) ** (i if alternate else 0) / math.factorial(first + step * i) for i in range(count)]


# Taylor coefficients behind the first terms: of expm1(z) / z^2 - 1 / z, and of sin and cos by even powers. So many that
# the first one left out is below the last bit for |z| <= ln(2) / 2 and |z| <= pi / 4, to which arguments are reduced.
EXPM1 = inverse_factorials(2, 1, 12, False)
SINE = [-c for c in inverse_factorials(3, 2, 8, True)]
COSINE = inverse_factorials(4, 2, 7, True)
# (atan(t) / t - 1) / z as a polynomial of z = t^2 up to tan^2(pi / 8), interpolated at the Chebyshev nodes. The degree
# was set by hand.
ARC = (
    -0.3333333333333333, 0.19999999999999804, -0.14285714285659779, 0.11111111105150588, -0.09090908753259112,
     0.07692296368042296, -0.0666642476020052, 0.05878927554473807, -0.05230443640686948, 0.045515447340221615,
     -0.03456931506332609, 0.016284375050043393
)  # fmt: skip


def c_file(module: str, name: str, **values: object) -> str:
    """The C file ``name`` beside the file of a ``module``, each "@key@" replaced by its value among ``values``."""
    text = Path(module).with_name(name).read_text(encoding="utf-8")
    for key, value in values.items():
        text = text.replace(f"@{key}@", str(value))
    return text


def prelude() -> str:
    """What all C files begin with: the type V of LANES points and the functions on it."""
    one, two = (sorted(set(names) - set(_OWN)) for names in (OF_ONE, OF_TWO))
    by_lane = [f"static V v_{f}(V x) {{ LANEWISE({f}(x[i])); }}" for f in one]
    by_lane += [f"static V v_{f}(V a, V b) {{ LANEWISE({f}(a[i], b[i])); }}" for f in two]
    series = {"expm1": EXPM1, "sin": SINE, "cos": COSINE, "arc": ARC}
    polynomials = {name: horner(c, "more(z, {0}, {1})", "fill({0})") for name, c in series.items()}
    reduced = {"per_ln2": 1 / math.log(2), "per_quarter": 2 / math.pi}  # arguments are counted in these
    functions = c_file(__file__, "functions.h", **polynomials, **reduced)
    return _COMMON + c_file(__file__, "vector.h", lanes=LANES) + functions + "\n".join(by_lane) + "\n"


def constant(value: float) -> str:
    """C literal of a number: Python writes an infinite or undefined ``value`` in words that C does not know."""
    if math.isnan(value):
        return "NAN"
    if math.isinf(value):
        return "INFINITY" if value > 0 else "-INFINITY"
    return repr(value)


CONSTANT = 0  # Stage of a value that depends on no argument

# Instructions in one C function: registers are given out in more than twice the time for twice as many. Of 11,000
# instructions gcc 12 makes code in 1.4 s, in 2.4 s with 3,000 a function, and that code is as fast to some per cent. So
# it was measured; the number was set by hand.
FUNCTION_SIZE = 800
# Characters of such functions that are compiled together: each start of a compiler takes some .02 s. Set by hand.
UNIT_TEXT = 150_000


@dataclass(frozen=True)
class Value:
    """A value of a program: an operation of CasADi on earlier values, an argument, or a constant.

    operation: CasADi's number; operands: places of earlier values; stage: the latest stage of its operands; number: of
    a constant; argument: (argument, element) of an input.
    """

    operation: int
    operands: tuple[int, ...]
    stage: int
    number: float = 0.0
    argument: tuple[int, int] | None = None


@dataclass(frozen=True)
class Program:
    """All values of a function in their order, and the places of its outputs.

    results: per output the place of each element, column by column as CasADi has them; None for a structural zero.
    """

    values: tuple[Value, ...]
    results: tuple[tuple[int | None, ...], ...]

    @classmethod
    def of(cls, function: ca.Function, stages: Sequence[int]) -> Program:
        """The program of an SXFunction. function: it; stages: the stage of each of its arguments, 1 or later."""
        values: list[Value] = []
        at: dict[int, int] = {}  # register of CasADi -> place of the value that it holds now
        results: list[list[int | None]] = [[None] * function.numel_out(j) for j in range(function.n_out())]
        rows = [function.sparsity_out(j).find() for j in range(function.n_out())]
        for k in range(function.n_instructions()):
            operation = function.instruction_id(k)
            inputs, outputs = function.instruction_input(k), function.instruction_output(k)
            if operation == ca.OP_OUTPUT:  # CasADi numbers nonzeros, results count all elements
                results[outputs[0]][rows[outputs[0]][outputs[1]]] = at[inputs[0]]
                continue
            if operation == ca.OP_CONST:
                value = Value(operation, (), CONSTANT, number=function.instruction_constant(k))
            elif operation == ca.OP_INPUT:
                value = Value(operation, (), stages[inputs[0]], argument=(inputs[0], inputs[1]))
            else:
                operands = tuple(at[i] for i in inputs)
                value = Value(operation, operands, max(values[i].stage for i in operands))
            at[outputs[0]] = len(values)  # CasADi uses a register again: the newest value counts
            values.append(value)
        return cls(tuple(values), tuple(tuple(row) for row in results))

    def needed(self, outputs: Iterable[int], after: int = CONSTANT) -> list[int]:
        """Places, in order, of the values of stages later than ``after`` that lead to these ``outputs``."""
        return self.leading_to((place for j in outputs for place in self.results[j]), after)

    def leading_to(self, places: Iterable[int | None], after: int = CONSTANT) -> list[int]:
        """As ``needed``, for the values at these ``places`` and those of stages later than ``after`` behind them."""
        todo = [place for place in places if place is not None]
        reached: set[int] = set()
        while todo:
            place = todo.pop()
            if place not in reached and self.values[place].stage > after:  # earlier stages have handed theirs on
                reached.add(place)
                todo += self.values[place].operands
        return sorted(reached)

    def divided(self, outputs: Iterable[int], last: int, size: int) -> Program:
        """The same with its ``last`` stage divided after each ``size`` of its values behind these ``outputs``: a later
        part is a later stage."""
        values = list(self.values)
        places = [place for place in self.needed(outputs, last - 1) if values[place].argument is None]
        for count, place in enumerate(places):  # in order: no part takes up what a later one makes
            values[place] = replace(values[place], stage=last + count // size)
        return replace(self, values=tuple(values))

    def handed_on(self, outputs: Iterable[int], stage: int) -> list[int]:
        """Places, in order, of the results of a ``stage`` that later stages or these ``outputs`` themselves take up;
        arguments and constants are not among them."""
        outputs = list(outputs)
        read = {i for place in self.needed(outputs, stage) for i in self.values[place].operands}
        # an output may be made early
        read |= {place for j in outputs for place in self.results[j] if place is not None}
        return sorted(i for i in read if self.values[i].stage == stage and self.values[i].argument is None)


class Emitter:
    """Writes statements for the values of a program, on vectors here.

    program: staged; arguments: argument -> C text of its elements, such as "state[{0}]"; kept: place -> C text of
    what an earlier stage has left behind. Another language overrides ``expressions`` and what follows: powers that need
    no call, the form of a statement, the number of the first element of an array, literals.
    """

    expressions, powers, statement, first = EXPRESSIONS, dict[float, str](), "const V w{0} = {1};", 0

    def __init__(self, program: Program, arguments: Mapping[int, str], kept: Mapping[int, str]) -> None:
        self.program, self.arguments, self.kept = program, arguments, dict(kept)

    def literal(self, number: float) -> str:
        """Text of a ``number``."""
        return f"fill({constant(number)})"

    def name(self, place: int | None) -> str:
        """Text of the value at a ``place`` that is known by now; a structural zero (None) is zero."""
        if place is None:
            return self.literal(0.0)
        value = self.program.values[place]
        if value.argument:
            return self.arguments[value.argument[0]].format(value.argument[1] + self.first)
        return self.kept.get(place, f"w{place}") if value.operands else self.literal(value.number)

    def statements(self, places: Iterable[int | None]) -> list[str]:
        """One statement for each value of ``places`` that is made of others and not kept; what they are made of
        constants alone comes first, as no list of a stage holds it. Raises NotImplementedError for an operation that
        the language does not have."""
        values = self.program.values
        chosen = {place for place in places if place is not None}
        todo = [i for place in chosen for i in values[place].operands]
        while todo:  # cheaper made again than handed on
            place = todo.pop()
            if values[place].stage == CONSTANT and place not in chosen:
                chosen.add(place)
                todo += values[place].operands
        # places are in the order of the program: operands come first
        made = [place for place in sorted(chosen) if values[place].operands and place not in self.kept]
        return [self.statement.format(place, self._expression(place)) for place in made]

    def _expression(self, place: int) -> str:
        value, values = self.program.values[place], self.program.values
        names = [self.name(i) for i in value.operands]
        if value.operation in (ca.OP_POW, ca.OP_CONSTPOW):
            exponent = values[value.operands[1]]  # CasADi keeps it as an operand, also where it is a number
            if exponent.stage == CONSTANT and not exponent.operands and exponent.number in self.powers:
                return self.powers[exponent.number].format(*names)
        if value.operation not in self.expressions:
            raise NotImplementedError(f"no C for CasADi operation {value.operation}")
        return self.expressions[value.operation].format(*names)


@dataclass(frozen=True)
class StagedBody:
    """C statements of one stage, and the number of values that it hands on."""

    text: str
    handed: int


@dataclass(frozen=True)
class DividedCode:
    """C functions of a program whose last stage is divided among several.

    early: bodies of the stages before the last one; functions: C text of each part of the last stage; declared: what a
    caller has to know of them; call: statements that call them one after the other, with the names that they were made
    with and an array d for the results.
    """

    early: dict[int, StagedBody]
    functions: list[str]
    declared: str
    call: str


def divided_code(
    name: str, program: Program, outputs: Sequence[int], arguments: Mapping[int, str], arrays: Mapping[int, str]
) -> DividedCode:
    """Code for some ``outputs`` of a ``program``, its last stage in functions NAME_0, NAME_1, ... of at most
    FUNCTION_SIZE instructions. name: NAME; arguments, arrays: as of ``staged_bodies``, arrays for early stages only."""
    last = max(arrays, default=CONSTANT) + 1
    divided = program.divided(outputs, last, FUNCTION_SIZE)
    parts = max([last, *(value.stage for value in divided.values)]) + 1 - last
    # each part hands on in a share of the array M, all as long as the longest
    between = {last + i: f"(M + {i} * {name}_most)" for i in range(parts - 1)}
    bodies = staged_bodies(divided, outputs, arguments, {**arrays, **between}, "d")
    most = max([bodies[stage].handed for stage in between], default=0) + 1
    given = [*arguments.values(), *arrays.values()]
    parameters = ", ".join([*(f"const V* {one}" for one in given), "V* M", "V* d"])
    heads = [f"HIDDEN void {name}_{i}({parameters})" for i in range(parts)]
    size = f"#define {name}_most {most}\n"
    texts = [bodies[last + i].text for i in range(parts)]
    functions = [f"{size}{head} {{\n  {t}\n}}\n#undef {name}_most\n" for head, t in zip(heads, texts, strict=True)]
    calls = " ".join(f"{name}_{i}({', '.join([*given, 'M', 'd'])});" for i in range(parts))
    declared = "".join(f"{head};\n" for head in heads)
    return DividedCode({stage: bodies[stage] for stage in arrays}, functions, declared, f"V M[{most * parts}]; {calls}")


def units_of(head: str, functions: Sequence[str]) -> list[str]:
    """C ``functions`` in units of about UNIT_TEXT characters, each behind the same ``head``."""
    units: list[str] = []
    for text in functions:
        if not units or len(units[-1]) - len(head) + len(text) > UNIT_TEXT:
            units.append(head)
        units[-1] += text
    return units


def staged_bodies(
    program: Program, outputs: Sequence[int], arguments: Mapping[int, str], arrays: Mapping[int, str], result: str
) -> dict[int, StagedBody]:
    """Bodies by stage for some ``outputs`` of a ``program``.

    arguments: argument -> name of its C array; arrays: stage, from the first to the one before the last -> name of the
    array for what it hands on; the last stage is one more. result: name of the array to which the last stage writes the
    nonzeros of the outputs, one output after the other. Raises NotImplementedError for an operation without C.
    """
    kept, bodies = dict[int, str](), dict[int, StagedBody]()
    texts = {argument: f"{name}[{{0}}]" for argument, name in arguments.items()}
    for stage in [*arrays, max(arrays, default=CONSTANT) + 1]:
        emitter = Emitter(program, texts, kept)
        places: list[int | None] = [at for at in program.needed(outputs) if program.values[at].stage == stage]
        if stage in arrays:
            made = {at: f"{arrays[stage]}[{row}]" for row, at in enumerate(program.handed_on(outputs, stage))}
            lines = emitter.statements(places) + [f"{to} = {emitter.name(at)};" for at, to in made.items()]
            kept |= made
        else:  # a result may come from an earlier stage, or be an argument itself
            given = [at for j in outputs for at in program.results[j] if at is not None]
            lines = emitter.statements([*places, *given])
            lines += [f"{result}[{row}] = {emitter.name(at)};" for row, at in enumerate(given)]
        bodies[stage] = StagedBody("\n  ".join(lines), len(made if stage in arrays else given))
    return bodies

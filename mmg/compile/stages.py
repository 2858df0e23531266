"""The instruction list of a CasADi function as values, each computed once, in stages by what they depend on."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

import casadi as ca

CONSTANT = 0
"""Stage of a value that depends on no argument."""


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
class FusedSum:
    """A product and a sum that are rounded once. operands: places of both factors and of what is added; text: C of it,
    to be formatted with their names."""

    operands: tuple[int, int, int]
    text: str


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
        at: dict[int, int] = {}
        results: list[list[int | None]] = [[None] * function.numel_out(j) for j in range(function.n_out())]
        rows = [function.sparsity_out(j).find() for j in range(function.n_out())]
        for k in range(function.n_instructions()):
            operation = function.instruction_id(k)
            inputs, outputs = function.instruction_input(k), function.instruction_output(k)
            if operation == ca.OP_OUTPUT:
                results[outputs[0]][rows[outputs[0]][outputs[1]]] = at[inputs[0]]
                continue
            if operation == ca.OP_CONST:
                value = Value(operation, (), CONSTANT, number=function.instruction_constant(k))
            elif operation == ca.OP_INPUT:
                value = Value(operation, (), stages[inputs[0]], argument=(inputs[0], inputs[1]))
            else:
                operands = tuple(at[i] for i in inputs)
                value = Value(operation, operands, max(values[i].stage for i in operands))
            at[outputs[0]] = len(values)
            values.append(value)
        return cls(tuple(values), tuple(tuple(row) for row in results))

    def needed(self, outputs: Iterable[int], after: int = CONSTANT) -> list[int]:
        """Places, in order, of the values of stages later than ``after`` that lead to these ``outputs``."""
        return self.leading_to((place for j in outputs for place in self.results[j]), after)

    def leading_to(self, places: Iterable[int | None], after: int = CONSTANT) -> list[int]:
        """As ``needed``, for the values at these ``places`` and those of stages later than ``after`` behind them."""
        todo = [place for place in places if place is not None]
        found: set[int] = set()
        while todo:
            place = todo.pop()
            if place not in found and self.values[place].stage > after:
                found.add(place)
                todo += self.values[place].operands
        return sorted(found)

    def fused_sums(self, outputs: Iterable[int]) -> tuple[dict[int, FusedSum], set[int]]:
        """Sums and differences of these ``outputs`` that take up a product of their own stage, by place, and the
        products that nothing else takes up. Which are fused hangs on the sum alone, not on what stands beside it."""
        outputs = list(outputs)
        needed = self.needed(outputs)
        uses = Counter(i for place in needed for i in self.values[place].operands)
        uses.update(place for j in outputs for place in self.results[j] if place is not None)
        sums: dict[int, FusedSum] = {}
        for place in needed:
            value = self.values[place]
            if value.operation not in (ca.OP_ADD, ca.OP_SUB):
                continue
            for side, other in ((0, 1), (1, 0)):
                product = self.values[value.operands[side]]
                if product.operation in (ca.OP_MUL, ca.OP_SQ) and product.stage == value.stage:
                    signs = ("", "") if value.operation == ca.OP_ADD else ("-", "") if side else ("", "-")
                    operands = (product.operands[0], product.operands[-1], value.operands[other])
                    sums[place] = FusedSum(operands, f"more({signs[0]}{{}}, {{}}, {signs[1]}{{}})")
                    uses[value.operands[side]] -= 1
                    break
        return sums, {i for place in sums for i in self.values[place].operands if uses[i] == 0}

    def divided(self, outputs: Iterable[int], last: int, size: int) -> Program:
        """The same with its ``last`` stage divided after each ``size`` of its values behind these ``outputs``: a later
        part is a later stage."""
        values, count = list(self.values), 0
        for place in self.needed(outputs, last - 1):
            if values[place].argument is None:
                values[place] = replace(values[place], stage=last + count // size)
                count += 1
        return replace(self, values=tuple(values))

    def handed_on(self, outputs: Iterable[int], stage: int) -> list[int]:
        """Places, in order, of the results of a ``stage`` that later stages or these ``outputs`` themselves take up;
        arguments and constants are not among them."""
        outputs = list(outputs)
        taken = {i for place in self.needed(outputs, stage) for i in self.values[place].operands}
        taken |= {place for j in outputs for place in self.results[j] if place is not None}
        return sorted(i for i in taken if self.values[i].stage == stage and self.values[i].argument is None)

"""The header of an exported ship, its tables, and the words and numbers that its C files are made of."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from pathlib import Path

from delivery.product import Product, filled, identifiers, unit_of

TEMPLATES = Path(__file__).parent / "templates"
LONGEST_STRING = 4000
"""Most bytes of a string constant: C99 promises 4095."""


def quoted(text: str, most: int = LONGEST_STRING) -> str:
    """C string constant of ``text`` in UTF-8, of which at most ``most`` bytes are kept."""
    content = text.encode()[:most]
    plain = {ord('"'): '\\"', ord("\\"): "\\\\", ord("?"): "\\?", ord("\n"): "\\n"}
    return '"' + "".join(plain.get(b) or (chr(b) if 32 <= b < 127 else f"\\{b:03o}") for b in content) + '"'


def comment(lines: Iterable[str]) -> str:
    """C comment of these ``lines``: characters that are not ASCII become ?, and nothing in them ends it early."""
    safe = [line.encode("ascii", "replace").decode().replace("*/", "* /").replace("/*", "/ *") for line in lines]
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
    words = "const char *const"
    named: list[tuple[str, str, Sequence[str]]] = [
        (words, "state_names", [quoted(s) for s in model.states]),
        (words, "state_units", [quoted(unit_of(s)) for s in model.states]),
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


def header_c(product: Product, kept: int) -> str:
    """The header of a ``product`` whose coefficient stage leaves ``kept`` numbers behind."""
    p, model = product.identifier, product.model
    S, C, P, R = (len(names) for names in (model.states, model.controls, model.symbols, model.roles))
    sizes = {"STATES": S, "INPUTS": C, "COEFFICIENTS": P, "ROLES": R, "COLUMNS": 6, "RANGES": len(product.ranges)}
    places = "".join(
        f"enum {{ {', '.join(f'{p}_{kind}_{name} = {i}' for i, name in enumerate(identifiers(names)))} }};\n"
        for kind, names in (("state", model.states), ("input", model.controls), ("role", model.roles))
    )
    return filled(
        TEMPLATES / "ship.h", product, PLACES=places, P1=max(P, 1), KEPT=max(kept, 1),
        ABOUT=comment([*product.sentences, "SI units and radians. Names and units are in the tables at the end."]),
        SIZES="".join(f"#define {p.upper()}_{name} {count}\n" for name, count in sizes.items()),
        TABLES="".join(f"extern {declared};\n" for declared, _ in tables(product)),
    )  # fmt: skip

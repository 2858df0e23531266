"""The header of an exported ship, its tables, and the words, numbers and templates that all its files are made of."""

from __future__ import annotations

import hashlib
import math
import re
from collections.abc import Iterable, Sequence
from pathlib import Path

from delivery.product import SHOWN, Product, identifiers, unit_of

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


def inserted(text: str, **words: object) -> str:
    """The ``text`` of a template, with one of the ``words`` in place of each @WORD@."""
    return re.sub("@([A-Z0-9_]+)@", lambda match: str(words[match[1]]), text)


def filled(template: Path, product: Product, **words: object) -> str:
    """The file ``template`` for a ``product``: SHIP becomes its identifier, UPPER that in capitals, @WORD@ one of the
    ``words``: its title, caveats, numbers of states, inputs, coefficients and roles are always among them."""
    model, p = product.model, product.identifier
    words |= {
        "S": len(model.states), "C": len(model.controls), "P": len(model.symbols), "R": len(model.roles),
        "LONGEST_STEP": repr(product.longest_step), "TITLE": product.ship.title,
        "CAVEATS": "".join(f"* {caveat}\n" for caveat in product.caveats) or "* none\n",
    }  # fmt: skip
    text = template.read_text(encoding="utf-8").replace("SHIP", p).replace("UPPER", p.upper())
    return inserted(text, **words)


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
    return "".join(text) + f"const char {product.identifier}_about[] =\n  " + quoted("\n".join(about(product))) + ";\n"


def about(product: Product) -> list[str]:
    """Sentences on what a ``product`` is, where it comes from, and its caveats."""
    ship, source = product.ship, product.provenance
    parts = ", ".join(f"{role} {name}" for role, name in ship.components.items())
    lines = [f"Ship {ship.title}: {parts}."]
    if ship.effects:
        lines.append(f"Effects: {', '.join(ship.effects)}.")
    if ship.network is not None:
        lines.append(f"Hybrid: a residual network of {len(ship.network.members)} member(s) adds accelerations.")
    made = f", made {source['created']}" if source.get("created") else ""
    lines.append(f"Exported by mmg export from {source['source']} ({source['kind']}{made}).")
    if source.get("data"):
        hashes = sorted(str(row["sha256"]) for row in source["data"])
        together = hashlib.sha256("\n".join(hashes).encode()).hexdigest()[:SHOWN]
        lines.append(f"Calibrated on {', '.join(str(row['name']) for row in source['data'])} (data {together}).")
    return lines + [f"Caveat: {caveat}." for caveat in product.caveats]


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
        ABOUT=comment([*about(product), "SI units and radians. Names and units are in the tables at the end."]),
        SIZES="".join(f"#define {p.upper()}_{name} {count}\n" for name, count in sizes.items()),
        TABLES="".join(f"extern {declared};\n" for declared, _ in tables(product)),
    )  # fmt: skip

"""The header of an exported ship: sizes, names, types and functions; and the tables that its source defines."""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from dataclasses import dataclass

from delivery.c.text import comment, number, quoted, rows
from delivery.product import SHOWN, Product, identifiers
from mmg.motion.flow import INPUTS

UNITS = {"x": "m", "y": "m", "psi": "rad", "u": "m/s", "v": "m/s", "r": "rad/s", "phi": "rad", "p": "rad/s",
         "wind_north": "m/s", "wind_east": "m/s", "time": "s", "a_x": "m/s", "a_y": "m/s", "beta": "rad"}  # fmt: skip
"""Units of states, inputs and ranges; those of the actuators are in mmg.motion.flow, others are not stated."""


def unit_of(name: str) -> str:
    """SI unit of the state, input or range ``name``, "" where none is stated."""
    unit = INPUTS[name][1] if name in INPUTS else UNITS.get(name, "")
    return "1/s" if unit == "rps" else unit


@dataclass(frozen=True)
class Table:
    """A constant array of the header: C type of its elements, name after the prefix, elements as C text."""

    kind: str
    name: str
    elements: tuple[str, ...]


def tables(product: Product) -> list[Table]:
    """The tables of a ``product``: names, units, defaults, bounds and verdicts; empty ones are left out."""
    model, words = product.model, "const char *const"
    coefficients = product.coefficients
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
    return [Table(kind, name, tuple(elements)) for kind, name, elements in named if elements]


def definitions(product: Product) -> str:
    """C text that defines the tables of a ``product`` and its words about itself."""
    p = product.identifier
    text = [f"{t.kind} {p}_{t.name}[{len(t.elements)}] = {rows(t.elements)};\n" for t in tables(product)]
    return "".join(text) + f"const char {p}_about[] =\n  " + quoted("\n".join(about(product))) + ";\n"


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


def sizes(product: Product) -> dict[str, int]:
    """Macros of the sizes of a ``product``, without prefix."""
    model = product.model
    return {
        "STATES": len(model.states),
        "INPUTS": len(model.controls),
        "COEFFICIENTS": len(model.symbols),
        "ROLES": len(model.roles),
        "COLUMNS": 6,
        "RANGES": len(product.ranges),
    }


def header_c(product: Product, kept: int) -> str:
    """The header of a ``product`` whose coefficient stage leaves ``kept`` numbers behind."""
    p, up, model = product.identifier, product.identifier.upper(), product.model
    S, C, P, R = (len(names) for names in (model.states, model.controls, model.symbols, model.roles))
    macros = "".join(f"#define {up}_{name} {count}\n" for name, count in sizes(product).items())
    places = "".join(
        f"enum {{ {', '.join(f'{p}_{kind}_{name} = {i}' for i, name in enumerate(identifiers(names)))} }};\n"
        for kind, names in (("state", model.states), ("input", model.controls), ("role", model.roles))
    )
    arrays = "".join(f"extern {t.kind} {p}_{t.name}[{len(t.elements)}];\n" for t in tables(product))
    return f"""{comment([*about(product), "SI units and radians. Names and units are in the tables at the end."])}\
#ifndef {up}_H
#define {up}_H

#ifdef __cplusplus
extern "C" {{
#endif

/* define {up}_SINGLE, here and where the source is compiled, for single precision */
#ifdef {up}_SINGLE
typedef float {p}_real;
#else
typedef double {p}_real;
#endif

{macros}#define {up}_LONGEST_STEP {product.longest_step!r} /* [s] of one Runge-Kutta step */

/* places in state, inputs and forces */
{places}
/* Coefficients, and what follows from them alone. It holds no pointer: copy it as you like. Functions that take a
 * const model may be called by several threads at once. */
typedef struct {{
  {p}_real coefficients[{max(P, 1)}];
  {p}_real kept[{max(kept, 1)}];
}} {p}_model;

/* To be called first, and again when a coefficient changes. coefficients: [{P}], NULL for the defaults. */
void {p}_init({p}_model *model, const {p}_real *coefficients);

/* The state [{S}] whose logged columns x, y, psi, u, v, r are these [6] and whose memory is settled. */
void {p}_settle(const {p}_model *model, const {p}_real *columns, const {p}_real *inputs, {p}_real *state);

/* d state / dt [{S}] */
void {p}_rates(const {p}_model *model, const {p}_real *state, const {p}_real *inputs, {p}_real *rates);

/* X, Y [N], N [N m] of each role, [{R} x 3] row by row; the accelerations of a network are not among them */
void {p}_forces(const {p}_model *model, const {p}_real *state, const {p}_real *inputs, {p}_real *forces);

/* x, y, psi, u, v, r as the ship's instruments log them */
void {p}_columns(const {p}_model *model, const {p}_real *state, {p}_real *columns);

/* derivatives of the rates, row by row: by_state[{S} x {S}], by_inputs[{S} x {C}] */
void {p}_jacobians(const {p}_model *model, const {p}_real *state, const {p}_real *inputs, {p}_real *by_state,
  {p}_real *by_inputs);

/* The state h seconds later, inputs held: classical Runge-Kutta steps of equal length, none longer than
 * {up}_LONGEST_STEP. Returns 0; 1 where the new state is not finite, or h is negative, not finite or longer than
 * a million steps: the state is then as before. */
int {p}_step(const {p}_model *model, {p}_real *state, const {p}_real *inputs, double h);

/* The same for several ships of one model: states [count x {S}], inputs [count x {C}], ship by ship.
 * Returns the number of ships whose step failed. */
int {p}_step_many(const {p}_model *model, int count, {p}_real *states, const {p}_real *inputs, double h);

/* 0 where state and inputs lie inside what the trials held; outside the largest distance over the width of the range
 * (a width below a tenth of the values themselves counts as that); -1 where no range is known; DBL_MAX
 * where the state is not finite */
double {p}_extrapolation(const {p}_model *model, const {p}_real *state, const {p}_real *inputs);

/* Of bounds DBL_MAX is none; of standard deviations -1 is not known. */
{arrays}extern const char {p}_about[];

#ifdef __cplusplus
}}
#endif
#endif
"""

"""The folder of the C product: header, source, an example that prints a turning circle, and how to compile it."""

from __future__ import annotations

from pathlib import Path

from cases.maneuvers import self_propulsion
from delivery.c.source import c_files
from delivery.c.text import comment
from delivery.product import Product
from mmg.errors import UserError

BUILD = "cc -std=c99 -O2 {p}.c example.c -lm -o example"
RUDDER = 0.3
"""Rudder angle [rad] of the turn in an example."""


def write_c(product: Product, target: Path) -> None:
    """Write the C product of ``product`` into the folder ``target``. Raises UserError where C cannot hold it."""
    files = c_files(product) | {"example.c": example_c(product), "README.md": readme(product)}
    for name, text in files.items():
        (target / name).write_text(text, encoding="utf-8", newline="\n")


def example_c(product: Product) -> str:
    """A program that steers ``product`` through 600 s with the rudder held, and prints its motion as CSV."""
    p, model, (speed, inputs) = product.identifier, product.model, approach(product)
    settings = "".join(f"  inputs[{p}_input_{name}] = ({p}_real){value!r};\n" for name, value in inputs.items())
    clock = f"    inputs[{p}_input_time] = ({p}_real)(0.1 * k);\n" if "time" in model.controls else ""
    head = comment(["How to use the ship: a turn of 600 s in steps of 0.1 s.", "Compile: " + BUILD.format(p=p)])
    return f"""{head}#include "{p}.h"

#include <stdio.h>

int main(void) {{
  {p}_model model;
  {p}_real columns[{p.upper()}_COLUMNS] = {{0}}, inputs[{p.upper()}_INPUTS] = {{0}}, state[{p.upper()}_STATES];
  int k;
{settings}  columns[{p}_state_u] = ({p}_real){speed!r};
  {p}_init(&model, NULL);
  {p}_settle(&model, columns, inputs, state);
  printf("t [s],x [m],y [m],psi [rad],u [m/s],v [m/s],r [rad/s],extrapolation\\n");
  for (k = 0; k <= 6000; k++) {{
    if (k % 100 == 0)
      printf("%g,%.17g,%.17g,%.17g,%.17g,%.17g,%.17g,%.3g\\n", 0.1 * k, (double)state[0], (double)state[1],
        (double)state[2], (double)state[3], (double)state[4], (double)state[5],
        {p}_extrapolation(&model, state, inputs));
{clock}    if ({p}_step(&model, state, inputs, 0.1)) {{
      fprintf(stderr, "the motion is not finite\\n");
      return 1;
    }}
  }}
  return 0;
}}
"""


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


def readme(product: Product) -> str:
    """How to compile and use the C product of ``product``."""
    p, up = product.identifier, product.identifier.upper()
    caveats = "".join(f"* {caveat}\n" for caveat in product.caveats) or "* none\n"
    return f"""# {product.ship.title} in C

`{p}.h` and `{p}.c` are the whole ship: C99 and C++11, the C library's mathematics and nothing else, no allocation, no
global that is written. `example.c` turns the ship for 600 s. `product.json` says where the ship comes from, with each
coefficient's standard deviation, bounds and verdict.

```
{BUILD.format(p=p)}
c++ -std=c++11 -O2 -x c++ {p}.c example.c -lm -o example
```

* Fast: `-O3 -march=native`, which also makes `{p}_step_many` work eight ships at once. `-ffast-math` may be used.
* Single precision: `-D {up}_SINGLE` for every file that includes the header. Positions are then good to 1e-7 of the
  distance from the origin.
* A changed coefficient: call `{p}_init` again with all of them; the state stays.
* Save and restore: copy the model and the state, byte by byte.
* `{p}_extrapolation` says how far a state lies outside what the trials held. It is 0 inside, and -1 where no range is
  known.

Caveats:
{caveats}"""

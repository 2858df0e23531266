"""The folder of the MATLAB and Octave product: M file, MEX source with the C behind it, an example."""

from __future__ import annotations

from pathlib import Path

from delivery.c.package import approach
from delivery.c.source import c_files
from delivery.matlab.function import function_m
from delivery.matlab.gateway import gateway_c
from delivery.product import Product


def write_matlab(product: Product, target: Path) -> None:
    """Write the MATLAB product of ``product`` into the folder ``target``. Raises UserError where it cannot hold it."""
    p = product.identifier
    files = c_files(product) | {
        f"{p}.m": function_m(product),
        f"{p}_mex.c": gateway_c(product),
        "example_turn.m": example_m(product),
        "README.md": readme(product),
    }
    for name, text in files.items():
        (target / name).write_text(text, encoding="utf-8", newline="\n")


def example_m(product: Product) -> str:
    """A script that steers ``product`` through 600 s with the rudder held."""
    p, (speed, inputs) = product.identifier, approach(product)
    settings = "".join(
        f"inputs({list(product.model.controls).index(name) + 1}) = {x!r};  % {name}\n" for name, x in inputs.items()
    )
    clock = ""
    if "time" in product.model.controls:
        clock = f"  inputs({list(product.model.controls).index('time') + 1}) = 0.1 * (k - 1);\n"
    return f"""% A turn of 600 s in steps of 0.1 s; compiled where {p}_mex has been built (see README.md).
p = {p}();
ship = @{p};
if exist('{p}_mex', 'file') == 3
  ship = @{p}_mex;
end
inputs = zeros({len(product.model.controls)}, 1);
{settings}state = ship('settle', [0; 0; 0; {speed!r}; 0; 0], inputs, p);
motion = zeros(6001, 6);
for k = 1:6001
  motion(k, :) = state(1:6);
{clock}  state = ship('step', state, inputs, 0.1, p);
end
fprintf('after 600 s: x %.3f m, y %.3f m, heading %.1f deg, speed %.3f m/s, extrapolation %.2f\\n', motion(end, 1), ...
  motion(end, 2), motion(end, 3) * 180 / pi, hypot(motion(end, 4), motion(end, 5)), ...
  ship('extrapolation', state, inputs, p));
"""


def readme(product: Product) -> str:
    """How to use the MATLAB product of ``product``."""
    p = product.identifier
    caveats = "".join(f"* {caveat}\n" for caveat in product.caveats) or "* none\n"
    first = product.coefficients[0].identifier
    return f"""# {product.ship.title} for MATLAB and Octave

`{p}.m` is the whole ship; `help {p}` says how to ask it. `{p}_mex.c` is the same as compiled code, with `{p}.h` and
`{p}.c`; a C compiler is needed for it only:

```
mex {p}_mex.c                  MATLAB
mkoctfile --mex {p}_mex.c      Octave
```

`example_turn.m` turns the ship for 600 s, compiled where it can be.

* `p = {p}()` is the struct of parameters: `p.coefficients.{first}.value`, and `std`, `unit`, `lower`, `upper`,
  `verdict`. Change a value and hand `p` on.
* `{p}('extrapolation', state, inputs, p)` says how far a state lies outside what the trials held.
* In Simulink call it in a MATLAB Function block (`coder.extrinsic('{p}')`), or use the FMU (`mmg export --format fmu`).

Caveats:
{caveats}"""

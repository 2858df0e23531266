"""The exported C compiles everywhere without a warning, needs the C library alone, and survives harsh flags."""

from __future__ import annotations

import re
import shutil
import subprocess
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from cases.maneuvers.self_propulsion import speed_for
from cases.shipfiles.ship_file import load_ship
from delivery.c.source import approach, write_c
from delivery.product import Product, identifiers
from fitting.selection.candidates import candidate
from tests.delivery.c.test_source import SHIPS, ship_of
from tests.support.c_products import COMPILERS, STRICT, compiled, compiler, product, write_files
from tests.support.quick import first_quick

VARIED = ("hybrid", "esso_osaka_3m", "twin rudders", "memory effects")
FEW = first_quick(VARIED, pytest.mark.longest)
ENVELOPES: tuple[dict[str, tuple[float, float]] | None, ...] = (
    {"beta": (-0.1, 0.1), "u": (0.0, 1.0)}, None, {}, {"u": (0.0, 1.0)},
)  # fmt: skip
"""Ranges of the trials."""


def compile_strictly(which: str, of: Product, folder: Path, *flags: str) -> None:
    """Fails unless the source of ``of`` compiles without a warning."""
    command = [*compiler(which), *STRICT, *flags, "-c", write_files(of, folder), "-o", folder / "ship.o"]
    done = subprocess.run(command, capture_output=True, text=True)
    assert done.returncode == 0 and not done.stderr, done.stderr[:2000]


def test_the_turn_of_the_example_begins_as_the_ship_runs() -> None:
    """At the speed that the revolutions give, inside what the trials held, else at the ship's own speed."""
    held = {"n": (-10.0, 8.0)}
    speed, moved = approach(product("esso_osaka_3m", held))
    assert moved["n"] == 8.0 and moved["delta"] == 0.3
    assert abs(speed - speed_for(load_ship("esso_osaka_3m"), 8.0)) < 1e-3
    speed, moved = approach(product("vectwin_3m", {}))
    assert moved["delta_port"] == moved["delta_starboard"] == 0.3 and 5.0 < moved["n"] < 20.0
    assert abs(speed - 0.07 * np.sqrt(9.81 * 3)) < 0.01
    weak = candidate(load_ship("vectwin_3m"), "sm2-order2").ship  # no revolutions hold its speed
    assert 0.3 < approach(product(weak, {}))[0] < 0.5


@pytest.mark.slow
@pytest.mark.parametrize(
    "name", first_quick(("hybrid", *(name for name in SHIPS if name != "hybrid")), pytest.mark.longest)
)
@pytest.mark.parametrize("which", list(COMPILERS))
def test_every_ship_compiles_without_a_warning(which: str, name: str, tmp_path: Path) -> None:
    """What is written of the ranges of the trials is the same for every ship, single precision is of two compilers."""
    flags = ["-ffast-math", *["-DHYBRID_SINGLE"] * which.startswith(("gcc, C++", "clang, C"))] * (name == "hybrid")
    for held in ENVELOPES if name == "esso_osaka_3m" else ENVELOPES[:1]:
        of = product(ship_of(name), held)
        compile_strictly(which, of, tmp_path, "-O1", *(f.replace("HYBRID", of.identifier.upper()) for f in flags))


def symbols_of(name: str, folder: Path, flags: Sequence[str], *options: str) -> str:
    """What nm lists of the compiled ship ``name``; the test is skipped where it is missing."""
    if shutil.which("nm") is None:
        pytest.skip("nm is missing")
    source, built = write_files(product(ship_of(name)), folder), folder / "ship.o"
    subprocess.run([*compiler("gcc, C"), "-O1", *flags, "-c", source, "-o", built], check=True)
    return subprocess.run(["nm", *options, built], capture_output=True, text=True, check=True).stdout


@pytest.mark.slow
def test_it_needs_the_c_library_alone_and_writes_nothing_global(tmp_path: Path) -> None:
    mathematics = {"sin", "cos", "tan", "asin", "acos", "atan", "sinh", "cosh", "tanh", "sqrt", "exp", "log", "expm1",
                   "log1p", "erf", "floor", "ceil", "pow", "atan2", "fmod", "hypot", "sincos"}  # fmt: skip
    for name in VARIED[:2]:
        needed = {word.split("@")[0] for word in re.findall(r"U (\S+)", symbols_of(name, tmp_path, (), "-u"))}
        assert needed - {"memcpy", "memset", "_GLOBAL_OFFSET_TABLE_"} <= mathematics, needed
    listed = symbols_of("hybrid", tmp_path, ("-fno-pic", "-fno-pie"))
    assert not re.findall(r" [BbCDdSs] ", listed), listed


def turned(name: str, folder: Path, seconds: float, **options: object) -> np.ndarray:
    """State after a turn with the rudder to alternate sides."""
    ship = compiled(product(ship_of(name)), folder, **options)  # type: ignore[arg-type]
    names = ship.of.model.controls
    inputs = np.array([10.0 if n in ("n", "n_2") else 0.3 if "delta" in n else 0.0 for n in names])
    state = ship.settle(np.array([0.0, 0.0, 0.0, 0.4, 0.0, 0.0]), inputs)
    for k in range(int(seconds / 0.1)):
        side = 1.0 if (k // 300) % 2 else -1.0
        moved = inputs * [side if "delta" in n else 1.0 for n in names]
        state, code = ship.step(state, moved, 0.1)
        assert code == 0
    return state.astype(float)


@pytest.mark.slow
@pytest.mark.parametrize("name", FEW)
def test_fast_mathematics_move_600_s_by_less_than_a_nanometre(name: str, tmp_path: Path) -> None:
    exact = turned(name, tmp_path, 600.0)
    fast = turned(name, tmp_path, 600.0, flags=("-O3", "-ffast-math"))
    assert np.abs(fast - exact).max() < 1e-9
    assert np.finfo(float).tiny / 2 > 0.0  # the process that loads it keeps its subnormal numbers


@pytest.mark.slow
def test_single_precision_follows_within_its_digits(tmp_path: Path) -> None:
    exact, single = turned("hybrid", tmp_path, 60.0), turned("hybrid", tmp_path, 60.0, single=True)
    assert np.abs(single - exact).max() < 1e-3 * np.abs(exact).max()
    assert np.abs(single - exact).max() > 0.0


HARNESS = """
#include "{p}.h"
#include <stdlib.h>
#include <string.h>
int main(void) {{
  {p}_model *model = ({p}_model *)malloc(sizeof *model), *copy = ({p}_model *)malloc(sizeof *copy);
  double *state = (double *)malloc({up}_STATES * sizeof(double));
  double *rates = (double *)malloc({up}_STATES * sizeof(double));
  double *inputs = (double *)calloc({up}_INPUTS, sizeof(double)), *columns = (double *)calloc(6, sizeof(double));
  double *forces = (double *)malloc(3 * {up}_ROLES * sizeof(double));
  double *by = (double *)malloc({up}_STATES * {up}_STATES * sizeof(double));
  double *with = (double *)malloc({up}_STATES * {up}_INPUTS * sizeof(double));
  double *many = (double *)malloc(11 * {up}_STATES * sizeof(double));
  double *all = (double *)calloc(11 * {up}_INPUTS, sizeof(double)), total = 0.0;
  int i, j;
  {p}_init(model, NULL);
  {p}_init(model, {p}_coefficient_defaults);
  memcpy(copy, model, sizeof *model);
  columns[3] = 0.4; inputs[0] = 10.0;
  {p}_settle(copy, columns, inputs, state);
  for (i = 0; i < 100; i++) if ({p}_step(copy, state, inputs, 0.07 * i)) return 1;
  {p}_rates(copy, state, inputs, rates); {p}_forces(copy, state, inputs, forces);
  {p}_columns(copy, state, columns); {p}_jacobians(copy, state, inputs, by, with);
  for (i = 0; i < 11; i++) for (j = 0; j < {up}_STATES; j++) many[i * {up}_STATES + j] = state[j];
  if ({p}_step_many(copy, 11, many, all, 0.1)) return 1;
  total = {p}_extrapolation(copy, state, inputs) + rates[0] + forces[0] + by[0] + with[0];
  free(model); free(copy); free(state); free(rates); free(inputs); free(columns); free(forces); free(by); free(with);
  free(many); free(all);
  return total == total ? 0 : 1;
}}
"""


@pytest.mark.longest
@pytest.mark.slow
@pytest.mark.parametrize("name", FEW)
def test_sanitizers_find_nothing(name: str, tmp_path: Path) -> None:
    command, of = compiler("gcc, C"), product(ship_of(name))
    source, main = write_files(of, tmp_path), tmp_path / "main.c"
    main.write_text(HARNESS.format(p=of.identifier, up=of.identifier.upper()))
    flags = ["-g", "-O1", "-fsanitize=address,undefined", "-fno-sanitize-recover=all", "-lm", "-o", tmp_path / "run"]
    done = subprocess.run([*command, source, main, *flags], capture_output=True, text=True)
    if (done.returncode and "sanit" in done.stderr + done.stdout) or "lasan" in done.stderr:
        pytest.skip("the compiler has no sanitizers")
    assert done.returncode == 0, done.stderr
    ran = subprocess.run([tmp_path / "run"], capture_output=True, text=True)
    assert ran.returncode == 0, ran.stderr[:3000]


@pytest.mark.slow
def test_the_example_prints_a_turn(tmp_path: Path) -> None:
    command, of = compiler("gcc, C"), product(ship_of("esso_osaka_3m"))
    write_c(of, tmp_path)
    assert {p.name for p in tmp_path.iterdir()} == {"esso_osaka_3m.h", "esso_osaka_3m.c", "example.c", "README.md"}
    build = re.search(r"^cc -std=c99 .*$", (tmp_path / "README.md").read_text(), re.MULTILINE)
    assert build
    subprocess.run([*command, *STRICT, *build[0].split()[2:]], check=True, cwd=tmp_path)
    rows = subprocess.run([tmp_path / "example"], capture_output=True, text=True, check=True).stdout.splitlines()
    assert rows[0].startswith("t [s],x [m],y [m],psi [rad]") and len(rows) == 62
    last = [float(x) for x in rows[-1].split(",")]
    assert last[0] == 600.0 and last[3] > 6.0, "it has not turned"


@pytest.mark.slow
@pytest.mark.parametrize("name", ["3rd ship", "Été-ro", "double", "日本丸", 'a"b?' + "?-c", "X" * 60])
def test_any_name_of_a_ship_makes_an_identifier(name: str, tmp_path: Path) -> None:
    ship = replace(ship_of("esso_osaka_3m"), name=name, reference="*/ #error")
    provenance = {"source": f"{name}*/", "kind": "t\\"}
    of = replace(product(ship), identifier=identifiers([name])[0].lower(), provenance=provenance)
    compile_strictly("gcc, C", of, tmp_path, "-fsyntax-only")

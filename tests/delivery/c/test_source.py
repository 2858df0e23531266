"""The exported C: the numbers of Python, a filter that follows as ``Tracker``, and code that compiles everywhere."""

from __future__ import annotations

import math
import re
import shutil
import subprocess
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import cache, partial
from itertools import pairwise
from pathlib import Path
from typing import Any

import casadi as ca
import numpy as np
import pytest

from cases.maneuvers.self_propulsion import speed_for
from cases.shipfiles.ship_file import load_ship
from delivery.c.source import approach, write_c
from delivery.c.tracker import TrackedShip, tracker_files
from delivery.export import export
from delivery.product import Product, identifiers
from fitting.selection.candidates import candidate
from mmg.errors import Conflict, Missing, UnknownName
from mmg.model import columns, states_behind
from mmg.network import Layers, Network
from mmg.rollout import Simulator
from mmg.ship import Ship
from mmg_ident.tracker import Tracker
from tests.support.actuator_ships import true_ship
from tests.support.c_products import COMPILERS, STRICT, Compiled, compiled, compiler, product, write_files
from tests.support.hybrids import lacking
from tests.support.quick import first_quick

# The exported C gives the numbers of Python
REMEMBERING = ("rudder_lag", "rudder_backlash", "hull_memory", "velocity_filter", "current", "gyro")


def hybrid(members: int = 1, widths: tuple[int, ...] = (32, 32), name: str = "esso_osaka_3m") -> Ship:
    """A ship of the library with a network of random weights."""
    rng, ship = np.random.default_rng(7), load_ship(name)
    chosen = ship.features[::-1]
    sizes = (len(chosen), *widths, 3)
    layers = []
    for _ in range(members):
        weights = tuple(rng.normal(size=(b, a)) / np.sqrt(a) for a, b in pairwise(sizes))
        layers.append(Layers(weights, tuple(rng.normal(size=b) for b in sizes[1:-1])))
    scales, limit = rng.uniform(0.3, 2.0, len(chosen)), np.full(len(chosen), np.inf)
    return ship.with_network(Network(chosen, scales, tuple(layers), np.array([2e-3, 2e-3, 1e-3]), -limit, limit))


def remembering() -> Ship:
    """A ship with effects that remember."""
    ship = load_ship("esso_osaka_3m")
    for name in REMEMBERING:
        ship = ship.with_effect(name)
        first = next(s for s in ship.symbols if s.startswith(f"{name}."))
        c = ship.coefficients[first]
        ship = ship.with_values({first: c.value + 0.1 * c.std})
    return ship


def generated() -> Ship:
    """A ship of generated terms of any size, with the actuators of a library ship."""
    ship, rng = candidate(load_ship("esso_osaka_3m"), "sm2-order2").ship, np.random.default_rng(5)
    return ship.with_values({s: c.value + c.std * rng.normal() for s, c in ship.coefficients.items() if "_" in s[1:2]})


SHIPS: dict[str, Callable[[], Ship]] = {
    **{name: partial(load_ship, name) for name in ("esso_osaka_3m", "kvlcc2_l7", "kvlcc2_full", "mariner")},
    "twin rudders": lambda: load_ship("vectwin_3m"),
    "four pods": lambda: true_ship("pods"),
    "hybrid": hybrid,
    "hybrid of three networks of one layer": lambda: hybrid(3, (6,)),
    "hybrid of three layers": lambda: hybrid(1, (5, 7, 4)),
    "memory effects": remembering,
    "generated": generated,
}


@cache
def ship_of(name: str) -> Ship:
    return SHIPS[name]()


@pytest.fixture(scope="module", params=SHIPS)
def ship(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Compiled:
    return compiled(product(ship_of(request.param)), tmp_path_factory.mktemp("c"))


def points(of: Ship, count: int = 20) -> tuple[np.ndarray, np.ndarray]:
    """Logged columns (count, 6) and inputs (count, C) anywhere a ship may be, at rest and astern too."""
    rng, L = np.random.default_rng(3), of.particulars["L"]
    fast = np.sqrt(9.81 * L)
    six = rng.normal(size=(count, 6)) * [L, L, 2.0, 0.15 * fast, 0.05 * fast, 0.1 * fast / L]
    size = {"delta": 0.5, "azimuth": 0.5, "wind": 4.0}
    sizes = [size.get(name.partition("_")[0], 10.0 * np.sqrt(3 / L)) for name in of.inputs]
    inputs = rng.normal(size=(count, len(of.inputs))) * sizes
    six[0] = inputs[0] = 0.0
    return six, inputs


def close(found: np.ndarray, expected: np.ndarray, tolerance: float = 1e-12) -> bool:
    """Whether each row differs by at most ``tolerance`` of its largest number."""
    found, expected = np.atleast_2d(found), np.atleast_2d(expected)
    size = np.abs(expected).max(axis=-1, keepdims=True)
    return bool((np.abs(found - expected) <= tolerance * np.maximum(size, 1e-3)).all())


@pytest.mark.slow
def test_rates_forces_columns_memory_and_jacobians_agree_with_python_also_of_other_coefficients(ship: Compiled) -> None:
    model, theta = ship.of.model, ship.of.ship.values
    z, c = ca.SX.sym("z", len(model.states)), ca.SX.sym("c", len(model.controls))
    rates = model.rates(z, c, theta)
    exact = ca.Function("jacobians", [z, c], [ca.jacobian(rates, z), ca.jacobian(rates, c)])
    for six, inputs in zip(*points(ship.of.ship), strict=True):
        state = states_behind(model, six[:, None], inputs[:, None], theta)[:, 0]
        assert close(ship.settle(six, inputs), state)
        assert close(ship.rates(state, inputs), np.array(model.rates(state, inputs, theta)).ravel())
        assert close(ship.forces(state, inputs).T, np.array(model.forces(state, inputs, theta)).T)
        assert close(ship.columns(state), columns(model, state[:, None], theta)[:, 0])
        for found, expected in zip(ship.jacobians(state, inputs), exact(state, inputs), strict=True):
            assert close(found, np.array(expected))
    other = theta * np.random.default_rng(5).uniform(0.9, 1.1, len(theta))
    state = states_behind(model, six[:, None], inputs[:, None], other)[:, 0]
    for values, given in ((other, other), (theta, None)):
        ship.init(given)
        assert close(ship.rates(state, inputs), np.array(model.rates(state, inputs, values)).ravel())


@pytest.mark.slow
def test_600_s_agree_with_the_simulator(ship: Compiled) -> None:
    h, L = 0.5, ship.of.ship.particulars["L"]
    parts = max(1, int(np.ceil(h / ship.of.longest_step - 1e-9)))
    start = np.array([0.0, 0.0, 0.3, 0.1 * np.sqrt(9.81 * L), 0.0, 0.0])
    rng = np.random.default_rng(11)
    held = np.repeat(rng.normal(size=(30, len(ship.of.model.controls))), 40, axis=0)
    names = ship.of.model.controls
    held *= [0.3 if "delta" in n or n == "azimuth" else 1.0 if n.startswith("wind") else 0.0 for n in names]
    revolutions = 0.12 * np.sqrt(9.81 * L) / (0.6 * ship.of.ship.particulars.get("D_P", 1.0))
    held[:, [n in ("n", "n_2") for n in names]] = revolutions
    state = ship.settle(start, held[0])
    python = Simulator(ship.of.ship).run(state[:, None], np.repeat(held, parts, axis=0)[:, :, None], h / parts)
    for k, inputs in enumerate(held, 1):
        state, code = ship.step(state, inputs, h)
        assert code == 0
        assert np.abs(state - python[k * parts, :, 0]).max() < 1e-9, k


@pytest.mark.slow
def test_many_ships_move_as_one_by_one_and_one_that_fails_leaves_the_others_alone(ship: Compiled) -> None:
    six, inputs = points(ship.of.ship, 17)
    starts = np.array([ship.settle(a, b) for a, b in zip(six, inputs, strict=True)])
    starts[:, 2] += np.random.default_rng(2).uniform(-300.0, 300.0, len(starts))
    starts[3, 3], starts[16, 5], starts[5, 2] = np.nan, 1e200, 3e6
    many, failed = ship.step_many(starts, inputs, 0.1)
    alone = [ship.step(start, held, 0.1) for start, held in zip(starts, inputs, strict=True)]
    assert failed == sum(code for _, code in alone) >= 1
    for k, (state, code) in enumerate(alone):
        assert np.array_equal(many[k], starts[k], equal_nan=True) if code else close(many[k], state, 1e-11)
    for h in (-0.1, np.nan, np.inf):
        same, failed = ship.step_many(starts, inputs, h)
        assert failed == 17 and np.array_equal(same, starts, equal_nan=True)
        assert ship.step(starts[0], inputs[0], h)[1] == 1
    assert ship.step_many(starts, inputs, 0.0)[1] == 0


# The filter in C follows a ship as ``mmg_ident.Tracker`` does
EXACT = 1e-9
HEADING = 2
REPLAY = """
#include "SHIP.h"
#include <stdio.h>
int main(void) {
  static SHIP_filter f, later;
  static double row[7 + UPPER_INPUTS], mean[UPPER_ESTIMATES], covariance[UPPER_ESTIMATES * UPPER_ESTIMATES];
  int i = 0, k;
  SHIP_start(&f, NULL);
  while (scanf("%lf", row + i) == 1) {
    if (++i < 7 + UPPER_INPUTS) continue;
    i = 0;
    printf("%d ", SHIP_update(&f, row[0], row + 1, row + 7));
    for (k = 0; k < 2; k++) {
      if (k) SHIP_forecast(&f, 20.0, NULL, &later);
      SHIP_estimate(k ? &later : &f, mean, covariance);
      for (i = 0; i < UPPER_ESTIMATES; i++) printf("%.17g ", mean[i]);
      for (i = 0; i < UPPER_ESTIMATES; i++) printf("%.17g ", covariance[i * (UPPER_ESTIMATES + 1)]);
    }
    printf("%.17g %d\\n", f.nis, f.compared);
    i = 0;
  }
  return 0;
}
"""


def late() -> Ship:
    """A ship whose actuators and instruments remember."""
    ship = load_ship("esso_osaka_3m")
    effects = {"control_delay": {"tau": 0.4}, "velocity_filter": {"tau": 1.0}, "rudder_lag": {"T": 0.8}}
    for name, values in (effects | {"gnss_delay": {}, "antenna_offset": {"x": 0.5}, "current": {"x": 0.03}}).items():
        ship = ship.with_effect(name, values)
    return ship


KINDS: dict[str, Any] = {
    "plain": (lambda: load_ship("esso_osaka_3m"), ()),
    "chosen coefficients, memory": (late, {"X_0F": 0.002, "velocity_filter.tau": 0.2}),
    "hybrid": (lacking, ("N_r",)),
    "four pods": (lambda: true_ship("pods"), ()),
}


def record(ship: Ship, seconds: int = 90) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Times (N,) that are irregular, with a gap; logged columns (N, 6), some missing; inputs (N, C) of a ship."""
    rng, scale = np.random.default_rng(4), math.sqrt(ship.particulars["L"] / 3)
    swing = {"delta": 0.3, "azimuth": 0.3, "wind": 2.0, "n": 10.0 / scale}
    sizes = [swing.get(name.partition("_")[0], 0.0) for name in ship.inputs]
    wave = np.sin(np.arange(seconds)[:, None] / 9 + np.arange(len(sizes)))
    inputs = np.where([n.partition("_")[0] == "n" for n in ship.inputs], 1 + 0.2 * wave, wave) * sizes
    start = np.array([[100.0, -50.0, 3.0, 0.4, 0.0, 0.0]]).T
    simulator = Simulator(ship)
    logged = simulator.columns(simulator.run(start, inputs, 1.0)[:-1])[..., 0]
    logged += rng.normal(size=logged.shape) * [0.02, 0.02, 0.003, 0.006, 0.006, 0.001]
    logged[:, HEADING] = np.mod(logged[:, HEADING], math.tau)
    logged[rng.random(logged.shape) < 0.2] = np.nan
    logged[0] = [100.0, -50.0, 3.0, np.nan, 0.0, np.nan]
    kept = np.r_[0:40, 55:seconds]
    times = np.arange(seconds) + 0.1 * rng.random(seconds)
    return times[kept], logged[kept], inputs[kept]


@pytest.mark.slow
@pytest.mark.parametrize("name", first_quick(KINDS, pytest.mark.longest))
def test_each_sample_and_forecast_is_that_of_python(name: str, tmp_path: Path) -> None:
    made, coefficients = KINDS[name]
    ship = made()
    of = TrackedShip.of(product(ship), coefficients)
    tracker = Tracker(ship, coefficients)
    for file, text in tracker_files(of).items():
        (tmp_path / file).write_text(text)
    p = of.identifier
    (tmp_path / "replay.c").write_text(REPLAY.replace("SHIP", p).replace("UPPER", p.upper()))
    command = [*compiler("gcc, C"), *STRICT, "-O1", f"{p}.c", "replay.c", "-o", "replay", "-lm"]
    subprocess.run(command, cwd=tmp_path, check=True)
    times, logged, inputs = record(tracker.ship)
    rows = np.column_stack([times, logged, inputs])
    text = "\n".join(" ".join(repr(float(x)) for x in row) for row in rows)
    printed = subprocess.run([tmp_path / "replay"], input=text, capture_output=True, text=True, check=True).stdout
    found = np.array([[float(x) for x in line.split()] for line in printed.splitlines()])
    air = tracker.inputs.index("wind_speed")
    M, expected = len(of.random.names) + 6, []
    for t, row, held in zip(times, logged, inputs, strict=True):
        wind = np.hypot(*held[air : air + 2]), np.arctan2(-held[air + 1], -held[air])
        state = tracker.update(t, row, [*held[:air], *wind])
        later = tracker.forecast(20.0)
        expected.append([0, *state.mean, *state.std, *later.states[-1], *later.std[-1], state.nis, state.compared])
    assert state.names[6:] == of.random.names
    codes, mean, variance, later, later_variance, last = np.split(found, np.cumsum([1, M, M, M, M]), axis=1)
    later_std = np.sqrt(later_variance[:, :6] + tracker.noise.sensors**2)
    shown = np.column_stack([codes, mean, np.sqrt(variance), later[:, :6], later_std, last])
    assert len(shown) == len(times) and np.ptp(mean[:, HEADING]) > 0.04
    assert np.abs(shown - expected).max() < EXACT, np.abs(shown - expected).max(axis=0)


def test_coefficients_that_cannot_be_estimated_are_refused(tmp_path: Path) -> None:
    for k, (chosen, kind) in enumerate([(["N_rr_"], UnknownName), (["tow.X"], Conflict), ({"N_r": -1.0}, Missing)]):
        with pytest.raises(kind):
            export(product("esso_osaka_3m"), "c-tracker", tmp_path / str(k), coefficients=chosen)
        assert not (tmp_path / str(k)).exists()
    with pytest.raises(Conflict):
        export(product("esso_osaka_3m"), "c", tmp_path / "c", coefficients=["N_r"])


# The exported C compiles everywhere without a warning, needs the C library alone, and survives harsh flags
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

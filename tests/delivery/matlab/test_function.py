"""The M file and the MEX source give the numbers of Python in Octave."""

from __future__ import annotations

import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest

from delivery.matlab.package import write_matlab
from delivery.product import Product
from mmg.model import columns, states_behind
from mmg.rollout import Simulator
from mmg.ship import Ship
from tests.delivery.c.test_source import points, ship_of
from tests.support.c_products import product
from tests.support.quick import first_quick

COUNT = 4
SCRIPT = """
{build}
ship = @{function};
p = {identifier}();
given = load('given.txt');
six = given(1:6, :); inputs = given(7:end, :);
file = fopen('found.txt', 'w');
for k = 1:columns(given)
  state = ship('settle', six(:, k), inputs(:, k), p);
  fprintf(file, '%.17g\\n', state, ship('rates', state, inputs(:, k), p), ship('columns', state, p));
  fprintf(file, '%.17g\\n', ship('forces', state, inputs(:, k), p)', ship('step', state, inputs(:, k), 0.7, p));
  fprintf(file, '%.17g\\n', ship('extrapolation', state, inputs(:, k), p));
end
p.coefficients.{first}.value = 1.1 * p.coefficients.{first}.value;
fprintf(file, '%.17g\\n', ship('rates', state, inputs(:, end), p));
fclose(file);
"""


def octave(folder: Path, script: str) -> str:
    """What Octave says of a ``script`` that it ran in ``folder``; the test is skipped where it is missing."""
    if shutil.which("octave") is None:
        pytest.skip("octave is missing")
    (folder / "script_of_the_test.m").write_text(script)
    command = ["octave", "--no-gui", "--quiet", "--no-init-file", "script_of_the_test.m"]
    done = subprocess.run(command, cwd=folder, capture_output=True, text=True, timeout=600)
    return done.stdout + done.stderr


def expected(of: Product, six: np.ndarray, inputs: np.ndarray) -> np.ndarray:
    """The numbers that the script prints, from Python."""
    model, theta, simulator, found = of.model, of.ship.values, Simulator(of.ship, compiled=False), []
    for start, held in zip(six, inputs, strict=True):
        state = states_behind(model, start[:, None], held[:, None], theta)[:, 0]
        parts = max(1, int(np.ceil(0.7 / of.longest_step - 1e-9)))
        stepped = simulator.run(state[:, None], np.repeat(held[None, :, None], parts, axis=0), 0.7 / parts)[-1, :, 0]
        found += [state, np.array(model.rates(state, held, theta)).ravel(), columns(model, state[:, None], theta)[:, 0]]
        found += [np.array(model.forces(state, held, theta)).ravel(), stepped, [np.nan]]
    changed = np.array([1.1, *np.ones(len(theta) - 1)]) * theta
    return np.concatenate([*found, np.array(model.rates(state, held, changed)).ravel()])


def compared(ship: Ship, folder: Path, build: str = "") -> None:
    """Fails unless Octave gives what Python gives; ``build`` is run first, and the compiled ship is used."""
    of = product(ship)
    write_matlab(of, folder)
    six, inputs = (a[:COUNT] for a in points(ship))
    np.savetxt(folder / "given.txt", np.vstack([six.T, inputs.T]), fmt="%.17g")
    name = f"{of.identifier}_mex" if build else of.identifier
    first = of.coefficients[0].identifier
    said = octave(folder, SCRIPT.format(build=build, function=name, identifier=of.identifier, first=first))
    assert (folder / "found.txt").exists(), said
    found, known = np.loadtxt(folder / "found.txt"), expected(of, six, inputs)
    assert found.shape == known.shape, said
    told = np.isfinite(known)
    assert (np.abs(found - known)[told] <= 1e-12 * np.maximum(np.abs(known[told]), 1e-3)).all()
    assert (found[~told] >= 0).all() and found[~told].max() > 0


@pytest.mark.parametrize("form", ["m", "mex"])
@pytest.mark.parametrize("name", first_quick(("hybrid", "twin rudders", "memory effects")))
def test_m_and_mex_file_agree_with_python(name: str, form: str, tmp_path: Path) -> None:
    if form == "mex" and shutil.which("mkoctfile") is None:
        pytest.skip("mkoctfile is missing")
    build = f"mkoctfile --mex {product(ship_of(name)).identifier}_mex.c"
    compared(ship_of(name), tmp_path, build if form == "mex" else "")


def test_it_says_what_is_wrong_with_its_arguments(tmp_path: Path) -> None:
    of = product(ship_of("esso_osaka_3m"))
    write_matlab(of, tmp_path)
    rates = ("'rates', zeros(5, 1), zeros(4, 1)", "'rates', zeros(6, 1), zeros(9, 1)")
    calls = ("'sink', 1, 2", *rates, "'step', zeros(6, 1)")
    tries = "".join(f"try, esso_osaka_3m({call}); catch e, disp([e.identifier  e.message]); end\n" for call in calls)
    said = octave(tmp_path, tries)
    lines = said.strip().splitlines()
    assert len(lines) == len(calls), said
    for words, line in zip((":what", ":size", "n, delta, wind_north, wind_east", ":arguments"), lines, strict=True):
        assert words in line


def test_the_struct_of_parameters_holds_units_errors_and_verdicts(tmp_path: Path) -> None:
    ship = ship_of("esso_osaka_3m")
    c = ship.coefficients["Y_v"]
    known = c.with_(verdict="well determined; it's sure", std=0.01, fixed=False)
    write_matlab(product(ship.with_coefficients({"Y_v": known})), tmp_path)
    shown = "printf('%.4f %g [%s]\\n', c.value, c.std, c.verdict); printf('%s ', p.states{:});"
    shown += "printf('%g ', p.ranges.beta);"
    said = octave(tmp_path, f"p = esso_osaka_3m(); c = p.coefficients.Y_v; {shown}")
    assert f"{c.value:.4f} 0.01 [well determined; it's sure]" in said
    assert "x y psi u v r" in said and "-0.4 0.4" in said

"""Speed of the exported C: a step of 0.1 s with its inputs set and its state read, and many ships at once.

``python -m benchmarks.exported_c`` compiles a plain and a hybrid ESSO OSAKA (2 x 32 network) with each compiler that it
finds and prints microseconds of processor time per step, and how many times faster than real time 100 ships run.
"""

from __future__ import annotations

import shutil
import subprocess
import tempfile
from itertools import pairwise
from pathlib import Path

import numpy as np

from cases.shipfiles.ship_file import load_ship
from delivery.c.source import c_files
from delivery.product import product_of
from mmg.network import Layers, Network
from mmg.ship import Ship

PORTABLE, NATIVE = ("-O2",), ("-O3", "-march=native")
WIDTHS = (32, 32)
PROGRAM = r"""
#include "esso_osaka_3m.h"
#include <stdio.h>
#include <time.h>
#define S ESSO_OSAKA_3M_STATES
#define C ESSO_OSAKA_3M_INPUTS
static double now(void) { return (double)clock() / CLOCKS_PER_SEC; }
int main(void) {
  static double states[100 * S], inputs[100 * C];
  esso_osaka_3m_model model;
  double columns[6] = {0, 0, 0, 0.4, 0, 0}, one[C] = {10, 0.2}, state[S], read[6], best = 1e9, many = 1e9, total = 0;
  int repeat, k, i;
  esso_osaka_3m_init(&model, 0);
  for (repeat = 0; repeat < 200; repeat++) {
    double began, took;
    esso_osaka_3m_settle(&model, columns, one, state);
    began = now();
    for (k = 0; k < 1000; k++) {
      one[0] = 10.0; one[1] = 0.1 * (k % 7 - 3); one[2] = 0.0; one[3] = 0.0;
      esso_osaka_3m_step(&model, state, one, 0.1);
      for (i = 0; i < 6; i++) read[i] = state[i];
      total += read[0];
    }
    took = (now() - began) / 1000;
    best = took < best ? took : best;
  }
  for (k = 0; k < 100; k++) {
    for (i = 0; i < S; i++) states[k * S + i] = state[i];
    for (i = 0; i < C; i++) inputs[k * C + i] = one[i] + 0.001 * k;
  }
  for (repeat = 0; repeat < 200; repeat++) {
    double began = now(), took;
    for (k = 0; k < 10; k++) esso_osaka_3m_step_many(&model, 100, states, inputs, 0.1);
    took = (now() - began) / 1000;
    many = took < many ? took : many;
  }
  printf("%.3f %.3f %g\n", 1e6 * best, 1e6 * many, total);
  return 0;
}
"""


def hybrid(ship: Ship) -> Ship:
    """``ship`` with a network of random weights."""
    rng = np.random.default_rng(7)
    sizes = (len(ship.features), *WIDTHS, 3)
    weights = tuple(rng.normal(size=(b, a)) / np.sqrt(a) for a, b in pairwise(sizes))
    layers = Layers(weights, tuple(rng.normal(size=b) for b in WIDTHS))
    ones, limit = np.ones(sizes[0]), np.full(sizes[0], np.inf)
    return ship.with_network(Network(ship.features, ones, (layers,), np.array([2e-3, 2e-3, 1e-3]), -limit, limit))


def measured(ship: Ship, compiler: str, flags: tuple[str, ...]) -> tuple[float, float]:
    """Microseconds of a step, and of the step of one of 100 ships. ship: to export; compiler, flags: to use."""
    base = product_of("esso_osaka_3m", force=True)
    product = type(base)(ship, base.identifier, base.held, base.provenance, base.caveats)
    with tempfile.TemporaryDirectory() as scratch:
        for name, text in {**c_files(product), "main.c": PROGRAM}.items():
            (Path(scratch) / name).write_text(text)
        command = [compiler, "-std=c99", *flags, "main.c", "esso_osaka_3m.c", "-lm", "-o", "run"]
        subprocess.run(command, cwd=scratch, check=True)
        best = [np.inf, np.inf]
        for _ in range(3):
            words = subprocess.run([f"{scratch}/run"], capture_output=True, text=True, check=True).stdout.split()
            best = [min(old, float(new)) for old, new in zip(best, words[:2], strict=True)]
    return best[0], best[1]


def main() -> None:
    """Print the table."""
    plain = load_ship("esso_osaka_3m")
    print(f"{'ship':8} {'compiler':32} {'step [us]':>10} {'of 100 [us]':>12} {'100 ships, x real time':>24}")
    for name, ship in (("plain", plain), ("hybrid", hybrid(plain))):
        for compiler in filter(shutil.which, ("gcc", "clang")):
            for flags in (PORTABLE, NATIVE):
                step, many = measured(ship, compiler, flags)
                words = " ".join((compiler, *flags))
                print(f"{name:8} {words:32} {step:10.2f} {many:12.2f} {0.1 / (100 * many * 1e-6):24.0f}")


if __name__ == "__main__":
    main()

"""The filter in C follows a ship as ``mmg_ident.Tracker`` does."""

from __future__ import annotations

import math
import subprocess
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from cases.shipfiles.ship_file import load_ship
from delivery.c.tracker import TrackedShip, tracker_files
from delivery.export import export
from mmg.errors import Conflict, Missing, UnknownName
from mmg.rollout import Simulator
from mmg.ship import Ship
from mmg_ident.tracker import Tracker
from tests.support.actuator_ships import true_ship
from tests.support.c_products import STRICT, compiler, product
from tests.support.hybrids import lacking
from tests.support.quick import first_quick

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


def remembering() -> Ship:
    """A ship whose actuators and instruments remember."""
    ship = load_ship("esso_osaka_3m")
    effects = {"control_delay": {"tau": 0.4}, "velocity_filter": {"tau": 1.0}, "rudder_lag": {"T": 0.8}}
    for name, values in (effects | {"gnss_delay": {}, "antenna_offset": {"x": 0.5}, "current": {"x": 0.03}}).items():
        ship = ship.with_effect(name, values)
    return ship


KINDS: dict[str, Any] = {
    "plain": (lambda: load_ship("esso_osaka_3m"), ()),
    "chosen coefficients, memory": (remembering, {"X_0F": 0.002, "velocity_filter.tau": 0.2}),
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

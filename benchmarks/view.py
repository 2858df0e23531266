"""The interactive page and the report of a campaign of 40 runs: seconds, megabytes, and how fast the page answers.

``python -m benchmarks.view`` prints a table for RESULTS.md. A headless Chromium opens the page, where there is one.
"""

from __future__ import annotations

import tempfile
import time
from pathlib import Path

import numpy as np

from cases.io.read import read_trials
from cases.maneuvers.definitions import parse_maneuver
from cases.shipfiles.ship_file import load_ship
from cases.simulation.simulate import simulate, write_trial
from cases.trial import Trial
from delivery.view.page import write_view
from delivery.view.sources import gather
from fitting.pipeline import FitOptions, calibrate
from fitting.settings import Settings
from mmg_ident.api import write_report
from tests.support.browser import browser, chromium

RUNS, SECONDS = 40, 600.0
SWITCH = """(async () => {const found = []; for (let i = 1; i <= 30; i++) {
  const s = document.getElementById('run'); s.value = (7 * i) % VIEW.runs.length; s.dispatchEvent(new Event('change'));
  await new Promise(done => setTimeout(done, 150)); found.push(Number(document.documentElement.dataset.switched)); }
  return found.sort((a, b) => a - b)})()"""


def campaign(folder: Path) -> tuple[list[Trial], list[Trial]]:
    """Forty runs of ten minutes, ten samples a second, of the ship of the demo, the last ten held out."""
    ship = load_ship("esso_osaka_3m")
    for number in range(RUNS):
        plan = parse_maneuver("random", ship, seed=number, duration=SECONDS)
        write_trial(simulate(ship, plan, 0.1, seed=number), folder / f"run_{number:02d}.csv")
    trials = read_trials([folder])
    return trials[:-10], trials[-10:]


def main() -> None:
    with tempfile.TemporaryDirectory() as place:
        folder = Path(place)
        (folder / "trials").mkdir()
        train, held_out = campaign(folder / "trials")
        settings = Settings(passes=1, max_iterations=30)
        result = calibrate(load_ship("esso_osaka_3m"), train, held_out, settings, FitOptions(next_trial=False))
        result.save(folder / "run")
        began = time.perf_counter()
        write_report([folder / "run"], folder / "report.html")
        report = time.perf_counter() - began
        began = time.perf_counter()
        size = write_view(gather([folder / "run"]), folder / "view.html")
        view = time.perf_counter() - began
        print(f"| report | {report:.1f} s | {(folder / 'report.html').stat().st_size / 1e6:.1f} MB |")
        print(f"| page | {view:.1f} s | {size / 1e6:.1f} MB |")
        if chromium():
            with browser() as tab:
                ready = []
                for _ in range(5):
                    tab.open(folder / "view.html")
                    tab.drawn()
                    ready.append(float(tab.value("document.documentElement.dataset.ready")))
                switched = tab.value(SWITCH)
                print(f"| page ready, median of 5 | {np.median(ready):.0f} ms | |")
                print(f"| run switch, median and 90 % of 30 | {np.median(switched):.0f}, {switched[26]:.0f} ms | |")
                print(
                    f"| console errors, requests beside the file | {len(tab.console)}, "
                    f"{sum(not a.startswith('file:') for a in tab.requests)} | |"
                )


if __name__ == "__main__":
    main()

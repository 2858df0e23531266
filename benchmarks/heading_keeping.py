"""PD gains for keeping a heading in wind, judged by an ensemble trained on simulated trials and by the true ship.

Wakita et al. (2025), sections 5.3 and 5.4, on the VecTwin ship: feedforward networks are trained on noisy random
control manoeuvres of moderate rudder angles, or of large ones; the ship itself is the truth of the other manoeuvres.
Run from the repository root: python -m benchmarks.heading_keeping
"""

from __future__ import annotations

import time
from pathlib import Path

import numpy as np
import torch
from scipy.stats import spearmanr

from benchmarks.ensembles.fixed_ship import FixedShip
from benchmarks.ensembles.heading_keeping import HeadingKeeping, Judgement, grid, judge, random_winds
from benchmarks.ensembles.heading_keeping_figure import judgement_plot
from benchmarks.random_controls import RandomControls, random_control_trials
from benchmarks.record import record, table
from cases.maneuvers.definitions import parse_maneuver
from cases.shipfiles.ship_file import load_ship
from cases.simulation.gusts import Wind
from cases.simulation.sensors import SensorNoise
from cases.simulation.simulate import simulate
from cases.trial import Trial
from mmg.ship import Ship
from residual.blackbox.models import box_scales, build_box
from residual.ensemble import distances, particles, train_members
from residual.settings import BlackBoxSettings
from residual.system import TrainableSystem
from residual.training.pieces import pieces_of
from residual.training.windows import windows

MEMBERS, PARTICLES, H, RUNS = 10, 50, 1.0, 8
KP, KD = np.geomspace(0.2, 20, 11), np.geomspace(0.5, 200, 11)
FIGURE = Path(__file__).parents[1] / "docs" / "images" / "heading_keeping.png"
TRAINING = {
    "moderate rudder": RandomControls(rudder=12.0, outward=8.0),
    "large rudder": RandomControls(),
}
EXACT = SensorNoise(0.0, 0.0, 0.0, 0.0, 0.0, 0.0)


def ensemble(ship: Ship, how: RandomControls) -> tuple[list[TrainableSystem], float]:
    """Networks trained on RUNS runs, nothing held out, no penalty (section 3); seconds that it took."""
    began, trials = time.perf_counter(), random_control_trials(ship, RUNS, 0, how)
    pieces = pieces_of(trials, H, ship.inputs)
    scales = box_scales(ship, pieces, trials, H)
    training = BlackBoxSettings(seeds=MEMBERS, workers=2, epochs=30, penalty=0.0, zero=False, step=H)
    members, _ = train_members(build_box, ship, scales, training, pieces, pieces)
    return members, time.perf_counter() - began


def tests(ship: Ship) -> dict[str, list[Trial]]:
    """True motion of other manoeuvres, without noise."""

    def run(text: str) -> Trial:
        return simulate(ship, parse_maneuver(text, ship, n=10.0, duration=200.0), 0.5, Wind(0.0))

    return {
        "random, moderate": random_control_trials(ship, 6, 1, TRAINING["moderate rudder"], EXACT),
        "random, large": random_control_trials(ship, 6, 2, TRAINING["large rudder"], EXACT),
        "zigzag": [run("zigzag:10/10"), run("zigzag:20/20"), run("zigzag:-30/30")],
        "turning": [run("turning:20"), run("turning:-35"), run("turning:35")],
    }


def distance_rows(
    name: str, members: list[TrainableSystem], ship: Ship, trials: dict[str, list[Trial]]
) -> list[list[str]]:
    """Eq. 31 and the correlation of Fig. 6, windows of 30 s, TS1 beside TS-infinity; the last row is all together."""
    rows, together = [], []
    for kind, runs in trials.items():
        batch = windows(pieces_of(runs, H, ship.inputs), H, round(30 / H), round(10 / H))
        assert batch is not None
        found = [distances(particles(members, batch, PARTICLES, s), batch.targets.numpy(), batch.mask.numpy())
                 for s in ("ts1", "ts-infinity")]  # fmt: skip
        together.append(found)
        rows.append((kind, found))
    whole = [
        type(pair[0])(
            *(np.concatenate([getattr(d, f) for d in pair]) for f in ("euclidean", "mahalanobis", "variance"))
        )
        for pair in zip(*together, strict=True)
    ]
    rows.append(("all", whole))
    return [
        [name, kind, str(len(pair[0].euclidean)),
         *[" / ".join(f"{value(d):.3g}" for d in pair) for value in (
             lambda d: 1e3 * np.sqrt(d.euclidean.mean()), lambda d: 1e3 * np.sqrt(d.variance.mean()),
             lambda d: np.sqrt(d.mahalanobis.mean()), lambda d: d.correlation(), lambda d: d.spread_correlation())]]
        for kind, pair in rows
    ]  # fmt: skip


def gain_rows(name: str, j: Judgement) -> list[list[str]]:
    """How far costs by one member, by the mean over members and by the worst particle are from the true one."""
    single = [j.particles[i] for i in range(len(j.particles))]
    kinds = {
        "one member (mean over members)": single,
        "mean of the members": [j.particles.mean(axis=0)],
        "worst particle": [j.worst],
    }
    return [
        [
            name,
            kind,
            f"{np.mean([j.overestimated(c) for c in costs]):.0%}",
            f"{np.mean([np.median(c / j.true) for c in costs]):.2f}",
            f"{np.mean([spearmanr(c, j.true).statistic for c in costs]):.2f}",
            f"{np.mean([j.regret(c) for c in costs]):.2f}",
            f"{np.max([j.regret(c) for c in costs]):.2f}",
        ]
        for kind, costs in kinds.items()
    ]


def main() -> None:
    torch.set_num_threads(1)
    ship = load_ship("vectwin_3m")
    task = HeadingKeeping(0.4, 10.0, random_winds(6, (0.5, 2.0), 0), h=H)
    gains, others = grid(KP, KD), tests(ship)
    far, judged, words, shown = [], [], [], {}
    for name, how in TRAINING.items():
        members, seconds = ensemble(ship, how)
        far += distance_rows(name, members, ship, others)
        began = time.perf_counter()
        shown[name] = judge(members, FixedShip(ship), ship.inputs, gains, task)
        judged += gain_rows(name, shown[name])
        words.append(f"{name}: training {seconds:.0f} s, judging {time.perf_counter() - began:.0f} s")
    judgement_plot(shown, KP, KD).savefig(FIGURE)
    lines = [
        f"{MEMBERS} feedforward networks on {RUNS} noisy runs of {TRAINING['large rudder'].seconds:g} s; "
        f"{PARTICLES} particles. {'; '.join(words)} (two processes).",
        "",
        "Eq. 31 on 30 s windows of true motion, TS1 / TS-infinity; bias and spread in mm/s and mrad/s together.",
        "",
        *table(["trained on", "manoeuvre", "windows", "rms bias", "rms spread", "rms Mahalanobis",
                "r(bias, Mahalanobis)", "r(bias, spread)"], far),
        "",
        f"Heading kept for {task.seconds:g} s in {len(task.winds)} random winds with {len(gains)} gains; cost: rms "
        "heading error. Overestimated: performance better than true by more than 5 %. Regret: true cost of the gains "
        "chosen over that of the best.",
        "",
        *table(["trained on", "judged by", "overestimated", "median cost / true", "rank correlation", "regret",
                "largest regret"], judged),
        "",
        "![Cost over gains](../docs/images/heading_keeping.png)",
    ]  # fmt: skip
    record("Heading keeping by an ensemble", "python -m benchmarks.heading_keeping", lines)


if __name__ == "__main__":
    main()

"""Files of a blind benchmark: trials and site files of the cases, and the key, which commits to them by its hash."""

from __future__ import annotations

import hashlib
import json
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.blind.generator.cases import Case, Runs, deal, run
from benchmarks.blind.generator.world import AIR, COLUMNS, POWERS, WORLDS, World

HEADER = "t [s],x [m],y [m],psi [rad],u [m/s],v [m/s],r [rad/s],n [rps],{},wind_speed [m/s],wind_direction [rad]"
RUDDERS = {False: "delta [rad]", True: "delta_starboard [rad],delta_port [rad],n_bow [rps]"}
"""Columns of one rudder, and of two with the bow thruster."""
BATCH = 50
"""Cases that are integrated side by side; one where each has a world of its own."""


def generate(
    out: Path,
    count: int,
    seed: int,
    kind: str,
    world: World = WORLDS["pond"],
    twins: bool = False,
) -> str:
    """Writes ``count`` cases of a kind in a ``world`` into ``out``, or their ``twins`` that hide
    nothing; returns the SHA-256 of the key.

    ``out`` must not exist yet or be empty (FileExistsError). Layout: case_0000/{train,test}/*.csv and perhaps
    site.toml; ship.json (the ship file, which is no secret); key.json (kinds, effects, parameters, strengths,
    hashes of all trials and site files, so that one hash commits to all).
    """
    if out.exists() and any(out.iterdir()):
        raise FileExistsError(f"{out} is not empty")
    out.mkdir(parents=True, exist_ok=True)
    dealer, *seeds = np.random.SeedSequence(seed).spawn(count + 1)
    hands = deal(kind, count, np.random.default_rng(dealer), world.without)
    entries = []
    batch = 1 if world.wide else BATCH
    for first in range(0, count, batch):
        numbers = range(first, min(first + batch, count))
        cases = [Case.prepared(hands[i], seeds[i], world) for i in numbers]
        if twins:
            cases = [case.twin for case in cases]
        runs = run(cases)
        for j, i in enumerate(numbers):
            entries.append(_write_case(out, i, j, cases[j], runs, seed))
    head = {"seed": seed, "kind": kind, "world": world.name, "ship": world.ship, "cases": entries}
    content = (json.dumps(head, indent=1) + "\n").encode()
    (out / "key.json").write_bytes(content)
    (out / "ship.json").write_text(json.dumps({"ship": world.ship}) + "\n")
    return hashlib.sha256(content).hexdigest()


def _write_case(out: Path, number: int, place: int, case: Case, runs: Runs, seed: int) -> dict[str, Any]:
    """Writes one case; returns its entry in the key."""
    name = f"case_{number:04d}"
    folder = out / name
    hashes = {}
    for j, kind in enumerate(case.kinds):
        role = "train" if j < case.training else "test"
        path = folder / role / f"{kind}_{j:02d}.csv"
        path.parent.mkdir(parents=True, exist_ok=True)
        content = _table(runs, place * len(case.kinds) + j, case.world).encode()
        path.write_bytes(content)
        hashes[f"{role}/{path.name}"] = hashlib.sha256(content).hexdigest()
    if case.site:
        (folder / "site.toml").write_text(_site(case.site, case.world.scale))
        hashes["site.toml"] = hashlib.sha256((folder / "site.toml").read_bytes()).hexdigest()
    scale = case.world.scale
    effects = [
        {
            "name": effect.name,
            "strength": strength,
            "parameters": {k: float(v) * scale ** POWERS.get(f"{effect.name}.{k}", 0.0) for k, v in draw.key.items()},
        }
        for (effect, strength), (_, draw) in zip(case.hand, case.drawn, strict=True)
    ]
    return {"case": name, "effects": effects, "seed": [seed, number], "sha256": hashes}


def _table(runs: Runs, column: int, world: World) -> str:
    """The CSV text of one run, for the ship of the world's length."""
    rows, twin = len(runs.n), runs.plant.twin
    signals = (runs.n, runs.delta, *((runs.port, runs.bow) if twin else ()), runs.speed, runs.direction)
    values = np.empty((rows, 7 + len(signals)))
    values[:, 0] = world.sample * np.arange(rows)
    values[:, 1:7] = runs.columns[:, :, column]
    for at, signal in enumerate(signals, start=7):
        values[:, at] = signal[:, column]
    values[:, -1] = (values[:, -1] + np.pi) % (2 * np.pi) - np.pi
    if world.scale != 1:
        values *= world.scale ** np.array([*COLUMNS, *((0.0, -0.5) if twin else ()), *AIR])
    tenths = world.scale == 1 and round(world.sample, 1) == world.sample
    line = ("%.1f" if tenths else "%.6f") + ",%.4f,%.4f" + ",%.6f" * (4 + len(signals)) + "\n"
    return HEADER.format(RUDDERS[twin]) + "\n" + (line * rows) % tuple(values.ravel().tolist())


def _site(site: dict[str, dict[str, Any]], scale: float) -> str:
    """The text of a site file; its numbers are lengths."""
    lines = ["# what is roughly known of the place"]
    for table, entries in sorted(site.items()):
        lines.append(f"\n[{table}]")
        lines += [f"{k} = {json.dumps(v if isinstance(v, str) else float(v) * scale)}" for k, v in entries.items()]
    return "\n".join(lines) + "\n"

"""Small logs of operation: a 3 m model that weaves at sea, with what is wanted of gaps, rest and changes."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from cases.quantities import UNITS
from cases.shipfiles.effects import with_effects
from cases.shipfiles.ship_file import load_ship
from mmg.rollout import Simulator

NOISE = {"x": 0.02, "y": 0.02, "psi": 0.002, "u": 0.005, "v": 0.005, "r": 5e-4}


def sailed(hours: float, fouling: float = 0.0, at: float = 0.0, seed: int = 0) -> dict[str, np.ndarray]:
    """Canonical columns at 1 Hz of the ESSO OSAKA model under random rudder orders, in calm air.

    Her resistance is larger by the share ``fouling`` from the hour ``at`` on.
    """
    ship = with_effects(load_ship("esso_osaka_3m"), ["fouling:share=0"])
    rng, count = np.random.default_rng(seed), round(3600 * hours)
    ordered = np.repeat(rng.uniform(-0.35, 0.35, count // 20 + 1) * (rng.random(count // 20 + 1) < 0.5), 20)[:count]
    n = np.repeat(rng.uniform(9.0, 12.0, count // 200 + 1), 200)[:count]
    simulator, parts = Simulator(ship), []
    state = np.array([[0.0], [0.0], [0.3], [0.7], [0.0], [0.0]])
    split = round(3600 * at)
    for rows, share in ((slice(0, split), 0.0), (slice(split, count), fouling)):
        if rows.start == rows.stop:
            continue
        theta = ship.values.copy()
        theta[ship.symbols.index("fouling.share")] = share
        given = {"n": np.repeat(n[rows], 2), "delta": np.repeat(ordered[rows], 2)}
        inputs = np.column_stack([given.get(name, np.zeros(2 * (rows.stop - rows.start))) for name in ship.inputs])
        states = simulator.run(state, inputs, 0.5, theta)[::2, :6, 0]
        parts.append(states[:-1])
        state = states[-1][:, None]
    columns = dict(zip(("x", "y", "psi", "u", "v", "r"), np.concatenate(parts).T, strict=True))
    columns = {name: values + NOISE[name] * rng.standard_normal(count) for name, values in columns.items()}
    return {"t": np.arange(count, dtype=float), **columns, "n": n, "delta": ordered}


def write_log(folder: Path, columns: Mapping[str, np.ndarray], parts: int) -> list[Path]:
    """Write ``columns`` as so many parts of a log below ``folder``; returns their paths."""
    paths = []
    for k, rows in enumerate(np.array_split(np.arange(len(columns["t"])), parts)):
        path = folder / f"day={k + 1:02d}" / "part-0.parquet"
        path.parent.mkdir(parents=True)
        names = {f"{name} [{UNITS[name]}]": values[rows] for name, values in columns.items()}
        pq.write_table(pa.table(names), path, row_group_size=500)
        paths.append(path)
    return paths

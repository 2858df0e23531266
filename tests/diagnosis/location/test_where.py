"""Where the latent force lies: forces put into known places are found there, and shares are shares."""

from __future__ import annotations

import json

import numpy as np
import pytest

from cases.shipfiles.ship_file import load_ship
from diagnosis.estimation.gridded_trials import GriddedTrials
from diagnosis.estimation.kalman import NoiseModel
from diagnosis.estimation.linearisation import Trajectory
from diagnosis.estimation.map_estimate import Estimate
from diagnosis.estimation.parameters import Priors
from diagnosis.location.where import PHASES, phases, variables_of, where

INPUTS = ("n", "delta", "wind_north", "wind_east")
SHIP = load_ship("esso_osaka_3m")
K, R, H, TAU = 400, 6, 0.5, 4.0


def weaving(seed: int = 1) -> tuple[GriddedTrials, np.ndarray]:
    """Runs that weave to both sides at 0.5 m/s with random phase, and their states (K + 1, R, 6); one is shorter."""
    rng = np.random.default_rng(seed)
    t = H * np.arange(K + 1)[:, None] + np.zeros((1, R))
    phase = rng.uniform(0, 2 * np.pi, R)
    r = 0.02 * np.sin(2 * np.pi * t / 60 + phase)
    psi = np.cumsum(r, axis=0) * H + rng.uniform(0, 2 * np.pi, R)
    u, v = 0.5 + 0.05 * np.cos(2 * np.pi * t / 35 + phase), -0.8 * r
    x, y = (np.cumsum(a, axis=0) * H for a in (u * np.cos(psi), u * np.sin(psi)))
    z = np.stack([x, y, psi, u, v, r], axis=-1)
    inputs = np.zeros((K, R, 4))
    inputs[..., 0], inputs[..., 1], inputs[..., 2] = 10.0, 6 * r[:-1], 1.5
    steps = np.array([K] * (R - 1) + [K - 100])
    names = tuple(f"run_{i}" for i in range(R))
    seen = np.isfinite(z)
    still = np.zeros_like(inputs)
    return GriddedTrials(H, t, z.copy(), seen, seen, inputs, steps, np.arange(R), names, still, still, H), z


def fitted(z: np.ndarray, force: np.ndarray) -> Estimate:
    """An estimate with these states and this latent force (K + 1, R, 3)."""
    none = np.zeros(0)
    noise = NoiseModel(np.ones(3), TAU, np.ones(6))
    values = SHIP.values
    return Estimate(
        values, Priors((), none, none, none, none), none, Trajectory(z, force), noise, np.zeros((0, 0)), 0.0, 1, True
    )


def coloured(seed: int, size: float = 1.0) -> np.ndarray:
    """Ornstein-Uhlenbeck forces (K + 1, R, 3) of this rms."""
    rng, left = np.random.default_rng(seed), np.exp(-H / TAU)
    force = np.zeros((K + 1, R, 3))
    force[0] = rng.standard_normal((R, 3))
    for k in range(K):
        force[k + 1] = left * force[k] + np.sqrt(1 - left**2) * rng.standard_normal((R, 3))
    return size * force


def test_what_does_not_vary_but_for_rounding_is_no_variable() -> None:
    data, z = weaving()
    data.inputs[..., 0] = 15.0 + 1e-12 * np.random.default_rng(1).standard_normal((K, R))
    names = {one.name for one in variables_of(INPUTS, data, z)}
    assert "n" not in names and {"u", "r", "delta", "heading"} <= names
    data.inputs[..., 0] += np.where(np.arange(K)[:, None] < K // 2, 0.0, 0.5)
    assert "n" in {one.name for one in variables_of(INPUTS, data, z)}


def test_force_in_starboard_turns_is_found_there() -> None:
    data, z = weaving()
    force = coloured(2, 0.1)
    starboard = np.where(z[..., 5] > 0, 1.0, 0.0)
    force[..., 1] += 3.0 * starboard
    found = where(INPUTS, data, fitted(z, force), SHIP)
    first = next(row for row in found["regions"] if row["channel"] == "sway" and row["variable"] == "r")
    assert first["low"] >= 0.0
    share = (z[:-1, :, 5] + z[1:, :, 5])[data.inside] > 0
    assert first["ratio"] == pytest.approx(1 / np.sqrt(share.mean()), rel=0.1)
    assert first["mean"] == pytest.approx(3.0, rel=0.05)
    assert first["z"] > 3
    assert found["regions"][0]["channel"] == "sway"
    assert found["channels"]["sway"]["share"] > 0.9
    top = found["variables"][0]
    assert (top["channel"], top["explained"] > 0.8) == ("sway", True)


def test_random_force_points_nowhere() -> None:
    data, z = weaving()
    strongest = []
    for seed in range(8):
        found = where(INPUTS, data, fitted(z, coloured(10 + seed)), SHIP)
        assert found["variables"][0]["explained"] < 0.3
        strongest += [abs(row["z"]) for row in found["regions"][:1]]
    assert np.median(strongest) < 6  # the largest of a hundred or so


def test_shares_add_up_and_all_is_json() -> None:
    data, z = weaving()
    before = coloured(3) * np.array([1.0, 5.0, 0.2])
    found = where(INPUTS, data, fitted(z, before), SHIP, fitted(z, 0.5 * before))
    json.dumps(found, allow_nan=False)
    assert sum(row["share"] for row in found["channels"].values()) == pytest.approx(1)
    for i, channel in enumerate(("surge", "sway", "yaw")):
        rms = float(np.sqrt((before[:-1][data.inside][:, i] ** 2).mean()))
        row = found["channels"][channel]
        assert row["force_rms"] == pytest.approx(rms)
        assert row["force_rms_after"] == pytest.approx(0.5 * rms)
        bands = [b for b in found["bands"] if b["channel"] == channel]
        assert sum(b["share"] for b in bands) == pytest.approx(1)
        assert sum(b["force_rms"] ** 2 for b in bands) == pytest.approx(rms**2)
        assert bands[0]["from_hz"] == 0.0
        runs = [r for r in found["runs"] if r["channel"] == channel]
        energy = sum(r["force_rms"] ** 2 * r["seconds"] for r in runs) / sum(r["seconds"] for r in runs)
        assert energy == pytest.approx(rms**2)
        times = sum(p["share_of_time"] for p in found["phases"] if p["channel"] == channel)
        assert times == pytest.approx(1)


def test_what_lies_behind_the_end_of_a_window_does_not_count() -> None:
    data, z = weaving()
    force = coloured(4)
    found = where(INPUTS, data, fitted(z, force), SHIP)
    spoilt, elsewhere = force.copy(), z.copy()
    spoilt[K - 99 :, -1] = 1e3
    elsewhere[K - 99 :, -1] = 77.0
    assert where(INPUTS, data, fitted(elsewhere, spoilt), SHIP) == found


def test_constant_force_is_the_mean_of_the_runs() -> None:
    data, z = weaving()
    force = coloured(5, 0.05)
    force[..., 0] -= 2.0
    found = where(INPUTS, data, fitted(z, force), SHIP)
    assert found["channels"]["surge"]["mean"] == pytest.approx(-2.0, abs=0.05)
    first = next(b for b in found["bands"] if b["channel"] == "surge")
    assert first["words"] and first["share"] > 0.99
    fast = np.where(np.arange(K + 1) % 4 < 2, 1.0, -1.0)[:, None, None] * np.ones((1, R, 3))
    rows = [b for b in where(INPUTS, data, fitted(z, fast), SHIP)["bands"] if b["channel"] == "sway"]
    assert max(rows, key=lambda b: b["share"])["to_hz"] == pytest.approx(0.5 / H)


def test_phases_of_a_manoeuvre() -> None:
    data, z = weaving()
    z = z.copy()
    z[..., 3:] = (0.5, 0.0, 0.0)
    z[:, 1, 5] = 0.05
    z[:, 2, 3] = 0.5 + 0.1 * np.sin(2 * np.pi * data.t[:, 2] / 40)
    z[:, 3, 3] = 0.02
    z[:, 4, 5] = 0.03 * np.sin(2 * np.pi * data.t[:, 4] / 15)
    data.inputs[:, 5, 0] = -5.0
    number = np.full(data.inside.shape, -1)
    number[data.inside] = phases(INPUTS, data, z, 3.0)
    words = [PHASES[np.bincount(number[:300, i]).argmax()] for i in range(R)]
    assert words == [
        "straight ahead", "steady turning", "accelerating", "drifting slow", "entering a turn / yaw changing",
        "stopping / astern (n<0)",
    ]  # fmt: skip


def test_no_wind_columns_and_one_run() -> None:
    data, z = weaving()
    data.inputs[..., 2:] = 0.0
    one = data.windows(np.arange(R) == 0)
    found = where(INPUTS, one, fitted(z[:, :1], coloured(6)[:, :1]), SHIP)
    json.dumps(found, allow_nan=False)
    assert not any("wind" in row["variable"] for row in found["variables"] + found["regions"])
    assert not any(row["variable"] == "n" for row in found["variables"])  # it does not vary
    still = where(INPUTS, one, fitted(z[:, :1], np.zeros((K + 1, 1, 3))), SHIP)
    json.dumps(still, allow_nan=False)
    assert sum(row["share"] for row in still["channels"].values()) == pytest.approx(1)

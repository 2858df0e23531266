"""A hybrid that knows more at its start: lagged features, errors of the past, a current, coefficients of its own.

What it knows rides along as further rows of the state, so that the compiled rollouts of
``residual.physics.fused_rollout`` train it
as they are: features behind lags; innovations (measured less predicted over the seconds before the start, earth-fixed,
fading); a fading current and a fading force; shifts of the coefficients. What is read from the past of a window is
tabulated once per row by ``with_past`` and travels behind the inputs of the windows.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import casadi as ca
import numpy as np
import torch
from torch import nn

from fitting.prediction.adaptation import Adaptation, adapt
from fitting.prediction.stretches import Record, Stretch, rollout
from fitting.prediction.stretches import WindowBatch as Stretches
from mmg.model import assemble
from mmg.rollout import Simulator
from mmg.ship import Ship
from residual.bounded_network import Residual, Symmetric, TwoLayers, mirror_of
from residual.physics.operator import Physics
from residual.settings import TrainSettings
from residual.system import Hybrid, Past, TrainableSystem
from residual.training.pieces import Piece
from residual.training.scales import Scales

LAGS = (3.0, 10.0, 30.0)
ERRORS = ((3, 0), (10, 0), (10, 10), (10, 20))
"""Innovations: length [s] of the prediction and how long before the start it ends."""
FADE = 45.0
"""Seconds in which innovations, current and force fade, as in ``fitting.prediction.adaptation``."""
EVERY = 5
"""The current of ``fitting.prediction.adaptation`` is known in every fifth row, where windows start."""
EVEN, ODD = (0, 3), (1, 2, 4, 5)
"""Rows of an innovation (x, y, psi, u, v, r in body axes) that keep or change their sign from port to starboard."""
MOST = 3.0
"""Innovations are cut at so many times their rms."""
LIMITS = {"current": (0.02, 0.02), "force": (1.0, 1.0, 1.0), "start": (0.02, 0.02, 0.004)}
"""Typical sizes of what gains move [m/s, rad/s]; forces by the scale of the residual."""


@dataclass(frozen=True)
class Extra:
    """lags, innovation: what the network sees besides; adapted: starts with the current of
    ``fitting.prediction.adaptation``;
    gains: of "current", "force", "start", moved in proportion to the innovations; coefficients: tuned along;
    kappa: cost of (shift / std)^2 of those; cost: of squared gains; network: whether there is one; symmetric.
    """

    lags: tuple[float, ...] = ()
    innovation: bool = False
    adapted: bool = False
    gains: tuple[str, ...] = ()
    coefficients: bool = False
    kappa: float = 0.003
    cost: float = 0.01
    network: bool = True
    symmetric: bool = True


class Knowing(Physics):
    """Ship, then memory (lags F), innovations (6 each), current (2), force (3), coefficients (P), as one state."""

    def __init__(self, ship: Ship, extra: Extra) -> None:
        super().__init__(ship)
        self.extra, self.S = extra, len(self.model.states)
        free = [s for s, c in ship.coefficients.items() if "." not in s and c.std and not c.fixed]
        self.free = tuple(free) if extra.coefficients else ()
        F = len(ship.features)
        sizes = {"ship": self.S, "memory": F * len(extra.lags), "innovation": 6 * len(ERRORS) * extra.innovation}
        sizes |= {"current": 2, "force": 3 * ("force" in extra.gains), "shift": len(self.free)}
        self.sizes, self.width_in = sizes, F + sizes["memory"] + sizes["innovation"]

    @cached_property
    def functions(self) -> dict[str, ca.Function]:
        total, C = sum(self.sizes.values()), len(self.model.controls)
        z, c, a, h, base = (ca.SX.sym(n, k) for n, k in zip("zcahb", (total, C, 3, 1, total), strict=True))
        parts = dict(zip(self.sizes, ca.vertsplit(z, np.cumsum([0, *self.sizes.values()]).tolist()), strict=True))
        ship, memory, current = parts["ship"], parts["memory"], parts["current"]
        model = assemble(self.ship, self.free)
        known = [self.ship.coefficients[s] for s in model.symbols]
        values = ca.vertcat(*[k.value + k.std * parts["shift"][i] for i, k in enumerate(known)])
        air = model.controls.index("wind_north")
        relative = ca.vertcat(c[:air], c[air : air + 2] - current, c[air + 2 :])
        rates, own = model.rates(ship, relative, values), model.features(ship, relative, values)
        force = parts["force"] if self.sizes["force"] else ca.SX(3, 1)
        rates = rates + ca.vertcat(current, 0, force, ca.SX(self.S - 6, 1))
        turn = ca.vertcat(ca.horzcat(ca.cos(ship[2]), ca.sin(ship[2])), ca.horzcat(-ca.sin(ship[2]), ca.cos(ship[2])))
        seen, F = [own], own.numel()
        slow = [(own - memory[i * F : (i + 1) * F]) / lag for i, lag in enumerate(self.extra.lags)]
        for i in range(self.sizes["innovation"] // 6):
            e = parts["innovation"][6 * i : 6 * i + 6]
            seen += [turn @ e[:2], e[2], turn @ e[3:5], e[5]]
            if i == 0:
                seen.insert(1, memory)
        if not self.sizes["innovation"]:
            seen.append(memory)
        fading = ca.vertcat(parts["innovation"], current, parts["force"])
        every = ca.vertcat(rates, *slow, -fading / FADE, ca.SX(self.sizes["shift"], 1))
        logged = model.columns(ship, values)
        columns = ca.vertcat(logged[:3], logged[3:5] + turn @ current, logged[5])
        advanced = base + h * (every + ca.vertcat(ca.SX(3, 1), a, ca.SX(total - 6, 1)))
        features = ca.vertcat(*seen)
        table = {
            "rates": ([z, c], [every]),
            "features": ([z, c], [features]),
            "rates_and_features": ([z, c], [every, features]),
            "columns": ([z], [columns]),
            "advance": ([base, z, a, c, h], [advanced]),
        }
        return {name: ca.Function(f"physics_{name}", *both) for name, both in table.items()}


class Mirrored(Symmetric):
    """A symmetric residual of all features of a ``Knowing``."""

    def __init__(self, own: Residual, physics: Knowing) -> None:
        TwoLayers.__init__(self)
        self.own = own
        errors = np.diag([1.0 if i % 6 in EVEN else -1.0 for i in range(physics.sizes["innovation"])])
        mirror = np.zeros((physics.width_in, physics.width_in))
        at = 0
        for block in [mirror_of(physics.ship.features)] * (1 + len(physics.extra.lags)) + [errors]:
            mirror[at : at + len(block), at : at + len(block)] = block
            at += len(block)
        scales = own.feature_scale
        self.register_buffer("mirror", torch.as_tensor(mirror) * scales[None, :] / scales[:, None], persistent=False)
        self.register_buffer("turned", torch.tensor([[1.0], [-1.0], [-1.0]], dtype=torch.float64), persistent=False)


class Gain(nn.Module):
    """A linear map from innovations in body axes to surge, sway (and yaw) components, alike to port and starboard."""

    def __init__(self, outputs: int) -> None:
        super().__init__()
        R = len(ERRORS)
        self.even = nn.Parameter(torch.zeros(1, len(EVEN) * R, dtype=torch.float64))
        self.odd = nn.Parameter(torch.zeros(outputs - 1, len(ODD) * R, dtype=torch.float64))

    def forward(self, e: torch.Tensor) -> torch.Tensor:
        """(outputs, M) from (R, 6, M)."""
        return torch.cat([self.even @ e[:, EVEN].flatten(0, 1), self.odd @ e[:, ODD].flatten(0, 1)])


def turned(vector: torch.Tensor, psi: torch.Tensor, back: bool = False) -> torch.Tensor:
    """Earth-fixed (2, M) in body axes, or back."""
    c, s = torch.cos(psi), -torch.sin(psi) if back else torch.sin(psi)
    return torch.stack([c * vector[0] + s * vector[1], c * vector[1] - s * vector[0]])


class Extended(Hybrid):
    """A hybrid on a ``Knowing``; its inputs carry, behind those of the ship, what ``with_past`` has put there."""

    def __init__(self, physics: Knowing, residual: TwoLayers, seen: np.ndarray) -> None:
        super().__init__(physics, residual, seen)
        self.fused.S, self.fused.F = sum(physics.sizes.values()), physics.width_in
        self.C, self.extra, self.known = len(physics.model.controls), physics.extra, physics
        self.gains = nn.ModuleDict({name: Gain(len(LIMITS[name])) for name in physics.extra.gains})
        self.shift = nn.Parameter(torch.zeros(physics.sizes["shift"], dtype=torch.float64))
        for p in residual.parameters():
            p.requires_grad_(physics.extra.network)

    def start(self, logged: torch.Tensor, controls: torch.Tensor, past: Past | None = None) -> torch.Tensor:
        M, S, F = controls.shape[1], self.known.S, len(self.known.ship.features)
        sizes = (S, S, F * len(LAGS), 6 * len(ERRORS), 2)
        plain, adapted, memory, errors, current = controls[self.C :].split(sizes)
        z, water = (adapted, current) if self.extra.adapted else (plain, torch.zeros_like(current))
        parts = [memory[LAGS.index(lag) * F :][:F] for lag in self.extra.lags]
        parts += [errors] if self.extra.innovation else []
        psi, six = z[2], errors.reshape(len(ERRORS), 6, M)
        body = [torch.cat([turned(e[:2], psi), e[2:3], turned(e[3:5], psi), e[5:6]]) for e in six]
        moved = {
            name: torch.tensor(LIMITS[name], dtype=torch.float64)[:, None] * gain(torch.stack(body))
            for name, gain in self.gains.items()
        }
        if "current" in moved:
            added = turned(moved["current"], psi, back=True)
            water = water + added
            z = torch.cat([z[:3], z[3:5] - moved["current"], z[5:6], z[6:8] - added])
        if "start" in moved:
            beyond = turned(moved["start"][:2], psi, back=True)
            z = torch.cat([z[:3], z[3:6] + moved["start"], z[6:8] + beyond])
        parts += [water, *([self.residual.scale[:, None] * moved["force"]] if "force" in moved else [])]
        return torch.cat([z, *parts, 0.3 * self.shift[:, None].expand(-1, M)])

    def simulate(self, z: torch.Tensor, controls: torch.Tensor, h: float, method: str = "rk4") -> torch.Tensor:
        return super().simulate(z, controls[:, : self.C].contiguous(), h, method)

    def penalty(self) -> torch.Tensor:
        """Beside the network's own: squared shifts of the coefficients and squared gains."""
        shifts = (0.3 * self.shift).square().sum() * self.extra.kappa / 0.3
        gains = sum((p.square().sum() for p in self.gains.parameters()), torch.zeros((), dtype=torch.float64))
        own = super().penalty() if self.extra.network else torch.zeros((), dtype=torch.float64)
        return own + shifts + gains * self.extra.cost / 0.3


def build(extra: Extra, ship: Ship, scales: Scales, training: TrainSettings, seed: int) -> TrainableSystem:
    """An untrained one."""
    physics = Knowing(ship, extra)
    if not extra.symmetric:
        return Extended(physics, Residual(scales.feature, scales.output, training.width, seed), scales.features)
    own = Residual(scales.feature, scales.output, training.width // 2, seed)
    return Extended(physics, Mirrored(own, physics), scales.features)


def with_past(ship: Ship, pieces: Sequence[Piece], rms: np.ndarray | None, seconds: float = 30.0):  # type: ignore[no-untyped-def]
    """The pieces with what their past tells behind their inputs, and the rms of innovations (R, 4) used for scaling.

    Only rows before a window's start are read. rms: of other pieces; None: of these.
    """
    physics, simulator = Physics(ship), Simulator(ship)
    tables = [_errors(physics, p) for p in pieces]
    if rms is None:
        every = np.concatenate([t for _, t in tables], axis=2)
        pairs = [every[:, :2], every[:, 2:3], every[:, 3:5], every[:, 5:6]]
        rms = np.stack([np.sqrt((a**2).mean(axis=(1, 2))) for a in pairs], axis=1)
    result = []
    for piece, (start, errors) in zip(pieces, tables, strict=True):
        scaled = errors / rms[:, (0, 0, 1, 2, 2, 3)][:, :, None]
        for rows in ((0, 1), (2,), (3, 4), (5,)):
            long = np.sqrt((scaled[:, rows] ** 2).sum(axis=1, keepdims=True))
            scaled[:, rows] *= MOST / np.maximum(long, MOST)
        memory = _memory(physics, start, piece.grid.controls)
        adapted, current = _adapted(simulator, piece, start, seconds)
        flat = scaled.reshape(-1, scaled.shape[2])
        wide = np.vstack([piece.grid.controls.T, start, adapted, memory, flat, current]).T
        result.append(replace(piece, grid=replace(piece.grid, controls=wide)))
    return result, rms


def _errors(physics: Physics, piece: Piece) -> tuple[np.ndarray, np.ndarray]:
    """Start states (S, N) of the rows of a piece and its innovations (R, 6, N), earth-fixed; 0 where there is none."""
    states, controls = np.nan_to_num(piece.grid.states[:-1]).T, piece.grid.controls.T
    start = physics.start(torch.as_tensor(states), torch.as_tensor(controls)).numpy()
    N, found = states.shape[1], {}
    for seconds in {length for length, _ in ERRORS}:
        error = np.zeros((6, N))
        if seconds < N:
            z = torch.as_tensor(np.ascontiguousarray(start[:, : N - seconds]))
            for k in range(seconds):
                held = torch.as_tensor(np.ascontiguousarray(controls[:, k : k + N - seconds]))
                z = TrainableSystem.step(_Rates(physics), z, held, 1.0)
            beyond = states[:, seconds:] - physics.columns(z).numpy()
            psi = torch.as_tensor(states[2, seconds:])
            beyond[3:5] = turned(torch.as_tensor(beyond[3:5]), psi, back=True).numpy()
            ok = np.isfinite(piece.grid.states[:-1]).all(axis=1)
            error[:, seconds:] = np.where(ok[seconds:] & ok[: N - seconds], beyond, 0.0)
        found[seconds] = error
    late = []
    for seconds, ago in ERRORS:
        late.append(np.hstack([np.zeros((6, min(ago, N))), found[seconds][:, : max(0, N - ago)]]))
    return start, np.array(late)


class _Rates(TrainableSystem):
    """The ship alone."""

    def __init__(self, physics: Physics) -> None:
        super().__init__()
        self.physics = physics

    def rates(self, z: torch.Tensor, controls: torch.Tensor) -> torch.Tensor:
        return self.physics.rates(z, controls)


def _memory(physics: Physics, start: np.ndarray, controls: np.ndarray) -> np.ndarray:
    """Features behind LAGS along the measured rows, (lags F, N), settled in the first row."""
    held = np.ascontiguousarray(controls.T)
    seen = physics.features(torch.as_tensor(start), torch.as_tensor(held)).numpy()
    result = []
    for lag in LAGS:
        slow = seen.copy()
        for k in range(1, seen.shape[1]):
            slow[:, k] = slow[:, k - 1] + (seen[:, k - 1] - slow[:, k - 1]) * (1 - np.exp(-1 / lag))
        result.append(slow)
    return np.vstack(result)


def _adapted(simulator: Simulator, piece: Piece, start: np.ndarray, seconds: float) -> tuple[np.ndarray, np.ndarray]:
    """Start states (S, N) relative to the current (2, N) of ``fitting.prediction.adaptation``; known in every
    EVERY-th row."""
    grid = piece.grid
    good = np.isfinite(grid.states).all(axis=1)
    held = np.vstack([grid.controls, grid.controls[-1:]])
    record = Record(grid.t, np.nan_to_num(grid.states), held, good, True)
    rows = range(0, len(grid.controls), EVERY)
    windows = [Stretch(record, k, k + 1) for k in rows]
    water, offset = adapt(simulator, windows, Adaptation.of(simulator.ship, seconds))
    states = rollout(simulator, Stretches.of(windows), water, offset)[1][0]
    beginning, current = start.copy(), np.zeros((2, start.shape[1]))
    beginning[:, rows], current[:, rows] = states, water.velocity
    return beginning, current

"""Instruments that may differ between campaigns, put beside a calibration: its problem with constants of campaigns.

The calibration stays where it is; what is added has its neutral value, so that the windows' cost is the same, and its
derivatives with respect to the new constants say what they would change.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from cases.io.campaigns import Campaigns
from cases.shipfiles.effects import parameters
from fitting.calibration import Calibration
from fitting.nlp.fisher_information import Information, information
from fitting.nlp.prior import Prior
from fitting.nlp.problem import Problem
from fitting.nlp.run_constants import ByCampaign
from mmg.effects import EFFECTS
from mmg.errors import UserError
from mmg.ship import Ship

USUAL = {
    "gyro lag": ("gyro.T",),
    "gyro scale": ("gyro.share",),
    "log_scale": ("log_scale.share",),
}
"""What may differ by campaign: symbols of each instrument that get one width together. Of others (lag of u and v,
antenna, heading, wind sensor, fouling, draught, rudder offset) none was kept on any data set."""


@dataclass(frozen=True)
class Instrument:
    """One instrument: its name and the symbols of its constants."""

    name: str
    symbols: tuple[str, ...]


def candidates(ship: Ship, wanted: Sequence[str] = ()) -> list[Instrument]:
    """What may differ between campaigns of trials of ``ship``: all instruments, or those ``wanted``.

    Left out is what needs a part that the ship lacks, and what she holds at a value of its own. Raises UserError for an
    unknown name.
    """
    rows = {
        name: symbols for name, symbols in USUAL.items() if not wanted or {name, symbols[0].split(".")[0]} & {*wanted}
    }
    for name in wanted:
        if not any(name in (key, symbols[0].split(".")[0]) for key, symbols in USUAL.items()):
            known = ", ".join(dict.fromkeys(s[0].split(".")[0] for s in USUAL.values()))
            why = "is gone: it no longer differs by campaign" if name in EFFECTS else "unknown"
            raise UserError(f"--per-campaign {name}: {why}; choose among {known}, or none")
    return [Instrument(name, symbols) for name, symbols in rows.items() if _possible(ship, symbols)]


def _possible(ship: Ship, symbols: Sequence[str]) -> bool:
    """Whether the constants ``symbols`` can have an influence and are nowhere held."""
    name = symbols[0].split(".")[0]
    if any(role not in ship.components for role in EFFECTS[name].needs):
        return False
    return not any(s in ship.coefficients and ship.coefficients[s].fixed and name in ship.effects for s in symbols)


def with_constants(ship: Ship, symbols: Sequence[str], values: Sequence[float], widths: Sequence[float]) -> Ship:
    """The ``ship`` with the effects of the constants ``symbols``, which are fixed at ``values`` with the standard
    deviations ``widths``; other parameters of effects that it did not have are held at their neutral values."""
    for name in dict.fromkeys(s.split(".")[0] for s in symbols):
        if name not in ship.effects:
            ship = ship.with_effect(name)
            ship = ship.fixing([s for s in ship.symbols if s.startswith(f"{name}.")])
    rows = {}
    for symbol, value, width in zip(symbols, values, widths, strict=True):
        rows[symbol] = ship.coefficients[symbol].with_(value=float(value), std=float(width), fixed=True)
    return ship.with_coefficients(rows)


@dataclass(frozen=True)
class Beside:
    """A calibration with constants of campaigns beside it.

    problem: of all; info: of its windows where the calibration ended, the constants at zero; candidates: whose
    constants they are; unit: (Q,) scale, centre: (Q,) value at zero, of each symbol; constants: (K,) columns; block,
    symbol: (K,) number of the candidate and of the symbol of each; nodes: (B, S) states where the calibration ended;
    before: effects that it had.
    """

    problem: Problem
    info: Information
    candidates: tuple[Instrument, ...]
    symbols: tuple[str, ...]
    centre: np.ndarray
    unit: np.ndarray
    constants: np.ndarray
    block: np.ndarray
    symbol: np.ndarray
    nodes: np.ndarray
    before: frozenset[str]

    def nodes_of(self, symbols: Sequence[str]) -> np.ndarray:
        """States (B, S) of a model that has of all candidates' effects only those of the constants ``symbols``."""
        added = {s.split(".")[0] for s in self.symbols} - {s.split(".")[0] for s in symbols} - self.before
        names = self.problem.kernels.model.states
        return self.nodes[:, [i for i, name in enumerate(names) if name.split(".")[0] not in added]]

    @classmethod
    def of(cls, found: Calibration, campaigns: Campaigns, chosen: Sequence[Instrument]) -> Beside:
        """The constants of the ``chosen`` candidates beside the calibration ``found`` of trials of ``campaigns``."""
        ship = found.problem.ship
        symbols = tuple(s for c in chosen for s in c.symbols)
        known = {p_symbol: found.ship.coefficients[p_symbol].value for p_symbol in found.prior.symbols}
        rows = {f"{name}.{p.symbol}": p for name in {s.split(".")[0] for s in symbols} for p in parameters(ship, name)}
        centre = np.array([known.get(s, rows[s].neutral) for s in symbols])
        unit = np.array([abs(rows[s].typical) for s in symbols])
        wider = with_constants(ship, symbols, centre.tolist(), unit.tolist())
        prior = Prior.of(wider, symbols, campaigns.names, campaigns.number)
        old = found.problem
        segments = replace(old.segments).by_run(campaigns.number)
        points = old.captive.points if old.captive else None
        problem = Problem.of(wider, prior, segments, old.sigma, old.loss, points, compiled=False)
        p = np.zeros(problem.P)
        place = {s: i for i, s in enumerate(found.prior.symbols)}
        p[: prior.shared] = [found.p[place[s]] for s in prior.symbols[: prior.shared]]
        nodes = problem.measured_nodes.copy()
        before = old.split(found.solution.x)[0]
        names = {s: i for i, s in enumerate(problem.kernels.model.states)}
        nodes[:, [names[s] for s in old.kernels.model.states]] = before
        info = information(problem, problem.join(nodes, np.clip(p, *problem.p_bounds())))
        number = np.tile(np.arange(len(symbols)), prior.runs)
        of_symbol = np.repeat(np.arange(len(chosen)), [len(c.symbols) for c in chosen])
        return cls(
            problem, info, tuple(chosen), symbols, centre, unit, np.arange(prior.shared, problem.P),
            of_symbol[number], number, nodes, frozenset(ship.effects),
        )  # fmt: skip


def constants_of(beside: Beside, kept: Sequence[int], campaigns: Campaigns) -> ByCampaign:
    """The constants of the candidates number ``kept`` of ``beside``, by campaign of ``campaigns``."""
    symbols = tuple(s for i in kept for s in beside.candidates[i].symbols)
    return ByCampaign(symbols, campaigns.names, campaigns.number)

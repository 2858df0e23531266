"""Cases: what they hold, dealt from the seed, and one batch of them from hands to logged columns."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from benchmarks.blind.generator import world as worlds
from benchmarks.blind.generator.controls import SETS, Helm, Orders, begin, orders
from benchmarks.blind.generator.effect import LEVELS, Drawn, Effect, History
from benchmarks.blind.generator.foreign import STRANGERS
from benchmarks.blind.generator.library import DRAUGHT, LIBRARY, SIDES
from benchmarks.blind.generator.plant import Array, Plant, Signals, plant_of, step
from benchmarks.blind.generator.world import WORLDS, World

KINDS = ("null", "library", "strangers", "pair")
DECOYS = 0.25
"""Share of the cases with a site file that explains nothing."""


Hand = tuple[tuple[Effect, str], ...]
"""What one case holds: effects with their strengths."""


def _cycled(pool: list[Any], count: int, rng: np.random.Generator) -> list[Any]:
    """``count`` items of the pool, each as often as any other but one, in random order."""
    out: list[Any] = []
    while len(out) < count:
        out += [pool[i] for i in rng.permutation(len(pool))]
    return out[:count]


def deal(kind: str, count: int, rng: np.random.Generator, without: Sequence[str] = ()) -> list[Hand]:
    """The hands of ``count`` cases; without: names of effects that the ship cannot have."""
    library, strangers = ([e for e in pool if e.name not in without] for pool in (LIBRARY, STRANGERS))
    if kind == "null":
        return [()] * count
    if kind == "library":
        # every block of twenty holds each effect once, and three blocks each of its strengths once
        first = {effect.name: int(rng.integers(3)) for effect in library}
        blocks = [_cycled(library, len(library), rng) for _ in range(-(-count // len(library)))]
        dealt = [(effect, LEVELS[(first[effect.name] + b) % 3]) for b, block in enumerate(blocks) for effect in block]
        return [(one,) for one in dealt[:count]]
    if kind == "strangers":
        pool = [(effect, level) for effect in strangers for level in LEVELS[1:]]
        return [(one,) for one in _cycled(pool, count, rng)]
    pairs = [(a, b) for i, a in enumerate(library) for b in library[i + 1 :]]
    return [tuple((effect, "medium") for effect in pair) for pair in _cycled(pairs, count, rng)]


def decoy(rng: np.random.Generator) -> dict[str, dict[str, Any]]:
    """A site file of a place whose bank, shelf or depth plays no part."""
    axis, way, greater, less = SIDES[int(rng.integers(4))]
    which = rng.choice(("bank", "shelf", "water"))
    if which == "bank":
        return {"bank": {axis: round(way * rng.uniform(8.0, 15.0), 1), "water_side": less}}
    if which == "shelf":
        return {"shelf": {axis: round(way * rng.uniform(-4.0, 4.0), 1), "shallow_side": greater}}
    return {"water": {"depth": round(float(rng.uniform(2.0, 4.0)), 2)}}


def site_of(drawn: list[tuple[Effect, Drawn]], rng: np.random.Generator) -> dict[str, dict[str, Any]]:
    """Tables of the site file of a case; perhaps a decoy where no effect has one; {} for no file."""
    site = {name: table for _, draw in drawn for name, table in draw.site.items()}
    hidden = decoy(rng) if rng.uniform() < DECOYS else {}
    return site or hidden


@dataclass
class Case:
    """One case before it is run: what it holds and all that is random about it; of a wide world its own one."""

    hand: Hand
    drawn: list[tuple[Effect, Drawn]]
    coefficients: dict[str, float]
    site: dict[str, dict[str, Any]]
    orders: Orders
    start: Array  # (6, B)
    wind: tuple[Array, Array]  # speed, direction (K, B)
    force: Array  # (K, 3, B)
    noise: Array  # (R, 6, B)
    gyro: float
    low_pass: float  # time constant of the filter of u and v [s], 0: none
    gusts: Array  # (K, B), factors of the logged wind speed
    kinds: tuple[str, ...]
    training: int
    world: World

    @property
    def twin(self) -> Case:
        """The same with nothing hidden: what a complete model would have to explain."""
        return replace(self, hand=(), drawn=[])

    @classmethod
    def prepared(cls, hand: Hand, seed: np.random.SeedSequence, world: World = WORLDS["pond"]) -> Case:
        """A case in a ``world``, from its own seed."""
        rng = np.random.default_rng(seed)
        train, test = map(tuple, SETS[world.runs])
        if world.wide:
            world, conditions = worlds.own_world(world, rng)
            train, test = worlds.own_runs((train, test), conditions, rng)
        rows, dt = world.rows, world.step
        kinds, runs = (*train, *test), len(train) + len(test)
        drawn = [(effect, effect.draw(strength, rng, runs)) for effect, strength in hand]
        for effect, one in drawn:
            if effect.name in world.sizes:
                one.key["size"] *= world.sizes[effect.name]
                one.inside["size"] *= world.sizes[effect.name]
        nominal = worlds.scaled_ship(world)[1]
        coefficients, site = worlds.true_coefficients(nominal, rng, world.drawn, world.spread), site_of(drawn, rng)
        if "water" in site:
            site["water"]["depth"] *= world.draught / DRAUGHT
        bank = next((one.bank for _, one in drawn if one.bank is not None), None)
        sides = rng.choice((-1.0, 1.0), runs)
        given = orders(kinds, rows, dt, sides, rng)
        start = begin(kinds, bank, sides, given.n[0], rng)
        force = worlds.random_force(world, runs, rng)
        wind = worlds.gusty_wind(world, runs, rng)
        noise = worlds.sensor_errors(world, (rows - 1) // world.every + 1, runs, rng)
        gyro = world.gyro * float(rng.uniform(-1, 1)) if world.gyro else 0.0
        gusts = worlds.unlogged_gusts(world, runs, rng)
        low_pass = float(rng.uniform(*world.low_pass)) if world.low_pass[1] else 0.0
        random = (start, wind, force, noise, gyro, low_pass, gusts)
        return cls(hand, drawn, coefficients, site, given, *random, kinds, len(train), world)


@dataclass
class Runs:
    """The records of a batch that has been run: R rows, B runs of all cases side by side.

    columns: logged x, y, psi, u, v, r (R, 6, B); n, delta, speed, direction, port, bow: logged actuators and wind
    (R, B).
    """

    plant: Plant
    columns: Array
    n: Array
    delta: Array
    speed: Array
    direction: Array
    port: Array
    bow: Array


def measured(plant: Plant, states: Array, rows: Array) -> Array:
    """Columns (R, 6, B) as the instruments give them, without noise."""
    logged = states[:, :6]
    if plant.low_pass is not None:
        logged, share = logged.copy(), -np.expm1(-plant.dt / plant.low_pass)
        for k in range(1, len(logged)):
            logged[k, 3:5] = logged[k - 1, 3:5] + share * (states[k, 3:5] - logged[k - 1, 3:5])
    history = History(logged, plant.dt)
    y = history.states[rows]
    for effect, e in plant.effects:
        y = effect.columns(y, history, rows, e)
    return y


def closed_loop(plant: Plant, start: Array, signals: Signals, helm: Helm) -> Array:
    """States (K, 6 + S, B) under the helm; fills the real n and delta of the signals."""
    rows, dt = len(helm.n), plant.dt
    states = np.empty((rows, 6 + plant.states, plant.runs))
    states[0] = np.vstack([start, np.zeros((plant.states, plant.runs))])
    gears = [Gear.of(plant, helm.n, helm.delta, signals.n, signals.delta)]
    if plant.twin:
        gears.append(Gear.of(plant, helm.n, helm.port, np.empty_like(helm.n), signals.port))
    for gear in gears:
        gear.follow(plant, 0)
    signals.bow[0] = helm.bow[0]
    zero = np.zeros(plant.runs)
    for k in range(rows - 1):
        helm.advance(k, states[k, 2])
        for gear in gears:
            gear.follow(plant, k + 1)
        signals.bow[k + 1] = helm.bow[k + 1]
        states[k + 1] = step(plant, states[k], signals, k, zero + k * dt)
    return states


@dataclass
class Gear:
    """Shaft and one rudder, from the handed to the real n and delta (K, B), through what the effects remember."""

    n: Array
    delta: Array
    real: tuple[Array, Array]
    between: list[tuple[Array, Array, dict]]

    @classmethod
    def of(cls, plant: Plant, n: Array, delta: Array, real_n: Array, real_delta: Array) -> Gear:
        """The gear that fills ``real_n`` and ``real_delta`` from ``n`` and ``delta``."""
        between: list[tuple[Array, Array, dict]] = [(np.empty_like(n), np.empty_like(n), {}) for _ in plant.effects]
        return cls(n, delta, (real_n, real_delta), between)

    def follow(self, plant: Plant, k: int) -> None:
        """Fills row k, rows up to k being handed."""
        n, delta = self.n, self.delta
        for (effect, e), (out_n, out_delta, memory) in zip(plant.effects, self.between, strict=True):
            out_n[k], out_delta[k] = effect.actuators(n, delta, k, plant.dt, e, memory)
            n, delta = out_n, out_delta
        self.real[0][k], self.real[1][k] = n[k], delta[k]


def run(cases: list[Case]) -> Runs:
    """Runs a batch of cases of the same world side by side."""
    world = cases[0].world
    particulars, _ = worlds.scaled_ship(world)
    runs = len(cases[0].kinds)
    low_pass = np.repeat([c.low_pass for c in cases], runs) if world.low_pass[1] else None
    plant = plant_of(particulars, [c.coefficients for c in cases], [c.drawn for c in cases], runs, world, low_pass)
    start = np.concatenate([c.start for c in cases], axis=1)
    speed, direction = (np.concatenate([c.wind[i] for c in cases], axis=1) for i in range(2))
    air = speed * np.concatenate([c.gusts for c in cases], axis=1)
    north, east = -air * np.cos(direction), -air * np.sin(direction)
    force = np.concatenate([c.force for c in cases], axis=2)
    n, delta, port, bow = np.zeros((4, world.rows, plant.runs))
    signals = Signals(n, delta, north, east, force, port, bow)
    helm = Helm(Orders.joined([c.orders for c in cases]), start[2], world.step)
    states = closed_loop(plant, start, signals, helm)
    rows = np.arange(0, world.rows, world.every)
    columns = measured(plant, states, rows)
    columns[:, 5] *= 1 + np.repeat([c.gyro for c in cases], runs)
    columns += np.concatenate([c.noise for c in cases], axis=2)
    logged = (helm.n, helm.delta, speed, direction, helm.port, helm.bow)
    return Runs(plant, columns, *(a[rows] for a in logged))

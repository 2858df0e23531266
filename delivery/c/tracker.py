"""``mmg export --format c-tracker``: the filter of ``mmg_ident.Tracker`` in C, on the C code of the ship.

The random states of the filter are states of the delivered model whose rates are zero, so that the ship's C code gives
all derivatives that a linearisation needs. The filter makes them fade.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, fields, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import casadi as ca
import numpy as np

from delivery.c.source import TEMPLATES, approach, comment, header_c, number, source_c
from delivery.product import Product, ProductCoefficient, filled
from diagnosis.estimation.linearisation import FIRST, SETTLED
from diagnosis.estimation.random_states import DIFFERENCE, LONGEST, Noise, RandomStates, deviations, disturbed
from mmg.model import Model, assemble
from mmg.motion.froude import state_scale, time_scale
from mmg.ship import Ship


@dataclass(frozen=True, eq=False)
class TrackedShip(Product):
    """A product whose model has random states after its own.

    plain: the product as it was given. noise: sizes of the filter; random: its random states.
    """

    plain: Product
    noise: Noise
    random: RandomStates

    @classmethod
    def of(cls, product: Product, coefficients: Iterable[str] | Mapping[str, float] = ()) -> TrackedShip:
        """The tracked form of a ``product``. coefficients: symbols that are estimated along, or symbol -> standard
        deviation. Raises UserError as ``deviations`` does."""
        stds, ship = deviations(coefficients, product.ship), disturbed(product.ship)
        noise = Noise.of(product.random_force, ship)
        given = {f.name: getattr(product, f.name) for f in fields(Product)}
        # a name of its own: ship and tracker can be in one program
        given |= {"ship": ship, "identifier": f"{product.identifier}_tracker"}
        return cls(**given, plain=product, noise=noise, random=RandomStates.of(ship, noise, stds))

    @cached_property
    def model(self) -> Model:
        return self.model_of(self.ship)

    def model_of(self, ship: Ship) -> Model:
        """The model of ``ship``, this one or its form without network, whose last states are the random ones."""
        model, random = assemble(ship), self.random.names
        S, symbols = len(model.states), tuple(s for s in model.symbols if s not in random)
        z, six, c = (ca.SX.sym("z", n) for n in (S + len(random), 6, len(model.controls)))
        theta, first = ca.SX.sym("theta", len(symbols)), ca.DM(self.means)

        def all_coefficients(values: ca.SX | ca.DM) -> ca.SX:
            by_symbol = dict(zip(random, ca.vertsplit(values), strict=True))
            by_symbol |= dict(zip(symbols, ca.vertsplit(theta), strict=True))
            return ca.vertcat(*[by_symbol[s] for s in model.symbols])

        def function(name: str, *given: ca.SX, after: Any = None) -> ca.Function:
            values = first if name == "initial" else z[S:]  # memory settles before a random state has moved
            result = getattr(model, name)(*[a[:S] if a is z else a for a in given], all_coefficients(values))
            result = result if after is None else ca.vertcat(result, after)
            return ca.Function(name, [*given, theta], [result], {"cse": True})

        functions: dict[str, Any] = {name: function(name, z, c) for name in ("forces", "features")}
        # zero rates, as states: derivatives by them are then those by states, and the filter lets them fade itself
        functions["rates"] = function("rates", z, c, after=ca.SX.zeros(len(random)))
        functions["initial"] = function("initial", six, c, after=first)
        functions["columns"] = function("columns", z)
        return replace(model, symbols=symbols, states=(*model.states, *random), **functions)

    @property
    def means(self) -> np.ndarray:
        """Values (K,) of the random states before the first sample, to which they fade."""
        return np.array([self.ship.coefficients[s].value for s in self.random.names])

    @property
    def coefficients(self) -> tuple[ProductCoefficient, ...]:
        return tuple(c for c in super().coefficients if c.symbol not in self.random.names)


def tracker_words(ship: TrackedShip) -> dict[str, Any]:
    """What the templates of the filter take of a ``ship``."""
    scales, K = state_scale(ship.ship.particulars["L"]), len(ship.random.names)
    memories = [m if np.isfinite(m) else 0.0 for m in ship.random.memories]  # 0 in C: it does not fade
    tables: dict[str, Any] = {"sizes": ship.random.sizes, "memories": memories, "sensors": ship.noise.sensors}
    tables |= {"means": ship.means, "unknown": FIRST * scales, "settled": SETTLED * ship.model.sizes}
    constants = {name: (len(values), ", ".join(number(float(x)) for x in values)) for name, values in tables.items()}
    return {
        "K": K, "X": len(ship.model.states) - K, "M": 6 + K, "CONSTANTS": constants, "INTERVAL": ship.noise.interval,
        "LONGEST": LONGEST * time_scale(ship.ship.particulars["L"]), "DIFFERENCE": DIFFERENCE,
        "TIME": ship.model.controls.index("time"),
    }  # fmt: skip


def tracker_files(ship: TrackedShip) -> dict[str, str]:
    """Text of header and source of the filter of a ``ship``, by file name. Raises UserError as ``source_c`` does."""
    words, p = tracker_words(ship), ship.identifier
    text, kept = source_c(ship, filled(TEMPLATES / "tracker.c", ship, **words))
    return {f"{p}.h": header_c(ship, kept, filled(TEMPLATES / "tracker.h", ship, **words)), f"{p}.c": text}


def write_c_tracker(product: Product, target: Path, coefficients: Iterable[str] | Mapping[str, float] = ()) -> None:
    """Write the filter of ``product`` in C into the folder ``target``. coefficients: as of ``TrackedShip.of``. Raises
    UserError for these, and where C cannot hold the ship."""
    ship = TrackedShip.of(product, coefficients)
    speed, inputs = approach(product)
    build = f"Compile: cc -std=c99 -O2 {ship.identifier}.c example.c -lm -o example"
    settings = "".join(f"  inputs[{ship.identifier}_input_{name}] = {x!r};\n" for name, x in inputs.items())
    files = tracker_files(ship) | {
        "example.c": filled(
            TEMPLATES / "tracker_example.c", ship, SPEED=speed, SETTINGS=settings,
            ABOUT=comment(["How to use the filter: a sample a second, and what is expected a minute later.", build]),
        ),
        "README.md": filled(TEMPLATES / "tracker.md", ship, NAMES=", ".join(ship.random.names)),
    }  # fmt: skip
    for name, text in files.items():
        (target / name).write_text(text, encoding="utf-8", newline="\n")

"""A ship is data: particulars, the names of its force models, and their coefficients."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from importlib import import_module
from types import SimpleNamespace
from typing import Any

import numpy as np

from mmg.components.catalogue import actuators, coefficient_table, module, own_models, required_particulars
from mmg.components.coefficients import Coefficient
from mmg.components.own import Own
from mmg.effects import EFFECTS, effect
from mmg.errors import Conflict, Missing, UnknownName, by_name, check_name, finite, refusing, unknown
from mmg.messages import Message, html_table
from mmg.motion.flow import INPUTS
from mmg.network import Network, features_of

# Inputs of every right-hand side after the actuators: velocity of the air over ground, earth frame [m/s].
AIR = ("wind_north", "wind_east")


def _in_words(models: Mapping[str, str]) -> str:
    return ", ".join(f"{role} {name}" for role, name in models.items())


@dataclass(frozen=True)
class CalibrationMark:
    """Which calibration a ship is of.

    name: of the calibration, plain words; date: ISO; data: hash over the trials, "" where it is not known; start: name
    of the ship or calibration that it began from.
    """

    name: str
    date: str = ""
    data: str = ""
    start: str = ""

    def __post_init__(self) -> None:
        check_name(self.name, "calibration")

    @property
    def words(self) -> str:
        """All of it in a line: "first, calibrated 2026-11-23, data 1a2b3c4d, from esso_osaka_3m"."""
        origin = (("calibrated ", self.date), ("data ", self.data[:8]), ("from ", self.start))
        return ", ".join([self.name or "unnamed", *(f"{word}{value}" for word, value in origin if value)])


@refusing
@dataclass(frozen=True)
class Ship:
    """A ship, before or after calibration.

    name: short name, as in ``mmg ships``; UserError unless it is plain words (``mmg.errors``).
    particulars: symbol -> value in SI (L, B, d, m, x_G, rho, D_P, A_R, ...); see the force models.
    components: role ("hull", "propeller", "rudder", "wind") -> name of the force model.
    coefficients: symbol -> Coefficient, in the order of the models' tables.
    description, reference: words and citations that travel with the ship file.
    effects: names of effects (mmg.effects) in the order in which they enter; their parameters are coefficients
    ``effect.parameter``.
    network: what adds accelerations to those of the forces, if anything: a hybrid ship. UserError if its inputs are
    not those of the ship. mark: of the calibration, None for a ship that was not calibrated here.
    campaigns: name of a campaign -> symbol -> value of the coefficients that its trials have for themselves; the
    coefficients hold the mean of all. sources: particular -> where it is from, of those that nobody stated.
    """

    name: str
    particulars: Mapping[str, float]
    components: Mapping[str, str]
    coefficients: Mapping[str, Coefficient]
    description: str = ""
    reference: str = ""
    notices: tuple[str, ...] = field(default=())
    effects: tuple[str, ...] = field(default=())
    network: Network | None = None
    mark: CalibrationMark | None = None
    campaigns: Mapping[str, Mapping[str, float]] = field(default_factory=dict)
    sources: Mapping[str, str] = field(default_factory=dict)

    def __post_init__(self) -> None:
        check_name(self.name, "ship")
        if self.network is not None:
            self.network.check(self.name, self.actuators)

    def __getstate__(self) -> dict[str, Any]:
        """Without ``rhs``, which is made of the ship and belongs to this process; with the models that a user
        registered, which the process that reads it may not know."""
        return {name: value for name, value in vars(self).items() if name != "rhs"} | {"own": self.own}

    def __setstate__(self, state: dict[str, Any]) -> None:
        vars(self).update({name: value for name, value in state.items() if name != "own"})

    @property
    def own(self) -> tuple[Own, ...]:
        """Her force models and effects that a user registered."""
        effects = (EFFECTS[name] for name in self.effects if name in EFFECTS)
        return (*own_models(self.components), *(e for e in effects if isinstance(e, Own)))

    def to_pandas(self) -> Any:
        """The coefficients as a DataFrame: a row per symbol, the attributes of ``Coefficient`` as columns."""
        import pandas as pd

        return pd.DataFrame([vars(c) for c in self.coefficients.values()]).set_index("symbol")

    def __repr__(self) -> str:
        parts = [_in_words(self.components)]
        parts += [f"effects {', '.join(self.effects)}"] if self.effects else []
        parts += ["a network"] if self.network is not None else []
        count = f"{len(self.coefficients)} coefficients, {len(self.free)} free"
        return f"<Ship {self.title}: L {self.particulars['L']:g} m, {', '.join(parts)}; {count}>"

    def _repr_html_(self) -> str:
        caption = f"{self.name}, L = {self.particulars['L']:g} m: {_in_words(self.components)}"
        rows = [
            (c.symbol, c.value, c.std, c.unit or c.prime, "fixed" if c.fixed else "", c.source)
            for c in self.coefficients.values()
        ]
        return html_table(caption, ("coefficient", "value", "std", "unit", "", "source"), rows)

    @property
    def title(self) -> str:
        """What outputs call her: her calibration with its date and data, without one her name."""
        return self.mark.words if self.mark else self.name

    @property
    def called(self) -> str:
        """The name of her calibration, without one her own."""
        return self.mark.name if self.mark and self.mark.name else self.name

    @property
    def symbols(self) -> tuple[str, ...]:
        """All coefficient symbols in their fixed order."""
        return tuple(self.coefficients)

    @cached_property
    def actuators(self) -> tuple[str, ...]:
        """Actuators that its force models listen to: names of mmg.motion.flow.INPUTS, in that order."""
        needed = {*actuators(self.components, self.particulars)}
        if self.monomials:  # these belong to the ship, not to a model with a table of its own
            from mmg.components.expansion.words import parse_monomial  # late: few ships are polynomials

            needed = needed.union(*(parse_monomial(text).inputs for text in self.monomials.values()))
        return tuple(name for name in INPUTS if name in needed)

    @property
    def monomials(self) -> dict[str, str]:
        """What each term of a generated polynomial multiplies, by symbol; empty for a ship without one."""
        return {symbol: c.monomial for symbol, c in self.coefficients.items() if c.monomial}

    @property
    def inputs(self) -> tuple[str, ...]:
        """Inputs of the right-hand side: actuators, AIR, and the time [s] where an effect changes with it."""
        timed = any(effect(name).needs_time for name in self.effects)
        return (*self.actuators, *AIR, *(("time",) if timed else ()))

    @property
    def features(self) -> tuple[str, ...]:
        """What a network on this ship may see: velocities through the water, actuators, air relative to the hull."""
        return features_of(self.actuators)

    @property
    def feels_wind(self) -> bool:
        """Whether the wind exerts a force on her: by a model of it, or by what her network sees."""
        modelled = "wind" in self.components or "wind_force" in self.effects
        return modelled or (self.network is not None and self.network.feels_air)

    def with_network(self, network: Network | None) -> Ship:
        """A copy with this network, or with none."""
        return replace(self, network=network)

    def without_network(self) -> Ship:
        """A copy that is the forces alone."""
        return self.with_network(None)

    @property
    def members(self) -> list[Ship]:
        """Each network of the ensemble alone, as a ship: what they differ by, trials leave open (Wakita et al. 2025).
        Raises UserError where she has no network."""
        if self.network is None:
            raise Missing(f"{self.name} has no network, so there is no ensemble: train one with mmg train --seeds 5")
        return [self.with_network(replace(self.network, members=(member,))) for member in self.network.members]

    @property
    def namespace(self) -> SimpleNamespace:
        """The particulars by attribute."""
        return SimpleNamespace(**self.particulars)

    def parameters_of(self, name: str, values: Mapping[str, Any] | None = None) -> SimpleNamespace:
        """Parameters of one of its effects by attribute, out of ``values`` (default: the ship's own)."""
        source = {s: c.value for s, c in self.coefficients.items()} if values is None else values
        prefix = f"{name}."
        return SimpleNamespace(**{s[len(prefix) :]: source[s] for s in self.coefficients if s.startswith(prefix)})

    def with_effect(self, name: str, values: Mapping[str, float] | None = None, **named: float) -> Ship:
        """A copy with an effect, its parameters at their neutral values or at ``values`` (symbol -> value), also by
        keyword: with_effect("current", x=0.1). Raises UserError for an effect that is unknown, a parameter that it has
        not, and a value that is no finite number."""
        p, chosen = self.namespace, self._chosen(values, named)
        if name not in [*EFFECTS]:  # a list: what is no name may have no hash
            raise UnknownName(unknown("effect", name, EFFECTS))
        rows = {}
        for parameter in effect(name).parameters(p, dict(self.components)):
            row = self.coefficients.get(f"{name}.{parameter.symbol}") or parameter.coefficient(name)
            if parameter.symbol in chosen:
                row = row.with_(value=chosen.pop(parameter.symbol), source="given with the effect")
            rows[row.symbol] = row
        if chosen:
            raise UnknownName(f"{name}: has no parameter {next(iter(chosen))!r}")
        order = tuple(e for e in EFFECTS if e in (*self.effects, name))  # one order, whatever was switched on first
        return replace(self, effects=order, coefficients={**self.coefficients, **rows})

    def without_effect(self, name: str) -> Ship:
        """A copy without one of its effects."""
        rows = {s: c for s, c in self.coefficients.items() if not s.startswith(f"{name}.")}
        # values by campaign go along: a ship file that names what the ship lacks cannot be read
        own = {day: {s: x for s, x in values.items() if s in rows} for day, values in self.campaigns.items()}
        campaigns = {day: values for day, values in own.items() if values}
        effects = tuple(e for e in self.effects if e != name)
        return replace(self, effects=effects, coefficients=rows, campaigns=campaigns)

    def without(self, *names: str) -> Ship:
        """A copy without the effects, or the force models by their role ("wind", "rudder", ...), of these ``names``,
        with a notice on particulars that are unused then. Raises UserError for a name that she does not have, and for
        one that another part of her model needs."""
        ship = self
        for name in names:
            ship = ship.without_effect(name) if name in ship.effects else ship._without_component(name)
        return ship

    def with_models(self, **models: str) -> Ship:
        """A copy with other force models, by role: with_models(hull="my_hull"). Coefficients that both have stay, and
        new ones are at the defaults of the models. Raises UserError for an unknown role or model, and where she lacks
        a particular that it needs."""
        components = {**self.components, **models}
        for role, name in models.items():
            module(role, name)
        lacking = [key for key in required_particulars(components) if key not in self.particulars]
        if lacking:
            raise Missing(f"{self.name}: has no particular {', '.join(lacking)}, needed by {_in_words(models)}")
        return self._with_components(components)

    def _with_components(self, components: dict[str, str], notices: tuple[str, ...] = ()) -> Ship:
        """A copy with just these models, their coefficients and those of her effects."""
        rows = coefficient_table(components, self.particulars)
        rows |= {s: c for s, c in self.coefficients.items() if s.partition(".")[0] in self.effects}
        rows |= {s: self.coefficients[s] for s in self.monomials if "expansion" in components}
        coefficients = {s: self.coefficients.get(s, c) for s, c in rows.items()}
        # the network last: it is checked against the actuators of the new models
        bare = replace(self, network=None, components=components, coefficients=coefficients, notices=notices)
        return bare.with_network(self.network)

    def _without_component(self, role: str) -> Ship:
        if role not in self.components:
            names = ", ".join((*self.components, *self.effects))
            raise UnknownName(f"--without {role}: {self.name} has no such component; it has {names}")
        # a hull or a polynomial must stay: without both the ship has no resistance
        alone = role in ("hull", "expansion") and not {"hull", "expansion"} & {*self.components} - {role}
        if role == "hull" or alone or (role == "propeller" and "rudder" in self.components):
            raise Conflict(f"--without {role}: the rest of the model needs it")
        needing = [name for name in self.effects if role in EFFECTS[name].needs]
        if needing:
            words = f"effect {needing[0]} needs a {role} model, which {self.name} would lack"
            raise Conflict(f"--without {role}: {words}")
        components = {r: n for r, n in self.components.items() if r != role}
        needed = set(required_particulars(self.components)) - set(required_particulars(components))
        unused = [key for key in self.particulars if key in needed]
        words = f"[ship] {', '.join(unused)}: not used by any model"
        return self._with_components(components, (Message(words, "unused_particulars"),) if unused else ())

    @property
    def rhs(self) -> Any:
        """Her equations of motion as a function, ``ship.rhs(state, controls)``, with ``jacobian``, ``forces``, and
        ``function`` for CasADi: a ``mmg.right_hand_side.RightHandSide``. Made once, and again where a function that a
        user registered has changed."""
        function = vars(self).get("rhs")  # a frozen dataclass takes no assignment
        if function is None or function.own != self.own:
            # by its name: users look for it here, and it is made of what knows ships
            function = vars(self)["rhs"] = import_module("mmg.right_hand_side").RightHandSide(self)
        return function

    @property
    def jacobian(self) -> Any:
        """That of ``rhs``: ``ship.jacobian(state, controls)``."""
        return self.rhs.jacobian

    @property
    def forces(self) -> Any:
        """Those of ``rhs``, by component: ``ship.forces(state, controls)``."""
        return self.rhs.forces

    @property
    def free(self) -> tuple[str, ...]:
        """Symbols that a fit may change."""
        return tuple(name for name, c in self.coefficients.items() if not c.fixed)

    @property
    def values(self) -> np.ndarray:
        """Values of all coefficients, shape (P,), in the order of ``symbols``."""
        return np.array([c.value for c in self.coefficients.values()], dtype=float)

    def with_values(self, values: Mapping[str, float] | None = None, **named: float) -> Ship:
        """A copy with some coefficient values replaced, by symbol; also by keyword: with_values(N_r=-0.05). Raises
        UserError for an unknown symbol and a value that is no finite number."""
        chosen = self._chosen(values, named)
        for symbol in chosen:
            self._check_symbol(symbol)
        return self.with_coefficients({s: self.coefficients[s].with_(value=v) for s, v in chosen.items()})

    def _chosen(self, values: Mapping[str, float] | None, named: Mapping[str, float]) -> dict[str, float]:
        """Finite numbers by symbol: ``values``, and those ``named`` by keyword. Raises UserError for any other."""
        given = {} if values is None else by_name(values)
        return {symbol: finite(f"{self.name}: {symbol}", value) for symbol, value in {**given, **named}.items()}

    def _check_symbol(self, symbol: str) -> None:
        """Raises UserError for a ``symbol`` that she has not."""
        if symbol not in self.coefficients:
            raise UnknownName(f"{self.name}: {unknown('coefficient', symbol, self.symbols)}")

    def of_campaign(self, name: str) -> Ship:
        """A copy as the trials of the campaign ``name`` have it, which knows no campaigns. Raises KeyError."""
        values = {symbol: value for symbol, value in self.campaigns[name].items() if symbol in self.coefficients}
        return replace(self.with_values(values), campaigns={})

    def with_coefficients(self, changed: Mapping[str, Coefficient]) -> Ship:
        """A copy with some coefficients replaced (their order is kept)."""
        return replace(self, coefficients={**self.coefficients, **changed})

    def fixing(self, symbols: Iterable[str], fixed: bool = True) -> Ship:
        """A copy in which these coefficients are fixed (or freed). Raises UserError for an unknown symbol."""
        symbols = [symbols] if isinstance(symbols, str) else list(symbols)
        for symbol in symbols:
            self._check_symbol(symbol)
        return self.with_coefficients({s: self.coefficients[s].with_(fixed=fixed) for s in symbols})

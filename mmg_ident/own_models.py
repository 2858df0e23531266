"""``@force`` and ``@effect``: functions of a user as force models and effects, checked before they are known."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import fields
from types import SimpleNamespace
from typing import Any, TypeVar

import casadi as ca
import numpy as np

from mmg.components.catalogue import FORCES, INERTIA, MODELS, OwnForce, coefficient_table, required_particulars
from mmg.components.coefficients import PARTICULARS, Coefficient, table
from mmg.components.own import Own, origin_of
from mmg.effects.effect import Parameter
from mmg.effects.own import HOOKS, OwnEffect
from mmg.errors import BadValue, Conflict, Missing, OutOfRange, UnknownName, UserError, refusing, unknown
from mmg.model import assemble
from mmg.motion.flow import INPUTS, Flow, Slipstream
from mmg.motion.smooth import Smooth
from mmg.rollout import Simulator
from mmg.ship import Ship

F = TypeVar("F", bound=Callable[..., Any])
R = TypeVar("R", bound=Coefficient | Parameter)
Row = Coefficient | tuple[Any, ...]

MOVING = np.array([[1.0, 2.0, 0.3, 0.5, 0.1, 0.05]]).T  # A state x, y, psi, u, v, r (6, 1) at which an effect shows
# Roles that a function can have: terms of a generated polynomial are chosen, not written.
OWN_ROLES = tuple(role for role in FORCES if role != "expansion")
LENGTH = 3.0  # Of the ship on which a function is tried [m]: that of a model, as the smoothing is made for
KNOWN_SIZES = {"L": LENGTH, "B": 0.5, "d": 0.2, "m": 240.0, "x_G": 0.05, "rho": 1000.0, "rho_a": 1.2, "x_R": -1.4}
# Particulars of that ship: by name, and of the others by their unit (else 1). Set by hand.
SIZES = {"m": 0.1, "m²": 0.02, "m/s": 0.8, "-": 0.7, "rad": 0.1, "rad/s": 0.1}


@refusing
def force(
    role: str, coefficients: Iterable[Row], name: str | None = None, source: str = "own model"
) -> Callable[[F], F]:
    """Makes a function a force model of a ``role``, which ships name as they do one of the library.

    role: "hull", "propeller", "rudder", "bow_thruster", "stern_thruster", "azimuth", "wind" or "waves"; coefficients:
    ``Coefficient``, or rows (symbol, value, standard deviation of the prior, lower, upper, "mmg" or SI unit, words);
    name: default that of the function; source: of the values, in words.

    The function is ``f(flow, p, c, s)``: the motion through water and air and the actuators (``mmg.motion.flow.Flow``,
    SI), the particulars, the coefficients, each by attribute, and what makes roots, steps and quotients smooth at rest
    (``mmg.motion.smooth``). It returns CasADi expressions of X, Y [N] and N [N m] about midship, as a tuple or
    ``Force``; a propeller a ``Force`` with a ``Slipstream``. What it reads of particulars and actuators is what a ship
    must have. Its docstring, a title and equations, is what reports say. Run again, it replaces what it was; other
    functions of the name are refused.

    Returns the function as it is. Raises UserError, which names the argument, for a role, coefficient or name that
    cannot be, and for a function that reads what there is not, returns anything else, or is no number at rest.
    """
    if role not in OWN_ROLES:
        raise UnknownName(unknown("role", role, OWN_ROLES))
    rows = _coefficients(coefficients, source)

    def registered(function: F) -> F:
        where = f"{role} model {_name(name, function)}"
        read, inputs = _read(function, role, rows, where)
        stated = {"role": role, "COEFFICIENTS": rows, "PARTICULARS": read, "INPUTS": inputs}
        model = OwnForce(function, name=_name(name, function), origin=origin_of(function), **stated)
        _try(model, {role: model.name}, where)
        return function

    return registered


@refusing
def effect(
    enters: str,
    parameters: Iterable[Parameter | tuple[Any, ...]],
    name: str | None = None,
    needs: Sequence[str] = (),
    surroundings: bool = False,
) -> Callable[[F], F]:
    """Makes a function an effect: switched on by ``simulate``, freed by ``with_effect``, tested by ``diagnose``.

    enters: "force": f(parts, flow, e, at), returns X, Y [N], N [N m] that are added, or the forces ``parts`` by role,
    changed; "inflow": f(flow, e), the velocity of the water, north and east [m/s], and its rates [m/s^2]; "air":
    f(north, east, e), velocity of the air over ground [m/s]; "actuator path": f(flow, memory, e, p, s), the flow with
    the actuators as they are; "inertia": f(inertia, flow, e, p, s); "particulars": f(p, e); "measurement": f(y, flow,
    memory, e, p), the six columns as logged. ``e`` holds the parameters by attribute, ``p`` the particulars, ``at``
    these, the coefficients ``c``, memory and smoothing ``s``. At its neutral values it must change nothing.
    parameters: ``Parameter``, or rows (symbol, neutral value, typical offset from it, lower, upper, SI unit, words);
    name: default that of the function; needs: roles that the ship must have; surroundings: whether it belongs to a
    place or a day and not to the ship.

    Returns the function as it is. Raises UserError, which names the argument, as ``force`` does, and for an effect
    that is there at its neutral values.
    """
    if enters not in HOOKS:
        raise UnknownName(f"enters: {unknown('place', enters, HOOKS)}")
    if strange := [role for role in needs if role not in MODELS]:
        raise UnknownName(f"needs: {unknown('role', strange[0], MODELS)}")
    rows = _parameters(parameters)

    def registered(function: F) -> F:
        title = _name(name, function)
        stated = {"enters": enters, "rows": rows, "needs": tuple(needs), "surroundings": surroundings}
        _try(OwnEffect(function, name=title, origin=origin_of(function), **stated), {}, f"effect {title}")
        return function

    return registered


def _name(name: str | None, function: Callable[..., Any]) -> str:
    """The name of a model. Raises UserError for one that cannot be a name."""
    if not callable(function):
        raise BadValue(f"function: is a {type(function).__name__}; write the decorator above a function")
    return _word("name", getattr(function, "__name__", "") if name is None else name)


def _word(argument: str, word: Any) -> str:
    """A name or symbol. Raises UserError unless it is one of Python."""
    if not isinstance(word, str) or not word.isidentifier():
        raise BadValue(f"{argument}: {word!r}: must be letters, digits and underscores, such as Y_v")
    return word


def _rows(argument: str, given: Any, kind: type[R], made: Callable[[Any], R], form: str) -> tuple[R, ...]:
    """The rows of an ``argument``, each of a ``kind`` or what is ``made`` of a tuple of a ``form``."""
    rows: list[R] = []
    for row in given:
        if not isinstance(row, kind):
            if not isinstance(row, (tuple, list)) or len(row) != 7:  # as many cells as either form names
                raise BadValue(f"{argument}: {row!r}: must be a mi.{kind.__name__} or ({form})")
            row = made(tuple(row))
        if _word(argument, row.symbol) in [other.symbol for other in rows]:
            raise Conflict(f"{argument}: {row.symbol} is there twice")
        rows.append(row)
    return tuple(rows)


def _check_range(argument: str, row: Coefficient | Parameter, value: float, size: float) -> None:
    """Raises UserError for numbers of a row that contradict each other."""
    numbers: tuple[Any, ...] = (value, size, row.lower, row.upper)  # bounds may be infinite
    if not all(isinstance(x, (int, float)) and not math.isnan(x) for x in numbers) or not math.isfinite(value):
        raise BadValue(f"{argument}: {row.symbol}: value, size and bounds must be numbers, not {numbers}")
    if not row.lower <= value <= row.upper:
        raise OutOfRange(f"{argument}: {row.symbol} = {value:g}: outside its bounds [{row.lower:g}, {row.upper:g}]")
    if not math.isfinite(size) or size == 0:
        raise OutOfRange(f"{argument}: {row.symbol}: its standard deviation or typical size must not be {size:g}")


def _coefficients(given: Iterable[Row], source: str) -> tuple[Coefficient, ...]:
    """The coefficients of a force model, checked."""
    form = "symbol, value, std, lower, upper, 'mmg' or unit, words"
    rows = _rows("coefficients", given, Coefficient, lambda row: table(source, row)[0], form)
    for row in rows:
        if row.symbol in [mass.symbol for mass in INERTIA]:
            raise Conflict(f"coefficients: {row.symbol} is an added mass, which every ship has; rename it")
        # a fixed one needs no standard deviation: 1 in its place passes
        _check_range("coefficients", row, row.value, row.std or float(row.fixed))
        if row.std < 0 or row.prime not in ("", "mmg"):
            raise BadValue(f"coefficients: {row.symbol}: std must not be negative, and prime '' or 'mmg'")
    return rows


def _parameters(given: Iterable[Parameter | tuple[Any, ...]]) -> tuple[Parameter, ...]:
    """The parameters of an effect, checked."""
    form = "symbol, neutral, typical, lower, upper, unit, words"
    rows = _rows("parameters", given, Parameter, lambda row: Parameter(*row), form)
    for row in rows:
        _check_range("parameters", row, row.neutral, row.typical)
    if not rows:
        raise Missing("parameters: an effect has at least one, whose neutral value is its absence")
    return rows


class NotedParticulars(SimpleNamespace):
    """Particulars by attribute, which notes those that are read."""

    def __getattribute__(self, key: str) -> Any:
        if not key.startswith("__"):  # vars(self) below reads __dict__, and would be noted without end
            vars(self)["read"][key] = True
        return super().__getattribute__(key)


def _trial_particulars(names: Iterable[str]) -> dict[str, float]:
    return {name: KNOWN_SIZES.get(name, SIZES.get(PARTICULARS[name][1], 1.0)) for name in names}


def _read(
    function: Callable[..., Any], role: str, rows: Sequence[Coefficient], where: str
) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """The particulars that a force model reads and the actuators on which its forces depend, by one evaluation.

    Raises UserError where it reads what is neither a particular nor a coefficient, fails, or returns no force.
    """
    symbols = {f.name: ca.SX.sym(f.name) for f in fields(Flow) if f.name != "slipstream"}
    # only a rudder lies behind a propeller: another role that reads the slipstream finds None, and fails here
    stream = [ca.SX.sym(name) for name in ("one_minus_w", "u_P", "loading", "ahead")] if role == "rudder" else None
    flow, read = Flow(**symbols, slipstream=Slipstream(*stream) if stream else None), dict[str, bool]()
    p = NotedParticulars(read=read, **_trial_particulars(PARTICULARS))
    c = SimpleNamespace(**{r.symbol: ca.SX.sym(r.symbol) for r in rows})
    model = OwnForce(function, name="", role=role, origin="")
    try:
        forces = model.force(flow, p, c, Smooth.for_length(LENGTH))  # type: ignore[arg-type]
    except AttributeError as error:  # its obj tells p and c from attributes of the user's own objects
        if error.obj is c:
            raise Missing(f"coefficients: {where} reads c.{error.name}, which is none of them") from None
        if error.obj is p:
            words = unknown("particular", str(error.name), PARTICULARS)
            raise UnknownName(f"function: {where} reads p.{error.name}: {words}") from None
        raise _failed(where, error) from None
    except UserError:
        raise
    except Exception as error:
        raise _failed(where, error) from None
    if role == "propeller" and forces.slipstream is None:
        words = "mi.Force(X, Y, N, mi.Slipstream(one_minus_w, u_P, loading, ahead)), of which the rudder lives"
        raise BadValue(f"function: {where} must return {words}")
    # an input that is read but drops out, as in 0 * n, is none that a ship must have
    used = {x.name() for x in ca.symvar(ca.SX(ca.vertcat(forces.X, forces.Y, forces.N)))}
    return tuple(name for name in PARTICULARS if name in read), tuple(name for name in INPUTS if name in used)


def _failed(where: str, error: Exception) -> UserError:
    words = f"{type(error).__name__}: {error}"
    return BadValue(f"function: {where} fails on CasADi expressions ({words}); use operators and casadi's functions")


def _try(model: Own, components: dict[str, str], where: str) -> None:
    """Registers a ``model`` and evaluates a ship with it; takes it back and raises UserError where that fails."""
    before = dict(model.names)
    model.register()  # a ship is assembled of names alone, so that it can be tried only where its name is known
    try:
        _evaluate(model, components, where)
    except Exception as error:
        if model.name in before:
            model.names[model.name] = before[model.name]
        else:
            del model.names[model.name]
        if isinstance(error, UserError):
            raise
        raise _failed(where, error) from None


def _evaluate(model: Own, components: dict[str, str], where: str) -> None:
    """Raises UserError where the motion of a ship with a ``model``, or its derivatives, are no numbers at rest, and
    where an effect changes anything at its neutral values."""
    chosen = {"hull": "unified", "propeller": "standard", "rudder": "standard"}
    chosen |= {role: next(iter(MODELS[role])) for role in getattr(model, "needs", ()) if role not in chosen}
    chosen |= components
    particulars = _trial_particulars(required_particulars(chosen))
    bare = Ship("trial", particulars, chosen, coefficient_table(chosen, particulars))
    ship = bare if components else bare.with_effect(model.name)
    system = assemble(ship)
    S, C = len(system.states), len(system.controls)
    x = ca.SX.sym("x", S + C + len(system.symbols))
    z, c, theta = ca.vertsplit(x, [0, S, S + C, x.numel()])
    y = ca.vertcat(system.rates(z, c, theta), system.columns(z, theta))
    J = ca.densify(ca.jacobian(y, x))  # dense: numpy reads structural zeros as 0
    # second derivatives by the first six columns of J, those of x, y, psi, u, v, r, where roots and moduli have kinks
    f = ca.Function("f", [x], [ca.densify(y), J, ca.densify(ca.jacobian(ca.vec(J[:, :6]), z))], {"cse": True})
    at_rest = np.concatenate([np.zeros(x.numel() - len(ship.values)), ship.values])  # states and inputs all zero
    for part, words in zip(f(at_rest), ("motion", "first derivative", "second derivative"), strict=True):
        if not np.isfinite(np.array(part)).all():
            advice = "keep roots, quotients and moduli smooth: s.root, s.divide, s.absolute"
            raise BadValue(f"function: {where}: the {words} of a ship with it is no number at rest; {advice}")
    if components:
        return
    motions = []  # rates of x, y, psi, u, v, r and the six columns (12, 1), without the effect and with it at neutral
    for each in (bare, ship):
        simulator, controls = Simulator(each, compiled=False), np.full((len(each.inputs), 1), 0.3)  # all inputs act
        state = simulator.start(MOVING, controls)
        motions.append(np.vstack([simulator.rates(state, controls)[:6], simulator.columns(state)]))
    if not np.allclose(motions[0], motions[1], rtol=1e-9, atol=1e-12):  # set by hand: rounding, far below any effect
        raise BadValue(f"parameters: {where} changes the motion or its columns at their neutral values")

"""The ship as serialised CasADi functions that CasADi alone loads: rates, one step, forces, columns, start.

A folder: ``NAME.casadi`` per function (``casadi.Function.load``), and ``model.json`` with names and units of all
arguments. The coefficients stand inside as numbers;
``rates_of_coefficients`` and ``step_of_coefficients`` take them as an argument, for sensitivities and for estimation.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import casadi as ca

from delivery.product import QUANTITIES, Product
from fitting.report.run_folder import plain, write_json
from mmg.effects import effect
from mmg.messages import Message
from mmg.model import Model
from mmg.runge_kutta import rk4_step

DELAY_APPROXIMATE = "delay_approximate"  # Code of what is said of an effect that delays the inputs


def write_casadi(product: Product, target: Path) -> list[Message]:
    """Write the functions of ``product`` into the empty folder ``target``. Returns what is to be said of them."""
    functions = casadi_functions(product.model)
    for name, function in functions.items():
        function.save(str(target / f"{name}.casadi"))
    write_json(target / "model.json", about(product, functions))
    ship = product.ship
    late = [name for name in ship.effects if effect(name).input_delay(ship.parameters_of(name)) is not None]
    words = "is a smooth approximation here, as in a fit; mmg simulate and the FMU delay the inputs exactly"
    return [Message(f"the effect {name} {words}", DELAY_APPROXIMATE) for name in late]


def casadi_functions(model: Model) -> dict[str, ca.Function]:
    """Functions by name, scalar expressions all through: of state (S,), controls (C,) and, where named so,
    coefficients (P,). model: of the ship; the coefficients of its ship are the numbers inside."""
    values = ca.DM([model.ship.coefficients[s].value for s in model.symbols])
    state = ca.SX.sym("state", len(model.states))
    controls, h = ca.SX.sym("controls", len(model.controls)), ca.SX.sym("h")
    free, six = ca.SX.sym("coefficients", len(model.symbols)), ca.SX.sym("six", 6)

    def step(theta: Any) -> Any:
        return rk4_step(lambda z, _: model.rates(z, controls, theta), state, h)

    z, c = {"state": state}, {"controls": controls}
    arguments = {
        "rates": (z | c, model.rates(state, controls, values), "rates"),
        "step": (z | c | {"h": h}, step(values), "state_after"),
        "forces": (z | c, model.forces(state, controls, values), "forces"),
        "columns": (z, model.columns(state, values), "columns"),
        "initial": ({"six": six} | c, model.initial(six, controls, values), "state"),
        "rates_of_coefficients": (z | c | {"coefficients": free}, model.rates(state, controls, free), "rates"),
        "step_of_coefficients": (z | c | {"h": h, "coefficients": free}, step(free), "state_after"),
    }
    functions = {}
    for name, (given, expression, result) in arguments.items():
        dense = [ca.densify(expression)]  # full vectors, whatever is zero in this ship
        functions[name] = ca.Function(name, list(given.values()), dense, list(given), [result], {"cse": True})
    return functions


def about(product: Product, functions: dict[str, ca.Function]) -> dict[str, Any]:
    """What ``model.json`` says beside ``product.json``: names and units of states, controls, coefficients, forces.

    product: that is exported; functions: by name.
    """
    model = product.model
    content = {
        "ship": product.ship.called,
        "longest_step_s": product.longest_step,
        "functions": {name: {"file": f"{name}.casadi", "signature": str(f)} for name, f in functions.items()},
        "states": [_quantity(name) for name in model.states],
        "controls": [_quantity(name) for name in model.controls],
        "columns": [_quantity(name) for name in model.states[:6]],
        "forces": {"rows": list(model.roles), "columns": ["X [N]", "Y [N]", "N [N m]"]},
        "coefficients": [vars(c) for c in product.coefficients],
    }
    return json.loads(json.dumps(plain(content)))  # tuples and numpy numbers as JSON has them


def _quantity(name: str) -> dict[str, str]:
    description, unit = QUANTITIES.get(name, ("remembered by an effect or an actuator; start it with initial", ""))
    return {"name": name, "unit": unit, "description": description}

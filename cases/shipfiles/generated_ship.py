"""A ship whose forces under water are a generated polynomial, made from a ship that has actuators and particulars."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import replace

from cases.shipfiles.particulars import RATES
from mmg.components.catalogue import coefficient_table, required_particulars
from mmg.components.expansion.actuators import devices_of, parse_devices, without_partner
from mmg.components.expansion.series import RANGE
from mmg.components.expansion.structure import Structure, terms
from mmg.effects import EFFECTS
from mmg.errors import Conflict, Missing, Unsupported
from mmg.messages import Message
from mmg.motion.flow import INPUTS, PODS
from mmg.ship import Ship

# Places of the pods, which a generated polynomial keeps for the sense in which they steer.
PODS_OF = tuple(f"{axis}_az{ending}" for ending in ("", *(f"_{i}" for i in range(2, PODS + 1))) for axis in "xy")
REPLACED = ("hull", "propeller", "rudder", "azimuth", "roll")  # Roles whose forces the polynomial takes over
# Tunnel thrusters, which stay models of their own unless the list of actuators names them.
TUNNELS = {"n_bow": "bow_thruster", "n_stern": "stern_thruster"}
KEPT = ("C_b", "U_0", *RATES, "scale", "delta_stall", *PODS_OF)  # Particulars that stay though no force needs them
# Prior of terms on top of physical models, as a share of that of terms instead of them. Set by hand.
OFFSET_SHARE = 0.3


def structure_of(
    ship: Ship,
    order: int = 2,
    submodels: str = "SM-2",
    actuators: str | None = None,
    symmetric: bool = True,
    duplicates: str = "paper",
    moduli: str = "paper",
) -> Structure:
    """The structure of a generated polynomial for ``ship``.

    order, submodels, symmetric, duplicates, moduli: as of ``Structure``; actuators: list as ``parse_devices`` takes it,
    None: those of the ship but its tunnel thrusters, or with them where there are no others. Raises UserError for a
    list that claims symmetry with an actuator whose partner is missing, and for words that ``Structure`` refuses.
    """
    if actuators is None:
        inputs = [name for name in ship.actuators if name not in TUNNELS] or list(ship.actuators)
        devices = devices_of(inputs, ship.particulars)
    else:
        devices = parse_devices(actuators)
    if not devices:
        raise Missing(f"{ship.name}: none of its force models has an actuator; name them with --actuators")
    lonely = without_partner(devices, ship.particulars)
    if symmetric and lonely:
        count = sum(len(device.names) for device in devices)
        raise Conflict(
            f"actuators {', '.join(map(str, devices))}: symmetry is claimed, but {len(lonely)} of {count} lie off the "
            f"centre plane without a mirror partner ({', '.join(lonely)}); write pairs as a+b, or add --asymmetric"
        )
    return Structure(devices, order, submodels, symmetric, duplicates, moduli)


def generated_ship(ship: Ship, structure: Structure, name: str = "", hard: bool = False, offset: bool = False) -> Ship:
    """A ship with the terms of ``structure``: instead of hull, propeller and rudder of ``ship``, or on top of them.

    Its added masses and wind coefficients are free, as in Miyauchi et al. (2023); coefficients of all other models stay
    as they are and are fixed. name: of the new ship; hard: sub-models switch at once; offset: the models of ``ship``
    stay, fixed, and the terms have narrower priors. Raises UserError where an effect of the ship needs a model that is
    replaced.
    """
    ship = ship.without_network()
    listed = {name for device in structure.devices for name in device.names}
    gone = {role for name, role in TUNNELS.items() if name in listed} | set(REPLACED) if not offset else set()
    components = {role: model for role, model in ship.components.items() if role not in {*gone, "expansion"}}
    components["expansion"] = "hard_submodels" if hard else "smooth_submodels"
    rows = terms(structure)
    if offset:
        # about zero: the models below have the forces already
        rows = tuple(c.with_(std=OFFSET_SHARE * c.std, lower=-3 * c.std, upper=3 * c.std) for c in rows)
    table = coefficient_table(components, ship.particulars)
    for effect, role in ((e, role) for e in ship.effects for role in EFFECTS[e].needs if role not in components):
        words = f"its effect {effect} needs a {role} model, which a generated polynomial replaces"
        raise Unsupported(f"{ship.name}: {words}; take the effect out first")
    prefixes = tuple(f"{effect}." for effect in ship.effects)
    effects = {s: c for s, c in ship.coefficients.items() if s.startswith(prefixes)}
    free = coefficient_table({"wind": ship.components["wind"]} if "wind" in ship.components else {}, ship.particulars)
    present = {s: ship.coefficients.get(s, c) for s, c in table.items()}
    taken = {s: c.with_(fixed=c.std == 0 if s in free else True) for s, c in present.items()}
    keys = (*required_particulars(components), *KEPT, *(("y_P",) if offset else ()))
    particulars = {key: value for key, value in ship.particulars.items() if key in keys}
    unheard = [] if offset else [n for n in ship.actuators if n not in _inputs(structure, components)]
    words = f"{structure.words}; made from {ship.name}"
    return replace(
        ship,
        name=name or f"{ship.name}_generated",
        description=f"Generated polynomial: {words}",
        reference="; ".join(filter(None, ["Miyauchi et al. (2023), Abkowitz-MMG hybrid model", ship.reference])),
        particulars=particulars,
        components=components,
        coefficients={**taken, **{c.symbol: c for c in rows}, **effects},
        notices=(Message(f"not in the polynomial: {', '.join(unheard)}", "unused_actuator"),) if unheard else (),
    )


def _inputs(structure: Structure, components: Iterable[str]) -> set[str]:
    names = {name for device in structure.devices for name in device.names}
    names |= {f"n_{name}" for name in names if name.startswith("azimuth")}
    return names | {name for name, role in TUNNELS.items() if role in components} & set(INPUTS)


# Particulars that give the range of the motions behind a polynomial.
RANGES = tuple(dict.fromkeys(name for pair in RANGE.values() for name in pair))


def optional_particulars(components: Mapping[str, str]) -> tuple[str, ...]:
    """Particulars that the force models may use beside those that they need. components: role -> model."""
    more = ("delta_stall", *RANGES, *PODS_OF) if "expansion" in components else ()
    return (*more, *PODS_OF[2:]) if "azimuth" in components else more

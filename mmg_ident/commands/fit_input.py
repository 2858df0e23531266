"""What ``mmg fit`` makes of its arguments: settings, ship, trials by role, captive points, an automatic choice."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from collections.abc import Sequence

    from cases.trial import Trial
    from fitting.model_selection import Selection
    from fitting.nlp.captive import Captive
    from fitting.settings import Settings
    from mmg.ship import Ship


def _settings(sigma: str | None, **values: Any) -> Settings:
    """Settings from the options; UserError when a number makes no sense."""
    from fitting.nlp.loss import LOSSES
    from fitting.settings import Settings
    from mmg.errors import UserError
    from mmg_ident.commands.output import numbers_of

    for name in ("window", "step", "tolerance", "time_limit"):
        if values[name] is not None and not values[name] > 0:
            raise UserError(f"--{name.replace('_', '-')} {values[name]:g} must be positive")
    for name, least in (("interval", 1), ("starts", 1), ("workers", 1), ("max_iterations", 0)):
        if values[name] < least:
            raise UserError(f"--{name.replace('_', '-')} {values[name]} must be at least {least}")
    if values["loss"] not in LOSSES:
        raise UserError(f"--loss {values['loss']}: unknown; choose one of {', '.join(LOSSES)}")
    return Settings(sigma=numbers_of(sigma, 6, "--sigma") if sigma else None, **values)


def _start(out: Path, resume: bool, ship: str) -> Ship:
    """The ship to start from (the run's own start when resuming), after checking the run folder."""
    from cases.shipfiles.network_file import NETWORK, load_network
    from cases.shipfiles.ship_file import load_ship
    from fitting.report.run_folder import START, check_target

    if resume and out.exists():
        start, network = load_ship(out / START), out / NETWORK
        return start.with_network(load_network(network, start)) if network.exists() else start
    check_target(out)
    return load_ship(ship)


def _reduced(
    ship: Ship,
    without: list[str] | None,
    with_: list[str] | None,
    fix: list[str] | None,
    only: list[str] | None,
) -> Ship:
    """The ship with components left out, effects freed and coefficients fixed as asked.

    What of the instruments is free stays so with --only: --measurement and --fix decide that.
    """
    from cases.shipfiles.effects import freeing_effects
    from cases.shipfiles.ship_file import dump_ship, parse_ship
    from mmg.effects import EFFECTS
    from mmg.errors import UserError
    from mmg_ident.commands.output import names_of

    for role in names_of(without):
        if role in ship.effects:
            ship = ship.without_effect(role)
            continue
        if role not in ship.components:
            raise UserError(f"--without {role}: {ship.name} has no such component; it has {', '.join(ship.components)}")
        if role == "hull" or (role == "propeller" and "rudder" in ship.components):
            raise UserError(f"--without {role}: the rest of the model needs it")
        from mmg.components.catalogue import coefficient_table

        components = {r: n for r, n in ship.components.items() if r != role}
        kept = coefficient_table(components, ship.particulars)
        kept |= {s: c for s, c in ship.coefficients.items() if s.partition(".")[0] in ship.effects}
        rest = {s: ship.coefficients[s] for s in kept if s in ship.coefficients}
        network, ship = ship.network, replace(ship.without_network(), components=components, coefficients=rest)
        ship = parse_ship(dump_ship(ship), ship.name)
        ship = ship.with_network(network) if network else ship
    ship = freeing_effects(ship, with_ or [])
    for option, names in (("--fix", names_of(fix)), ("--only", names_of(only))):
        unknown = [name for name in names if name not in ship.coefficients]
        if unknown:
            raise UserError(f"{option}: unknown coefficient {', '.join(unknown)}; known: {', '.join(ship.symbols)}")
    if only:
        instruments = tuple(f"{name}." for name in ship.effects if EFFECTS[name].measures)
        ship = ship.fixing([s for s in ship.symbols if s not in names_of(only) and not s.startswith(instruments)])
    return ship.fixing(names_of(fix))


def measuring(ship: Ship, measurement: str) -> Ship:
    """The ship with effects of its instruments freed; those that it has already stay as they are.

    A satellite delay stands for the velocity lag, which is then not added.
    """
    from cases.shipfiles.effects import freeing_effects
    from mmg.effects import EFFECTS
    from mmg.errors import UserError
    from mmg_ident.commands.output import names_of

    names = [] if measurement == "none" else names_of([measurement])
    for name in names:
        if name not in EFFECTS or not EFFECTS[name].measures:
            known = [e for e, effect in EFFECTS.items() if effect.measures]
            raise UserError(f"--measurement {name}: no effect of an instrument; known: {', '.join(known)}, or none")
    present = {"velocity_lag"} if "gnss_delay" in ship.effects else set()
    return freeing_effects(ship, [name for name in names if name not in {*ship.effects, *present}])


def _own_constants(
    ship: Ship, texts: list[str] | None, train: Sequence[Trial], auto: bool
) -> tuple[Ship, tuple[str, ...]]:
    """The ship with effects of which each run has its own constants, and the symbols of those constants."""
    from cases.shipfiles.effects import varying_effects
    from mmg.errors import UserError
    from mmg_ident.commands.output import say

    if not texts:
        return ship, ()
    if auto:
        raise UserError(
            "--auto does not choose among models with constants of their own: leave out --auto or --per-run"
        )
    if len(train) == 1:
        say(
            f"a single run: its own constants are, but for the narrower prior, those of --with {' --with '.join(texts)}"
        )
    return varying_effects(ship, texts)


def _compare_hashes(
    out: Path, start: Ship, trials: Sequence[Trial], resume: bool, constants: Sequence[str] = ()
) -> None:
    """When resuming, data, free coefficients and constants of the runs must be those of the interrupted run."""
    from fitting.report.run_folder import read_result
    from mmg.errors import UserError

    if not (resume and out.exists()):
        return
    earlier = read_result(out)
    if set(earlier["coefficients"]) != set(start.free):
        raise UserError(f"{out}: --resume needs the same --without, --fix and --only as the interrupted run")
    if {symbol for rows in earlier.get("per_run", {}).values() for symbol in rows} != set(constants):
        raise UserError(f"{out}: --resume needs the same --per-run as the interrupted run")
    before = sorted(row["sha256"] for row in earlier["data"])
    if before != sorted(t.sha256 for t in trials):
        raise UserError(f"{out}: --resume needs the same trial files as the interrupted run")


def _captive(path: Path | None, sigma: str | None) -> Captive | None:
    """Captive points of --captive, with the standard deviations of --captive-sigma."""
    from fitting.nlp.captive import read_captive
    from mmg.errors import UserError
    from mmg_ident.commands.output import numbers_of

    if path is None:
        if sigma:
            raise UserError("--captive-sigma: there is no --captive to which it belongs")
        return None
    given = numbers_of(sigma, 3, "--captive-sigma") if sigma else None
    if given and min(given) <= 0:
        raise UserError(f"--captive-sigma {sigma}: X, Y [N] and N [N m] must be positive")
    return read_captive(path, given)


def _chosen(ship: Ship, train: Sequence[Trial], settings: Settings, captive: Captive | None, limit: float) -> Selection:
    """The model that cross-validation over the training runs chooses, by both cores where --workers is left at 1."""
    import os

    from fitting.model_selection import select
    from mmg_ident.commands.output import say

    spread = replace(settings, workers=settings.workers if settings.workers > 1 else min(os.cpu_count() or 1, 8))
    return select(ship, train, spread, captive, limit=limit, say=say)

"""What ``mmg fit`` makes of its arguments: settings, the ship to start from, captive points."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

from mmg.errors import UserError
from mmg_ident.commands.output import numbers_of

if TYPE_CHECKING:
    from fitting.nlp.captive import Captive
    from fitting.result import FitResult
    from fitting.settings import Settings
    from mmg.ship import Ship


def settings_of(sigma: str | None, **values: Any) -> Settings:
    """Settings from the options ``values`` by name, and ``sigma``: six numbers. Raises UserError for what makes no
    sense."""
    from fitting.nlp.loss import LOSSES
    from fitting.settings import Settings

    for name in ("window", "step", "tolerance", "time_limit"):
        if values[name] is not None and not values[name] > 0:
            raise UserError(f"--{name.replace('_', '-')} {values[name]:g} must be positive")
    for name, least in (("interval", 1), ("starts", 1), ("workers", 1), ("max_iterations", 0)):
        if values[name] < least:
            raise UserError(f"--{name.replace('_', '-')} {values[name]} must be at least {least}")
    if values["loss"] not in LOSSES:
        raise UserError(f"--loss {values['loss']}: unknown; choose one of {', '.join(LOSSES)}")
    return Settings(sigma=numbers_of(sigma, 6, "--sigma") if sigma else None, **values)


def starting_ship(ship: str, out: Path) -> Ship:
    """The ship named ``ship`` to start from, once the run folder ``out`` is known to be free."""
    from cases.shipfiles.ship_file import load_ship
    from fitting.report.run_folder import check_target

    check_target(out)
    return load_ship(ship)


def resumed(out: Path) -> FitResult:
    """The interrupted run in the folder ``out``. Raises UserError where it holds none to go on from."""
    from fitting.result import read_fit

    found = read_fit(out)
    if found.iterate is None and not found.converged:
        raise UserError(f"{out}: no iterate to resume from; start again without --resume")
    return found


def captive_points(path: Path | None, sigma: str | None) -> Captive | None:
    """Captive points of the file ``path``, with standard deviations ``sigma``: "X,Y [N],N [N m]"; None without a file.

    Raises UserError for a sigma that is no three positive numbers, or that has no points.
    """
    from fitting.nlp.captive import read_captive

    if path is None:
        if sigma:
            raise UserError("--captive-sigma: there is no --captive to which it belongs")
        return None
    given = numbers_of(sigma, 3, "--captive-sigma") if sigma else None
    if given and min(given) <= 0:
        raise UserError(f"--captive-sigma {sigma}: X, Y [N] and N [N m] must be positive")
    return read_captive(path, given)

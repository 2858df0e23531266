"""Options that went with this version, and what to do instead. The table is emptied with the next one."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

from mmg.errors import UnknownName

_CHOICE = "the Gaussian loss is the default; choose --window or --loss yourself, or compare models with mmg select"
_FORCES = "it made no left-out run better; mmg predict --adapt and mmg diagnose estimate a slowly varying force"

_NOT_BY_CAMPAIGN = (
    "velocity_filter", "antenna_offset", "heading_bias", "wind_sensor_bias", "fouling", "draft", "rudder_offset"
)  # fmt: skip
_INSTRUMENTS = "it no longer differs by campaign; choose among gyro, log_scale, or none"

GONE: dict[str | tuple[str, str], str] = {
    "auto": f"--auto is gone: {_CHOICE}",
    "auto_limit": f"--auto-limit is gone with --auto: {_CHOICE}",
    "try_disturbance": f"--try-disturbance is gone: {_FORCES}",
    "horizon": "--horizon is gone: it made no left-out run better; give the length of a window yourself with --window",
    "optimizer": "--optimizer is gone: CMA-ES found no lower objective in 20 times as many simulations",
    ("loss", "auto"): "--loss auto is gone: the Gaussian loss is the default; huber and student suit outliers",
    **{("per_campaign", name): f"--per-campaign {name}: is gone: {_INSTRUMENTS}" for name in _NOT_BY_CAMPAIGN},
}
"""Field, or field and value -> the sentence."""


def refuse_gone(values: Mapping[str, Any] | Iterable[tuple[str, Any]]) -> None:
    """Raises UserError for the first of the ``values`` by name that is gone."""
    for name, value in dict(values).items():
        sentence = GONE.get(name) or (GONE.get((name, value)) if isinstance(value, str) else None)
        if sentence:
            raise UnknownName(sentence)


def refuse_gone_options(arguments: list[str]) -> None:
    """Raises UserError for the first option of the command line ``arguments`` that is gone."""
    for i, argument in enumerate(arguments):
        option, _, value = argument.partition("=")
        if option.startswith("--"):
            following = value or (arguments[i + 1] if i + 1 < len(arguments) else "")
            refuse_gone({option[2:].replace("-", "_"): following})

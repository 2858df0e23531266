"""Black box files: safetensors with the weights of all seeds, settings in the metadata. No pickles."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import asdict
from pathlib import Path

import numpy as np
import torch
from safetensors import SafetensorError, safe_open

from cases.io.files import check_file, parse_json
from cases.io.tensors import save_tensors
from cases.shipfiles.network_file import BLACK_BOX, NETWORK, members_in, ship_hash
from mmg.errors import UserError
from mmg.motion.flow import INPUTS
from mmg.network import LARGEST, OTHER
from mmg.ship import Ship
from residual.blackbox.models import BlackBox, build_box
from residual.settings import KINDS, BlackBoxSettings, settings_from
from residual.training.scales import Scales

_SCALES = ("feature", "output", "acceleration", "mean", "std", "acceleration_mean")
"""Names of ``Scales`` with which a box is built; the rest belongs to its training."""


def save_box(path: Path, box: BlackBox) -> None:
    """Write the black ``box`` with its scales to ``path``.

    Raises UserError where a weight is not finite or the file cannot be written.
    """
    arrays = {f"scales.{name}": torch.as_tensor(np.array(getattr(box.scales, name))) for name in _SCALES}
    for k, system in enumerate(box.systems):
        arrays |= {f"{k}.{name}": value.detach().contiguous() for name, value in system.state_dict().items()}
    bad = [name for name, value in arrays.items() if not torch.isfinite(value).all()]
    if bad:
        raise UserError(f"{path}: {bad[0]} of the network is not finite, so it is not written; train it again")
    about = {
        "format": BLACK_BOX, "ship": box.ship, "ship_hash": box.ship_hash, "h": repr(box.h),
        "actuators": json.dumps(box.actuators), "members": str(len(box.systems)),
        "training": json.dumps({k: v for k, v in asdict(box.settings).items() if k != "workers"}),
    }  # fmt: skip
    try:
        save_tensors(path, {name: value.numpy() for name, value in arrays.items()}, about)
    except (OSError, SafetensorError) as error:
        raise UserError(f"{path}: cannot be written ({error})") from None


def load_box(where: str | Path, ship: Ship | None = None) -> BlackBox:
    """The black box in the file or run folder ``where``. ship: one that it must have been trained for.

    Raises UserError when it cannot be read, is incomplete, or belongs to another ship or other inputs.
    """
    path = Path(where) / NETWORK if Path(where).is_dir() else Path(where)
    check_file(path)
    try:
        with safe_open(path, framework="pt") as file:
            about = file.metadata() or {}
            arrays = {name: file.get_tensor(name) for name in file.keys()}  # noqa: SIM118
    except (OSError, SafetensorError, ValueError, TypeError) as error:
        raise UserError(f"{path}: cannot be read as a black box ({error}); train it again") from None
    if about.get("format") != BLACK_BOX:
        raise UserError(f"{path}: is no black box of this program (format {about.get('format')!r}, not {BLACK_BOX!r})")
    try:
        settings = _settings(about, arrays)
        actuators = tuple(map(str, parse_json(about["actuators"])))
        scales = _scales(arrays)
        systems = tuple(build_box(None, scales, settings, 0) for _ in range(members_in(about, arrays)))
        for k, system in enumerate(systems):
            own = {name: a for name, a in arrays.items() if name.startswith(f"{k}.")}
            system.load_state_dict({name.partition(".")[2]: a for name, a in own.items()})
        box = BlackBox(settings, actuators, float(about["h"]), systems, about["ship"], about["ship_hash"], scales)
        fault = _fault(box)
    except (LookupError, ValueError, TypeError, AttributeError, ArithmeticError, RuntimeError) as error:
        raise UserError(f"{path}: is incomplete ({str(error).splitlines()[0]}); train it again") from None
    if fault:
        raise UserError(f"{path}: {fault}; train it again")
    if ship and (actuators != ship.actuators or box.ship_hash != ship_hash(ship)):
        raise UserError(
            f"{path}: {OTHER}: it was trained for {box.ship} with {', '.join(actuators)}; "
            f"{ship.name} has {', '.join(ship.actuators)}"
        )
    return box


def _settings(about: Mapping[str, str], arrays: Mapping[str, torch.Tensor]) -> BlackBoxSettings:
    """The settings of a file, whose layers are no larger than its arrays. Raises ValueError for others."""
    settings = settings_from(parse_json(about["training"]))
    if not isinstance(settings, BlackBoxSettings):
        raise ValueError("no kind of network")
    if settings.width < 1 or settings.layers < 1:
        raise ValueError("it has no layer")
    square = settings.kind != "fnn" or settings.layers > 1
    if settings.layers > len(arrays) or settings.width ** (1 + square) > sum(a.numel() for a in arrays.values()):
        raise ValueError("its layers are larger than its arrays")
    return settings


def _scales(arrays: dict[str, torch.Tensor]) -> Scales:
    scales = {name: arrays[f"scales.{name}"].double().numpy() for name in _SCALES}
    if {len(scales[name]) for name in ("feature", "mean", "std")} != {len(scales["mean"])}:
        raise ValueError("scales of different lengths")
    return Scales(**scales, **{name: np.empty(0) for name in ("sigma", "score", "noise", "features")})


def _fault(box: BlackBox) -> str:
    """What is wrong with it, in words; "" if nothing."""
    if box.settings.kind not in KINDS or not box.systems or not box.h > 0:
        return "it names no kind of network, or has no member, or no step"
    if any(name not in INPUTS for name in box.actuators):
        return f"{OTHER}: it takes {', '.join(box.actuators)}"
    if not all(torch.isfinite(a).all() for system in box.systems for a in system.state_dict().values()):
        return "some of its numbers are not finite"
    if not all((abs(a) <= LARGEST).all() for system in box.systems for a in system.parameters()):
        return f"some of its weights are larger than {LARGEST:g}"
    return ""

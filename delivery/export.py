"""Writing a product in one of the formats: whole or not at all, over something else only by force."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from importlib import import_module
from pathlib import Path
from typing import Any

from cases.io.files import replaced
from cases.shipfiles.ship_file import dump_ship_json, dump_whole_ship
from delivery.product import Product, product_of
from fitting.report.run_folder import check_place, write_json, write_whole
from mmg.errors import BadValue, Conflict, TargetExists, UnknownName, refusing, writing
from mmg.messages import Message

ABOUT = "product.json"  # In every folder that is delivered: what it is. A folder without it is never replaced.


@dataclass(frozen=True)
class Format:
    """A format: the module and the function in it that write, and what comes of it.

    writer: "module:function", the module in this room, of ``function(product, target, **given, **options)``; it writes
    to ``target``, a folder or a file that exists and is empty, and returns messages on what it wrote, or None.
    suffix: of a file, "" for a folder. given: arguments that make this format of it. options: names of further options
    that the function takes; "replace" says whether what it writes beside its target may take the place of another file.
    """

    writer: str
    suffix: str = ""
    given: Mapping[str, Any] = field(default_factory=dict)
    options: tuple[str, ...] = ()


# The formats of ``mmg export`` by name.
FORMATS: dict[str, Format] = {
    "c": Format("c.source:write_c"),
    "c-tracker": Format("c.tracker:write_c_tracker", options=("coefficients",)),
    "matlab": Format("matlab.package:write_matlab"),
    "toml": Format("export:write_toml", ".toml"),
    "json": Format("export:write_json_ship", ".json"),
    "casadi": Format("graphs.casadi_functions:write_casadi"),
    "onnx": Format("graphs.onnx_network:write_onnx", ".onnx"),
    "shipmmg": Format("dictionaries.shipmmg:write_shipmmg", ".json"),
    "pvs": Format("dictionaries.vehicle_simulator:write_vehicle", ".py"),
    "gazebo": Format("dictionaries.gazebo:write_hull", ".sdf"),
    "fmu": Format("fmi.write:write_fmu", ".fmu", {"version": 2}, ("platforms", "replace")),
    "fmu-tracker": Format("fmi.write:write_fmu_tracker", ".fmu", options=("platforms", "coefficients")),
    "fmu3": Format("fmi.write:write_fmu", ".fmu", {"version": 3}, ("platforms", "replace")),
}


def export(product: Product, form: str, out: str | Path, force: bool = False, **options: Any) -> list[Message]:
    """Write ``product`` in the format ``form``, one of FORMATS, to ``out``: a file or a folder that appears whole.

    force: replace a file, or a folder that an export wrote. options: of the format. Returns what is to be said of what
    was written, besides the caveats of the product. Raises UserError for an unknown format or option, for a target that
    exists or cannot be written, and for what the format cannot hold.
    """
    if form not in FORMATS:
        raise UnknownName(f"--format {form}: no such format; choose one of {', '.join(FORMATS)}")
    if not isinstance(out, (str, Path)):
        raise BadValue(f"out = {out!r}: is no path")
    chosen, target = FORMATS[form], Path(out)
    for name in sorted(set(options) - set(chosen.options)):
        raise Conflict(f"--{name.replace('_', '-')} does not belong to the format {form}")
    check_target(target, chosen, force)
    messages: list[Message] = []
    if "replace" in chosen.options:  # what is written beside the target obeys --force as well
        options["replace"] = force

    module, name = chosen.writer.split(":")
    write = getattr(import_module(f"delivery.{module}"), name)  # imported when first asked for: some are slow

    def fill(place: Path) -> None:
        messages.extend(write(product, place, **chosen.given, **options) or ())
        if not chosen.suffix:
            write_json(place / ABOUT, {"format": form, **product.about()})

    if not chosen.suffix:
        write_whole(target, fill, replace=force)
        return messages
    with writing(target):
        target.parent.mkdir(parents=True, exist_ok=True)
        with replaced(target) as scratch:
            fill(scratch)
    return messages


@refusing
def export_ship(
    where: str | Path, form: str, out: str | Path, force: bool = False, without: Sequence[str] = (), **options: Any
) -> list[Message]:
    """Deliver a calibrated or hybrid ship for use elsewhere, as ``mmg export`` does.

    where: run folder of a calibration or a training, ship file, or ship of the library; form: one of FORMATS, such as
    "fmu", "c" or "onnx"; out: file or folder to write. force: deliver also what did not converge or was never
    calibrated, and replace what exists. without: effects to leave out; options: of the format. Returns the caveats of
    what was written. Raises UserError as ``product_of`` and ``export`` do.
    """
    product = product_of(where, force, without)
    return [*product.caveats, *export(product, form, out, force, **options)]


def check_target(target: Path, chosen: Format, force: bool) -> None:
    """Raises UserError unless ``target`` can come to be, or by ``force`` be replaced. chosen: the format of it."""
    if chosen.suffix and target.suffix.lower() != chosen.suffix:
        raise BadValue(f"--out {target}: the file must end in {chosen.suffix}")
    if target.exists() or target.is_symlink():
        if not (target.is_file() if chosen.suffix else target.is_dir()):
            kind = "ordinary file" if chosen.suffix else "folder"
            raise TargetExists(f"--out {target}: exists and is no {kind}; choose another name")
        if not force:
            raise TargetExists(f"--out {target}: exists already; choose another name or add --force")
        # a folder of other files would be lost whole: not even by force
        if not chosen.suffix and any(target.iterdir()) and not (target / ABOUT).is_file():
            raise TargetExists(f"--out {target}: holds files that mmg export did not write; choose another name")
    check_place(target)


def write_toml(product: Product, target: Path) -> None:
    """Write ``product`` to the ship file ``target``: values, standard errors, verdicts; provenance as comments."""
    source = product.provenance
    origin = f"{product.ship.title}, exported by mmg export from {source['source']}"
    lines = [f"{origin}; std is the standard error of each estimate."]
    if source.get("created"):
        lines.append(f"Calibrated {source['created']} by {source.get('command') or 'mmg'}.")
    for name, (low, high) in product.ranges.items():
        lines.append(f"The trials held {name} from {low:.4g} to {high:.4g} (SI).")
    lines += [f"Mind: {words}." for words in product.caveats]
    target.write_text(dump_whole_ship(product.ship, "\n".join(lines)), encoding="utf-8")


def write_json_ship(product: Product, target: Path) -> None:
    """Write ``product`` as JSON to the file ``target``: every number with its unit, and where the ship comes from."""
    about = {key: value for key, value in product.about().items() if key != "coefficients"}
    target.write_text(dump_ship_json(product.ship, {"product": about}), encoding="utf-8")

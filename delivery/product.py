"""The ship to deliver: its equations, what is known of each coefficient, where it holds, and where it comes from."""

from __future__ import annotations

import hashlib
import re
import shlex
import unicodedata
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields
from functools import cached_property
from pathlib import Path
from typing import Any

from cases.shipfiles.ship_file import load_ship
from cases.simulation.simulate import longest_step
from fitting.report.run_folder import RESULT, SHIP, read_result, versions
from mmg.effects import effect
from mmg.errors import BadValue, NotCalibrated, UnknownName
from mmg.messages import Message
from mmg.model import Model, assemble
from mmg.motion.flow import INPUTS
from mmg.ship import Ship

# Words of C99 and C++11 that no name can be.
RESERVED = frozenset([
    "alignas", "alignof", "and", "asm", "auto", "bool", "break", "case", "catch", "char", "class", "compl", "const",
    "constexpr", "continue", "decltype", "default", "delete", "do", "double", "else", "enum", "explicit", "export",
    "extern", "false", "float", "for", "friend", "goto", "if", "inline", "int", "long", "main", "mutable",
    "namespace", "new", "noexcept", "not", "nullptr", "operator", "or", "private", "protected", "public",
    "register", "restrict", "return", "short", "signed", "sizeof", "static", "struct", "switch", "template", "this",
    "throw", "true", "try", "typedef", "typeid", "typename", "union", "unsigned", "using", "virtual", "void",
    "volatile", "wchar_t", "while", "xor",
])  # fmt: skip
# Codes of what is said of a product.
NAME_CHANGED, UNCALIBRATED, NOT_CONVERGED = "name_changed", "uncalibrated", "not_converged"
PLACE, LEFT_OUT, NO_RANGE, UNEXCITED = "belongs_to_the_place", "left_out", "range_unknown", "not_excited"
SHOWN = 12  # Digits of a hash that a sentence shows. Set by hand: display.
# States, inputs and ranges: words and unit. All other states are what an effect or an actuator remembers.
QUANTITIES = {
    "x": ("position of midship, north", "m"),
    "y": ("position of midship, east", "m"),
    "psi": ("heading, clockwise from north, continuous", "rad"),
    "u": ("velocity over ground of midship, forward", "m/s"),
    "v": ("velocity over ground of midship, to starboard", "m/s"),
    "r": ("yaw rate, clockwise", "rad/s"),
    "phi": ("roll angle", "rad"),
    "p": ("roll rate", "rad/s"),
    **INPUTS,
    "wind_north": ("velocity of the air over ground, to the north", "m/s"),
    "wind_east": ("velocity of the air over ground, to the east", "m/s"),
    "time": ("time, for effects that change with it", "s"),
    "a_x": ("velocity of the air relative to the hull, forward", "m/s"),
    "a_y": ("velocity of the air relative to the hull, to starboard", "m/s"),
    "beta": ("drift angle", "rad"),
}


@dataclass(frozen=True)
class ProductCoefficient:
    """A coefficient as it is delivered: a plain name for code beside its symbol; ``std`` None where it is not known.

    identifier: of letters, digits and underscores, distinct within a product. verdict: how well the trials determine
    it, "" before a calibration.
    """

    symbol: str
    identifier: str
    value: float
    std: float | None
    unit: str
    lower: float
    upper: float
    fixed: bool
    verdict: str
    description: str
    source: str


@dataclass(frozen=True, eq=False)
class Product:
    """A ship that is to be delivered.

    ship: plain, hybrid, with effects, as delivered. identifier: its name as a C identifier in lower case. ranges:
    quantity (``ship.features`` and "beta") -> its range in the trials (lower, upper), SI; empty where none is known.
    provenance: hashes of the run and of its data, when and by which command it was made, versions, as plain
    values; never a path, so that a run gives the same product wherever it lies. caveats: what a user of the product
    must know, each with a code. random_force: its sizes as the calibration estimated them, as in result.json.
    """

    ship: Ship
    identifier: str
    ranges: Mapping[str, tuple[float, float]]
    provenance: Mapping[str, Any]
    caveats: tuple[Message, ...]
    random_force: Mapping[str, float] = field(default_factory=dict, kw_only=True)

    @cached_property
    def model(self) -> Model:
        """Its right-hand side, all coefficients as arguments; that of a hybrid with its network."""
        return self.model_of(self.ship)

    def model_of(self, ship: Ship) -> Model:
        """The right-hand side of ``ship``, this one or its form without network, as it is delivered."""
        return assemble(ship)

    @property
    def coefficients(self) -> tuple[ProductCoefficient, ...]:
        """Its coefficients in the order of the model's argument."""
        coefficients = self.ship.coefficients.values()
        same = [f.name for f in fields(ProductCoefficient) if f.name not in ("identifier", "std")]
        return tuple(
            ProductCoefficient(
                **{key: getattr(c, key) for key in same},
                identifier=name,
                std=c.std if c.std > 0 and not c.fixed else None,  # what is fixed was not estimated
            )
            for c, name in zip(coefficients, identifiers([c.symbol for c in coefficients]), strict=True)
        )

    @property
    def longest_step(self) -> float:
        """The longest Runge-Kutta step [s]; longer samples are divided, as in ``mmg simulate``."""
        return longest_step(self.ship)

    @property
    def slow_squared(self) -> float:
        """u^2 + v^2 [m^2/s^2] below which the drift angle has no meaning: that of a tenth of the trials' speed."""
        # a tenth: set by hand; 0 where no range is known
        return float((0.1 * max(map(abs, self.ranges.get("u", (0.0,))))) ** 2)

    @property
    def sentences(self) -> list[str]:
        """What it is, where it comes from, and its caveats."""
        ship, source = self.ship, self.provenance
        parts = ", ".join(f"{role} {name}" for role, name in ship.components.items())
        lines = [f"Ship {ship.title}: {parts}."]
        if ship.effects:
            lines.append(f"Effects: {', '.join(ship.effects)}.")
        if ship.network is not None:
            lines.append(f"Hybrid: a residual network of {len(ship.network.members)} member(s) adds accelerations.")
        made = f", made {source['created']}" if source.get("created") else ""
        lines.append(f"Exported by mmg export from {source['source']} ({source['kind']}{made}).")
        if source.get("data"):
            hashes = sorted(str(row["sha256"]) for row in source["data"])  # the same data in any order are one
            together = hashlib.sha256("\n".join(hashes).encode()).hexdigest()[:SHOWN]
            lines.append(f"Calibrated on {', '.join(str(row['name']) for row in source['data'])} (data {together}).")
        return lines + [f"Caveat: {caveat}." for caveat in self.caveats]

    def about(self) -> dict[str, Any]:
        """What is said of it in a file beside the product: names, ranges, provenance, caveats; plain values."""
        return {
            "ship": self.ship.called,
            "title": self.ship.title,
            "calibration": vars(self.ship.mark) if self.ship.mark else None,
            "identifier": self.identifier,
            "components": dict(self.ship.components),
            "effects": list(self.ship.effects),
            "hybrid": self.ship.network is not None,
            "longest_step_s": self.longest_step,
            "coefficients": {c.symbol: vars(c) for c in self.coefficients},
            "range_of_the_trials": {name: list(pair) for name, pair in self.ranges.items()},
            "provenance": dict(self.provenance),
            "caveats": [{"code": m.code, "text": str(m)} for m in self.caveats],
        }


def product_of(where: str | Path, force: bool = False, without: Sequence[str] = ()) -> Product:
    """The product of a run folder of fit or train, of a ship file, or of a ship of the library.

    where: as ``load_ship`` takes it. force: deliver what did not converge or was never calibrated, and say so in its
    caveats. without: effects to leave out. Raises UserError for a ship that cannot be read, for one that only leaves
    by force, and for an effect that it does not have.
    """
    if not isinstance(where, (str, Path)):
        raise BadValue(f"{type(where).__name__} is no run folder, ship file or name of a ship; save() a result first")
    path = Path(where)
    folder = path if path.is_dir() else path.parent  # of a run, or of the ship.toml in it
    is_run = (path.is_dir() or path.name == SHIP) and (folder / RESULT).is_file()
    place = folder if is_run else None
    content = read_result(place) if place else {}
    content = {**(content.get("calibration") or {}), **content}  # of a hybrid: what her calibration knows, too
    ship = load_ship(place or where)
    caveats = _blocking(ship, content)
    if caveats and not force:
        raise NotCalibrated(f"{where}: {caveats[0]}; calibrate it with mmg fit, or export it as it is with --force")
    for name in without:
        if name not in ship.effects:
            effect_names = ", ".join(ship.effects) or "none"
            raise UnknownName(f"--without {name}: the ship has no such effect; it has {effect_names}")
        ship = ship.without_effect(name)
        caveats.append(Message(f"the effect {name} of the calibrated ship is left out", LEFT_OUT))
    for name in ship.effects:
        if effect(name).surroundings:
            words = f"the effect {name} belongs to the place and the days of the trials; set it to zero elsewhere"
            caveats.append(Message(words, PLACE))
    identifier = identifiers([ship.name or "ship"])[0].lower()
    if identifier != ship.name:
        words = f"the ship's name '{ship.name}' is no lower-case identifier: names in the code begin with {identifier}"
        caveats.append(Message(words, NAME_CHANGED))
    envelope = content.get("envelope") or {}
    ranges = {quantity: (float(low), float(high)) for quantity, (low, high) in envelope.items()}
    if not ranges:
        words = "no record of the range of the trials, so nothing can say when the ship extrapolates"
        caveats.append(Message(words, NO_RANGE))
    rows = (content.get("identifiability") or {}).get("coefficients") or {}
    if silent := [symbol for symbol, row in rows.items() if row["kind"] == "silent"]:
        words = f"{len(silent)} of {len(rows)} free coefficients are not excited by the trials and stand at their prior"
        caveats.append(Message(f"{words}: {', '.join(silent)}", UNEXCITED))
    origin, force_sizes = _provenance(Path(where), place, content), content.get("random_force") or {}
    return Product(ship, identifier, ranges, origin, tuple(caveats), random_force=force_sizes)


def filled(template: Path, product: Product, markup: bool = False, **words: Any) -> str:
    """The file ``template`` for a ``product``, filled with ``words`` by jinja; SHIP is its identifier, UPPER that in
    capitals. Its title, caveats, numbers of states, inputs, coefficients and roles are always among the words.
    markup: whether it is XML or HTML, in which words are escaped."""
    from jinja2 import Environment, StrictUndefined

    model, p = product.model, product.identifier
    words |= {
        "S": len(model.states), "C": len(model.controls), "P": len(model.symbols), "R": len(model.roles),
        "LONGEST_STEP": product.longest_step, "TITLE": product.ship.title,
        "CAVEATS": "".join(f"* {caveat}\n" for caveat in product.caveats) or "* none\n",
    }  # fmt: skip
    # by plain text, so that a template reads as C, and before jinja: words that are filled in may hold SHIP
    text = template.read_text(encoding="utf-8").replace("SHIP", p).replace("UPPER", p.upper())
    settings = Environment(
        undefined=StrictUndefined, autoescape=markup, keep_trailing_newline=True, trim_blocks=True, lstrip_blocks=True
    )
    return settings.from_string(text).render(words)


# Exponents of the units that a ship file may name, alone or as products; FMI has the radian as a base unit.
BASES = {"kg": {"kg": 1}, "m": {"m": 1}, "s": {"s": 1}, "rad": {"rad": 1}, "N": {"kg": 1, "m": 1, "s": -2}}
_PLAIN = str.maketrans({"²": "2", "³": "3", "^": "", "·": "."})


def unit_of(name: str) -> str:
    """SI unit of the state, input or range ``name``, "" where none is stated."""
    return plain_unit(QUANTITIES.get(name, ("", ""))[1])


def plain_unit(unit: str) -> str:
    """Name of the ``unit`` of a ship file as FMI has it: "rps" becomes "1/s", "m²" "m2"; "" stays."""
    return "1/s" if unit == "rps" else unit.translate(_PLAIN)


def exponents(unit: str) -> dict[str, int] | None:
    """Exponents of a plain ``unit`` in kg, m, s and rad, zeros left out; None for one that is not made of BASES."""
    powers: dict[str, int] = {}
    for place, part in enumerate(unit.split("/")):
        for word in re.split(r"[. ]+", part):
            if word in ("", "1", "-"):  # of 1/s, and of pure numbers
                continue
            match = re.fullmatch(r"([A-Za-z]+)(-?\d*)", word)
            if match is None or match[1] not in BASES:
                return None
            power = int(match[2] or 1) * (1 if place == 0 else -1)  # all that stands behind a stroke divides
            for base, n in BASES[match[1]].items():
                powers[base] = powers.get(base, 0) + n * power
    return {base: n for base, n in powers.items() if n}


def identifiers(names: Sequence[str]) -> list[str]:
    """C identifiers made of ``names``, distinct: other characters become underscores, reserved words get one more."""
    made: list[str] = []
    for name in names:
        # accents are split from their letters and dropped with all else that is not ASCII
        plain = unicodedata.normalize("NFKD", name).encode("ascii", "ignore").decode()
        word = re.sub(r"\W+", "_", plain, flags=re.ASCII).strip("_") or "ship"
        word = f"ship_{word}" if word[0].isdigit() else word
        word = f"{word}_" if word.lower() in RESERVED else word
        # by lower case: macros, and files on some systems, do not tell capitals apart
        taken, stem, count = {w.lower() for w in made}, word, 2
        while word.lower() in taken:
            word, count = f"{stem}_{count}", count + 1
        made.append(word)
    return made


def _blocking(ship: Ship, content: Mapping[str, Any]) -> list[Message]:
    """What keeps a ship from leaving unless by force."""
    if content.get("converged") is False:
        return [Message(f"its calibration did not converge ({content.get('status')})", NOT_CONVERGED)]
    if not content and not any(c.verdict for c in ship.coefficients.values()):
        return [Message(f"the ship {ship.name} is not calibrated on trials", UNCALIBRATED)]
    return []


def _provenance(where: Path, place: Path | None, content: Mapping[str, Any]) -> dict[str, Any]:
    """Where a product comes from, as plain values that do not depend on the place of the run or of the ship file."""
    rows, command = content.get("data"), content.get("command")
    data = [{k: row.get(k) for k in ("name", "sha256", "duration_s")} for row in rows] if isinstance(rows, list) else []
    file = place / SHIP if place else where if where.is_file() else None
    origin: dict[str, Any] = {"source": "the library of ships" if file is None else f"ship file {_hash(file)[:SHOWN]}"}
    if place:
        origin = {"source": f"run {_hash(place / RESULT)[:SHOWN]}", "result_sha256": _hash(place / RESULT)}
    return {
        **origin,
        "ship_sha256": _hash(file) if file else None,
        "kind": content.get("kind", "ship file" if file else "library"),
        "created": content.get("created"),
        "command": _without_folders(command) if isinstance(command, str) else None,
        "versions_of_the_run": content.get("versions", {}),
        "versions_of_the_export": versions(),
        "data": data,
    }


def _hash(file: Path) -> str:
    """SHA-256 of a file."""
    return hashlib.sha256(file.read_bytes()).hexdigest()


def _without_folders(command: str) -> str:
    """A command whose paths have lost their folders, which say where things lay and nothing of the ship."""
    try:
        words = shlex.split(command)
    except ValueError:  # a quote that is not closed
        words = command.split()
    return shlex.join(re.split(r"[/\\]", word.rstrip("/\\"))[-1] or word for word in words)

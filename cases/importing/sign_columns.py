"""Columns of words that give numbers of another one their sign: hemispheres, ahead and astern, the rudder's side."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from cases.importing.bad_values import without_sentinels
from cases.importing.import_map import ColumnMap, ImportMap
from cases.importing.raw_table import RawTable
from cases.importing.vocabulary import NOT_USED, SIDES, plain_words
from mmg.errors import UserError


class Kind(NamedTuple):
    """Quantities (a pattern), words of positive and of negative ones, and whether a header has to name the quantity."""

    quantities: str
    plus: tuple[str, ...]
    minus: tuple[str, ...]
    named: bool = False


HEMISPHERES = (Kind("latitude", ("n", "north"), ("s", "south")), Kind("longitude", ("e", "east"), ("w", "west")))
AHEAD = Kind(
    r"n(_2)?|n_azimuth(_\d)?",
    ("ahead", "ahd", "fwd", "forward", "forwards", "+"),
    ("astern", "ast", "aft", "rev", "reverse", "reversed", "back", "backward", "backwards", "bwd", "-"),
)
SIDE = Kind(r"delta.*|n_bow|n_stern", ("starboard", "stbd", "stb", "sb", "right"), ("port", "ps", "left"), named=True)
KINDS = (*HEMISPHERES, AHEAD, SIDE)
NEITHER = ("stop", "stopped", "neutral", "zero", "off", "midships", "0")
"""Words of what rests; its numbers are zero or nearly so."""
DIRECTION = (
    r".*(shaft|prop|engine|screw|gear|thruster|rudder|rpm).*_(dir\w*|sense|side|sign|ahead|astern|rev|revers\w*)"
)
"""A header of the direction of revolutions or of a rudder, whatever its words."""
ORDERS = rf"{NOT_USED}|(.*_)?(telegraph|eot|lever)(_.*)?"
"""Headers of orders, which say astern before the shaft turns so."""
MOST_WORDS = 8
"""Columns with more different cells hold no directions."""


def sign_columns(
    table: RawTable, mapped: Mapping[str, ColumnMap], headers: Sequence[str], chosen: ImportMap
) -> dict[str, ColumnMap]:
    """Quantity with "_sign" behind it -> the column of the ``table`` whose words are the signs of its numbers.

    mapped: the columns that are known; headers: those that ``hold_signs``; chosen: the map. Only numbers of which
    none is negative lack a sign. Raises UserError where two columns hold it, where only an order does, and where the
    words of a column whose header is a direction are not known.
    """
    found: dict[str, ColumnMap] = {}
    orders: dict[str, str] = {}
    for header in headers:
        title, words = plain_words(header), _words(table.cells(header))
        kind = _kind(title, words)
        assert kind is not None
        reads = _reads(kind, title)
        known = words <= set(reads) and not (words <= {"0", "1"} and reads["1"] == 1)
        if not known and (len(words) < 2 or not re.fullmatch(DIRECTION, title)):
            continue
        for quantity in _targets(kind, title, table, mapped, chosen):
            own = mapped[quantity].header
            if not known:
                raise _open(table, own, header, f"holds {', '.join(sorted(words)[:4])}, of which the sign is not known")
            negative = any(reads[word] < 0 for word in words)
            if re.fullmatch(ORDERS, title):
                orders |= {quantity: header} if negative else {}
            elif f"{quantity}_sign" not in found:
                found[f"{quantity}_sign"] = ColumnMap.model_validate({"from": header})
            elif negative:
                other = found[f"{quantity}_sign"].header
                raise _open(table, own, header, f"holds its sign as '{other}' does")
    for quantity, header in orders.items():
        if f"{quantity}_sign" not in {*found, *mapped}:
            raise _open(table, mapped[quantity].header, header, "holds orders, not what the shaft does")
    return {name: column for name, column in found.items() if name not in mapped}


def hold_signs(table: RawTable, header: str) -> bool:
    """Whether the cells below ``header`` in the ``table`` hold words of a direction, or its title promises them."""
    has_unit = bool(table.units[table.headers.index(header)])
    return not has_unit and _kind(plain_words(header), _words(table.cells(header))) is not None


def signed(values: np.ndarray, quantity: str, table: RawTable, header: str, chosen: ImportMap) -> np.ndarray:
    """The ``values`` (N,) of a ``quantity`` with the signs in the column ``header`` of its ``table``.

    chosen: the map, which says the side of positive rudder angles. Raises UserError for a word that is no sign.
    """
    kind = next(kind for kind in KINDS if re.fullmatch(kind.quantities, quantity))
    reads = {"": 1, **_reads(kind, plain_words(header))}
    words = [_word(cell) for cell in table.cells(header)]
    unknown = [i for i, word in enumerate(words) if word not in reads]
    if unknown:
        row = table.before + unknown[0] + 1
        raise UserError(f"{table.name}: row {row}, column '{header}': '{words[unknown[0]]}' is no sign of {quantity}")
    sign = np.array([reads[word] for word in words])
    out = np.where(sign < 0, -np.abs(values), values)
    return -out if quantity.startswith("delta") and chosen.rudder_positive == "port" else out


def _open(table: RawTable, own: str, header: str, why: str) -> UserError:
    return UserError(
        f"{table.name}: the numbers of '{own}' have no sign, and column '{header}' {why}; write the sign into '{own}', "
        f'or say in the map that the column is not used: ignore = ["{header}"]'
    )


def _kind(title: str, words: set[str]) -> Kind | None:
    """What the ``words`` of a column are, or else those that its ``title`` promises."""
    by_words = next((kind for kind in KINDS if words & {*kind.plus, *kind.minus}), None)
    if by_words or not re.fullmatch(DIRECTION, title) or not words:
        return by_words
    return SIDE if re.search("rudder|thruster", title) else AHEAD


def _reads(kind: Kind, title: str) -> dict[str, int]:
    """Word -> sign. A column that is called astern or reverse holds whether it is so."""
    astern = re.search("astern|rev", title) and "ahead" not in title
    return {
        **dict.fromkeys((*kind.plus, *NEITHER, "false", "no"), 1),
        **dict.fromkeys((*kind.minus, "-1", *(("true", "yes") if astern else ())), -1),
        "1": -1 if astern else 1,
    }


def _targets(kind: Kind, title: str, table: RawTable, mapped: Mapping[str, ColumnMap], chosen: ImportMap) -> list[str]:
    """The quantities without a sign whose headers share most words with the ``title`` of a column of signs."""
    own = _stems(title)
    shared = {
        q: len(own & _stems(plain_words(c.header))) for q, c in mapped.items() if re.fullmatch(kind.quantities, q)
    }
    best = max(shared.values(), default=0)
    near = [q for q, count in shared.items() if count == best and (best or not kind.named)]
    return [q for q in near if _positive(table, mapped[q].header, chosen)]


def _stems(title: str) -> set[str]:
    return {SIDES.get(word, word) for word in title.split("_")}


def _positive(table: RawTable, header: str, chosen: ImportMap) -> bool:
    """Whether no number below ``header`` is negative, without those that stand for nothing."""
    if header not in table.headers or not table.numeric(header):
        return False
    values, _ = without_sentinels(table.numbers(header), header, chosen.sentinels)
    return bool(np.nanmin(values, initial=np.inf) >= 0)


def _words(cells: Any) -> set[str]:
    """The different words of ``cells``, none where there are too many."""
    different = cells.dropna().unique()
    return {_word(cell) for cell in different} - {""} if len(different) <= 2 * MOST_WORDS else set()


def _word(cell: Any) -> str:
    if cell is None or cell != cell:
        return ""
    try:
        return f"{float(cell):g}"
    except (TypeError, ValueError):
        return str(cell).strip().lower()

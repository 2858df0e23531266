"""A raw table as a log: its clock, and its columns as quantities in SI units, each accounted for."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from cases.importing.clocks import check_clock, check_forward, clock_of, mixed_zones, within_stamps, without_jumps
from cases.importing.companions import Masks, hold_signs, masked_rows, masks_of, sided, sign_columns, signed
from cases.importing.import_map import ColumnMap, ImportMap, OpenQuestion, Question
from cases.importing.raw_table import NUMBERED, Account, Clock, RawTable, split_unit
from cases.importing.vocabulary import (
    EITHER_SIDE,
    WATER,
    factor,
    is_order,
    known_units,
    meaning,
    ordered,
    plain_words,
    turn_in,
)
from cases.io.conventions import remarks, sentinels_in, without_dropouts
from cases.io.text_table import BlockMeans, rows_together
from cases.quantities import ORDERS, QUANTITIES, wraps
from cases.quantities import quantity as known
from mmg.errors import BadValue, Conflict, Missing, TooFewData
from mmg.messages import Message

# A header of a motion of the hull, beside which a column called pitch is another.
HULL = r"(?:^|[^a-z])(?:roll|heave|yaw)(?![a-z])(?!.*(?:rate|vel|speed|moment))"
PITCH = "pitch (of the propeller's blades) or nothing (of the hull)"
# Quantities that complete others, or are words.
TEXT = ("ship", "zone", "date", *(name for name in QUANTITIES if name.endswith("_sign") or name.startswith("t_")))
# What is added to the heading of a compass [deg], positive to the east.
OF_COMPASS = ("variation", "deviation")
# Words of columns that together are a clock.
PARTS = {"t_year": "years?|yr|yyyy", "t_month": "months?|mon", "t_day": "days?|dd", "t_hour": "hours?|hr|hh|h",
         "t_minute": "minutes?|mins?|mi", "t": "seconds?|secs?|ss|s"}  # fmt: skip
# A unit of directions with what they are counted from.
REFERENCE = r"(deg|°|degrees?)?[\s_]*\(?(m|mag|magn?etic|t|true|r|rel|relative)\)?"


@dataclass(frozen=True)
class Log:
    """One table of a log whose columns are known.

    table: as read, without its cells; t: (N,) seconds, increasing; absolute: since 1970 in UTC; columns: quantity ->
    (N,) in the units of the registry; of: quantity -> how it is mapped; unitless: quantities whose unit is not known
    yet; unknown: headers that nobody knows; unsure: header -> what it may be; ship, zone: words that it names, or "";
    accounts: of every column of the table; zoned: whether its stamps name a time zone.
    """

    table: RawTable
    t: np.ndarray
    absolute: bool
    columns: dict[str, np.ndarray]
    of: dict[str, ColumnMap]
    unitless: tuple[str, ...] = ()
    unknown: tuple[str, ...] = ()
    unsure: dict[str, str] = field(default_factory=dict)
    ship: str = ""
    zone: str = ""
    notices: tuple[Message, ...] = ()
    accounts: tuple[Account, ...] = ()
    zoned: bool = False

    @property
    def name(self) -> str:
        """The name of its table, for messages."""
        return self.table.name

    @property
    def dt(self) -> float:
        """Median time between rows [s]."""
        return float(np.median(np.diff(self.t)))

    def step(self, quantity: str) -> float:
        """Median time between rows that hold the ``quantity`` [s], which may be logged less often than others."""
        t = self.t[np.isfinite(self.columns[quantity])]
        return float(np.median(np.diff(t))) if len(t) > 1 else np.inf

    def unit_question(self, quantity: str) -> Question:
        """In which unit the ``quantity`` is."""
        header, choices = self.of[quantity].header, dict[str, dict[str, Any]]()
        for unit in known_units(quantity):
            choices[unit] = {"columns": {quantity: {"from": header, "unit": unit}}}
        choices["nothing"] = {"ignore": [header]}
        return Question(self.table.path, f"'{header}' ({quantity}) has no unit", choices)

    def with_unit(self, quantity: str, unit: str, why: str) -> Log:
        """A copy in which ``quantity``, of unknown unit, has this ``unit``. why: what shows it."""
        scale = factor(quantity, unit)
        assert scale is not None
        said = Message(f"{quantity} from '{self.of[quantity].header}' is in {unit}: {why}", "unit_found")
        return replace(
            self,
            columns={**self.columns, quantity: self.columns[quantity] * scale},
            of={**self.of, quantity: self.of[quantity].model_copy(update={"unit": unit})},
            unitless=tuple(q for q in self.unitless if q != quantity),
            notices=(*self.notices, said),
        )


@dataclass
class Assigned:
    """What the columns of a table are. mapped: quantity -> its column; unknown: headers that nobody knows; unsure:
    header -> what it may be; account: header -> the quantities that others get from it, and why it is not used."""

    mapped: dict[str, ColumnMap] = field(default_factory=dict)
    unknown: list[str] = field(default_factory=list)
    unsure: dict[str, str] = field(default_factory=dict)
    account: dict[str, tuple[tuple[str, ...], str]] = field(default_factory=dict)
    masks: Masks = field(default_factory=lambda: Masks({}, {}, {}))

    def accounts(self, table: RawTable) -> tuple[Account, ...]:
        """A line for each column of the ``table``."""
        used: dict[str, list[str]] = {}
        for quantity, column in self.mapped.items():
            used.setdefault(column.header, []).append(quantity)
        out = []
        for header in table.headers:
            names, why = self.masks.account.get(header, self.account.get(header, ((), "")))
            why = f"it may be {self.unsure[header]}" if header in self.unsure else why
            used_as = tuple(used.get(header, names))
            why = why or ("" if used_as else "its words are not known")
            out.append(Account(header, table.rows or len(table), used_as, why))
        return tuple(out)


def log_of(table: RawTable, chosen: ImportMap) -> Log:
    """The log in ``table``, by the map ``chosen`` and, where it says nothing, the words of the headers; of one that is
    longer than MOST_KEPT rows, means of them. Raises UserError for headers of the map that are absent, two columns of
    one quantity, no clock or two of them, a clock that runs backwards, text in numbers, and a unit that does not belong
    to its quantity."""
    of, notices = assigned(table, chosen), list(table.notices)
    mapped = of.mapped
    scales, unitless = _scales(table, mapped, chosen, notices)
    count, nothing = rows_together(table.rows), Counter[tuple[str, float]]()
    means = BlockMeans(count, {q: known(q).period for q in scales if known(q).period})
    words: dict[str, set[str]] = {"ship": set(), "zone": set()}
    clock, anew, end, lost = None, 0.0, -np.inf, Counter[str]()
    for piece in table.pieces([*(column.header for column in mapped.values()), *of.masks.headers]):
        if not piece.cells(mapped["t"].header).notna().any():
            continue
        time = table.clock or _clock(piece, mapped, chosen)
        clock = clock or time
        if time.absolute != clock.absolute:
            raise BadValue(f"{table.name}: column '{time.header}' changes its kind of time after row {piece.before}")
        if time.zoned != clock.zoned:
            raise mixed_zones(f"{table.name}: column '{time.header}'", piece.before + 1)
        columns = {q: _values(piece, q, mapped, chosen, nothing) * scale for q, scale in scales.items()}
        for q in columns:
            holds = masked_rows(piece, q, of.masks)
            lost[q] += int((~holds & np.isfinite(columns[q])).sum())
            columns[q] = np.where(holds, columns[q], np.nan)
        step = np.diff(time.t[np.isfinite(time.t)])
        if table.source is None and len(step) > 10 and (step <= 0).all() and (step < 0).any():
            time, columns = replace(time, t=time.t[::-1]), {q: values[::-1] for q, values in columns.items()}
            notices.append(Message("the rows are sorted newest first, and turned round", "newest_first"))
        if time.period and np.nanmin(time.t) + anew < end - 0.5 * time.period:  # it began anew between two pieces
            anew += time.period
        # Jumps that are known are mended first, so that what still runs backwards is wrong.
        states = {q: values for q, values in columns.items() if q in STATES}
        time, jumps = without_jumps(replace(time, t=time.t + anew), states, end)
        check_forward(time, table.name, piece.before, end)
        end = float(np.nanmax(time.t))
        if count > 1 and {"latitude", "longitude"} <= set(columns):  # no lost satellite is averaged
            none = (columns["latitude"] == 0) & (columns["longitude"] == 0)
            columns |= {q: np.where(none, np.nan, columns[q]) for q in ("latitude", "longitude")}
        if not means.rows:  # without units, the first rows tell which turn directions have
            means.periods |= {q: turn_in(q, "", _largest(columns[q])) for q in unitless if known(q).period}
        t, columns, said = _rows(time.t, columns, means.periods)
        means.add({"t": t, **columns})
        notices += [m for m in (*piece.notices, *jumps, *said) if m.code not in {n.code for n in notices}]
        for name in words.keys() & mapped.keys():
            words[name] |= {str(cell).strip().removesuffix(".0") for cell in piece.cells(mapped[name].header).dropna()}
    columns = means.columns()
    if clock is None or not columns:
        raise TooFewData(f"{table.name}: column '{mapped['t'].header}' holds fewer than two times")
    t = columns.pop("t")
    notices += [*check_clock(replace(clock, t=t), table.name), *remarks(nothing)]
    why = "rows do not hold, by their status, reference or source"
    notices += [Message(f"{q}: {number} {why}", "masked") for q, number in lost.items() if number]
    if count > 1:
        kept = f"{table.rows} rows averaged by {count}: {len(t)} of {np.median(np.diff(t)):.4g} s are kept"
        notices.append(Message(kept, "rows_averaged"))
    _check_globe(table, columns, mapped)
    for name, several in words.items():
        if len(several) > 1:
            what = "ships" if name == "ship" else "UTM zones"
            raise Conflict(f"{table.name}: rows of several {what} ({', '.join(sorted(several)[:4])}); divide the file")
    if "heading_magnetic" in columns:
        notices.append(_true_heading(table, columns, mapped, chosen))
        unitless = [q for q in unitless if q in columns]
    said_of = chosen.of(table.path)
    t = t + said_of.clock_offset + said_of.clock_drift * (t - t[0])
    # Zeros and lost satellites go first: between them a channel that stands still would not be seen to jump.
    columns, zeros = without_dropouts(columns, STATES)
    notices += remarks(zeros)
    columns, said = lost_satellites(columns)
    columns, frozen = stands_still(t, columns)
    notices += [*said, *frozen]
    return Log(
        replace(table, frame=table.frame.iloc[:0].copy(), clock=None, source=None),  # without its cells
        t, clock.absolute, columns, mapped, tuple(unitless), tuple(of.unknown), of.unsure,
        "".join(words["ship"]) or table.ship, "".join(words["zone"]), tuple(notices),
        table.accounts or of.accounts(table), clock.zoned,
    )  # fmt: skip


def _scales(
    table: RawTable, mapped: dict[str, ColumnMap], chosen: ImportMap, notices: list[Message]
) -> tuple[dict[str, float], list[str]]:
    """Factor by which each ``mapped`` quantity of a ``table`` is multiplied, and those of unknown unit. Units are
    noted in ``mapped``, what is said of them and of signs in ``notices``. chosen: the map. Raises UserError for one
    that is unknown."""
    scales: dict[str, float] = {}
    unitless = []
    for quantity in [q for q in mapped if q != "t" and q not in TEXT]:
        column = mapped[quantity]
        unit = unit_in(table, quantity, column)
        scale = factor(quantity, unit) if unit else None
        if unit and scale is None and known(quantity).unit:
            words = f"unknown unit '{unit}' for {quantity}; known: {', '.join(known_units(quantity))}"
            choices = {"nothing": {"ignore": [column.header]}}
            raise OpenQuestion(table.path, f"column '{column.header}': {words}", choices)
        if scale is None and known(quantity).unit:
            unitless.append(quantity)
        if f"{quantity}_sign" in mapped:
            notices.append(Message(f"{quantity}: the sign is that of '{mapped[f'{quantity}_sign'].header}'", "sign"))
        if sided(table, quantity, column.header, chosen) is not None:
            words = f"{quantity}: port (negative) and starboard (positive) are said in the cells of '{column.header}'"
            notices.append(Message(words, "sign"))
        scales[quantity] = column.sign * (scale or 1.0)
        mapped[quantity] = column.model_copy(update={"unit": unit})
    for name in ("latitude", "longitude"):
        if name in mapped and mapped[name].unit == "ddmm":
            notices.append(Message(f"{name}: degrees and minutes in one number (ddmm.mm)", "degrees_minutes"))
    return scales, unitless


def _clock(piece: RawTable, mapped: dict[str, ColumnMap], chosen: ImportMap) -> Clock:
    time_columns = {name: column.header for name, column in mapped.items() if name == "date" or name.startswith("t_")}
    return clock_of(piece, mapped["t"].header, mapped["t"].unit, time_columns, chosen.zone_hours)


def _true_heading(
    table: RawTable, columns: dict[str, np.ndarray], mapped: dict[str, ColumnMap], chosen: ImportMap
) -> Message:
    """The magnetic heading among the ``columns`` becomes a true one. Raises UserError without a variation."""
    heading, header = columns.pop("heading_magnetic"), mapped["heading_magnetic"].header
    variation, words = columns.pop("variation", None), "of the log"
    if chosen.variation is not None:
        variation, words = np.radians(chosen.variation), f"{chosen.variation:g} deg of the map"
    if variation is None:
        need = "give variation = ... in the map [deg, positive to the east]"
        raise Missing(f"{table.name}: the log has a magnetic heading ({header}): {need}")
    if "deviation" in columns:
        header += f"', the deviation '{mapped['deviation'].header}"
    columns["psi"] = heading + variation + columns.pop("deviation", 0.0)
    return Message(f"psi is the magnetic heading '{header}' and the variation {words}", "magnetic")


def _values(
    piece: RawTable, quantity: str, mapped: dict[str, ColumnMap], chosen: ImportMap, nothing: Counter[tuple[str, float]]
) -> np.ndarray:
    """The ``quantity`` in a ``piece`` (N,) in the unit of the file, with its signs, NaN where a number stands for
    nothing: these are counted in ``nothing``, by header and number, and known from piece to piece."""
    column = mapped[quantity]
    sides = sided(piece, quantity, column.header, chosen)
    values = _numbers(piece, quantity, column) if sides is None else sides
    values = np.where(np.isfinite(values), values, np.nan)
    huge = np.abs(values) > LARGEST
    if huge.any():
        nothing[column.header, LARGEST] += int(huge.sum())
        values[huge] = np.nan
    before = [number for header, number in nothing if header == column.header]
    for number, rows in sentinels_in(values, [*chosen.sentinels, *before]).items():
        nothing[column.header, number] += int(rows.sum())
        values[rows] = np.nan
    if column.unit == "ddmm":  # after sentinels, which are no degrees and minutes
        values = np.sign(values) * (np.abs(values) // 100 + np.abs(values) % 100 / 60)
    for part, size in (("min", 60.0), ("s", 3600.0)):
        if f"{quantity}_{part}" in mapped:
            values = values + np.copysign(piece.numbers(mapped[f"{quantity}_{part}"].header), values) / size
    sign = mapped.get(f"{quantity}_sign")
    return signed(values, quantity, piece, sign.header, chosen) if sign else values


def _largest(values: np.ndarray) -> float:
    return float(np.nanmax(np.abs(values), initial=0.0))


def assigned(table: RawTable, chosen: ImportMap) -> Assigned:
    """What the columns of the ``table`` are, by the map ``chosen`` and the words of the headers. Raises UserError for a
    header of the map that is absent, two columns of one quantity, and no clock."""
    of = Assigned()
    mapped = of.mapped
    for quantity, column in chosen.columns_of(table.path).items():
        bare = split_unit(column.header)[0]
        if column.header not in table.headers and bare in table.headers:  # the cell as it is in the file
            column = column.model_copy(update={"header": bare})
        if column.header in table.headers:
            mapped[quantity] = column
        elif quantity in chosen.of(table.path).columns:  # else of another file
            words = f"column '{column.header}' of the map is absent; found: {', '.join(table.headers)}"
            raise Missing(f"{table.name}: {words}")
    of.account |= {split_unit(cell)[0]: ((), "the map says so") for cell in chosen.ignored_in(table.path)}
    _clock_parts(table, mapped, of.account)
    taken = {column.header for column in mapped.values()}
    of_the_hull = any(re.search(HULL, other.lower()) for other in table.headers)
    unassigned = [h for h in table.headers if h not in taken and h not in of.account]
    signs = [h for h in unassigned if hold_signs(table, h)]
    for header in [h for h in unassigned if h not in signs]:
        means, unit = table.means.get(header) or meaning(header), ""
        reference = re.fullmatch(REFERENCE, table.units[table.headers.index(header)].strip().lower())
        # "HDG [M]": the letter in the place of the unit is a word of the header.
        if reference and (referred := meaning(f"{header} {reference[2]}")).quantity and known(referred.quantity).period:
            means, unit = referred, "deg"
        quantity, written = means.quantity, table.units[table.headers.index(header)]
        if len(header) == 1 and written and quantity not in ("", "t") and factor(quantity, written) is None:
            quantity = ""  # a letter says less than its unit: "v [V]", "p [hPa]"
        elif reference and reference[2].startswith("m") and quantity == "cog":
            of.account[header] = ((), "it is counted from magnetic north")
            continue
        if header == "pitch" and of_the_hull:
            of.unsure[header] = PITCH
        elif quantity and quantity not in mapped:
            mapped[quantity] = ColumnMap.model_validate({"from": header, "unit": unit})
        elif quantity:
            other, named = mapped[quantity].header, quantity in chosen.columns_of(table.path)
            if not named:
                _doubled(table, quantity, other, header)
            of.account[header] = ((), f"the map names '{other}'" if named else f"it holds the same as '{other}'")
        elif means.may_be:
            of.unsure[header] = means.may_be
        elif is_order(header):
            of.account[header] = ((), "it is what was ordered, not what was measured")
        elif re.fullmatch(WATER, plain_words(header)):
            of.account[header] = ((), "it is a speed through the water")
        else:
            of.unknown.append(header)
    if {"psi", "heading_magnetic"} <= set(mapped):
        for name in sorted({"heading_magnetic", *OF_COMPASS} & set(mapped)):
            of.account[mapped.pop(name).header] = ((), f"the true heading '{mapped['psi'].header}' is used")
    if "t" not in mapped and "t_part" in mapped:  # "milliseconds" without others are the clock itself
        mapped["t"] = mapped.pop("t_part").model_copy(update={"unit": "ms"})
    # Masks first: they move quantities, and take columns of letters that could be signs.
    of.masks = masks_of(table, mapped, [*of.unknown, *of.unsure, *filter(is_order, of.account)], signs, chosen)
    mapped |= sign_columns(table, mapped, [h for h in signs if h not in of.masks.account], chosen)
    _orders(table, of)
    for header in of.unsure:  # "RPM 2" beside "RPM": one of two shafts is no only one
        one = next((q for q in of.mapped if f"{EITHER_SIDE.get(q)} or nothing" == of.unsure[header]), "")
        if one and one not in chosen.columns_of(table.path):
            raise OpenQuestion(table.path, *either(header, of.unsure[header]))
    taken = {*(column.header for column in mapped.values()), *of.masks.account, *of.account}
    of.unknown = [header for header in [*of.unknown, *signs] if header not in taken]
    of.unsure = {header: what for header, what in of.unsure.items() if header not in taken}
    if "t" not in mapped and re.fullmatch(rf"{NUMBERED} \d+", table.headers[0]):
        first = ", ".join(str(cell) for cell in table.frame.iloc[0])
        raise Missing(
            f"{table.name}: has no headers; its first row is {first}. Say what its columns are in the map: columns = "
            '{ t = { from = 1, unit = "s" }, x = { from = 2, unit = "m" } } and so on'
        )
    if "t" not in mapped:
        headers = ", ".join(table.headers)
        raise Missing(f'{table.name}: no clock; found: {headers}. Name it in the map: [columns] t = "HEADER"')
    return of


def either(header: str, may_be: str) -> tuple[str, dict[str, dict[str, Any]]]:
    """The words of a question on a ``header`` that ``may_be`` one of several quantities or nothing, and its answers."""
    names = [word for word in re.split(r" or |\s*\([^)]*\)", may_be) if word and word != "nothing"]
    choices: dict[str, dict[str, Any]] = {name: {"columns": {name: {"from": header}}} for name in names}
    return f"'{header}' may be {may_be}", choices | {"nothing": {"ignore": [header]}}


def _orders(table: RawTable, of: Assigned) -> None:
    """Orders of measured quantities join those that are mapped, in their own unit or that of the quantity."""
    for header in [header for header in of.account if is_order(header)]:
        quantity = ordered(header)
        name, measured = f"{quantity}_order", of.mapped.get(quantity)
        if name in ORDERS and name not in of.mapped and measured and table.numeric(header):
            columns = ((name, ColumnMap.model_validate({"from": header})), (quantity, measured))
            unit = next(filter(None, (unit_in(table, q, column) for q, column in columns)), "")
            if factor(name, unit) is not None and f"{quantity}_sign" not in of.mapped:  # no column signs the order
                of.mapped[name] = ColumnMap.model_validate({"from": header, "unit": unit, "sign": measured.sign})
                del of.account[header]


def _clock_parts(table: RawTable, mapped: dict[str, ColumnMap], account: Mapping[str, object]) -> None:
    """Columns of hours, minutes and seconds, and of the day, where all of them are there, join the ``mapped`` ones."""
    parts: dict[str, str] = {}
    for header in table.headers:
        words = re.sub(r"^(utc|gps|gnss|time)_|_(utc|gps)$", "", plain_words(header))
        for name, pattern in PARTS.items():
            if re.fullmatch(pattern, words) and header not in account and table.numeric(header):
                parts.setdefault(name, header)
    if "t" in mapped or not {"t", "t_hour", "t_minute"} <= set(parts):
        return
    dated = {"t_year", "t_month", "t_day"} <= set(parts)
    for name, header in parts.items():
        if dated or name in ("t", "t_hour", "t_minute"):
            mapped.setdefault(name, ColumnMap.model_validate({"from": header}))


def _doubled(table: RawTable, quantity: str, header: str, other: str) -> None:
    """Raises OpenQuestion where two columns of one ``quantity`` hold different values."""
    if quantity not in ("t", "date") and table.numeric(header) and table.numeric(other):
        values = []
        for name in (header, other):
            column = ColumnMap.model_validate({"from": name})
            values.append(table.numbers(name) * (factor(quantity, unit_in(table, quantity, column)) or 1.0))
        off = np.abs(values[1] - values[0])
        if period := known(quantity).period:
            off = np.minimum(off % period, period - off % period)
        steps = [np.diff(np.unique(v[np.isfinite(v)])) for v in values]  # the coarser one is rounded to its least step
        least = max(float(step.min()) if len(step) else 0.0 for step in steps)
        size = _largest(values[0])
        # In 5 % of the rows they may differ more; 1e-5 of the largest number is rounding. Set by hand.
        if np.isfinite(off).any() and np.nanquantile(off, 0.95) <= min(least, size) + 1e-5 * size:
            return
    what = "two columns hold a time" if quantity == "t" else f"two columns are {quantity}"
    choices = {f"'{name}'": {"columns": {quantity: {"from": name}}} for name in (header, other)}
    raise OpenQuestion(table.path, f"{what}: '{header}' and '{other}'", choices)


def unit_in(table: RawTable, quantity: str, column: ColumnMap) -> str:
    """The unit of a ``quantity`` in the ``column`` of a ``table`` as it is written, "" where nothing says it."""
    unit = column.unit or table.units[table.headers.index(column.header)] or meaning(column.header).unit
    if quantity in ("latitude", "longitude"):
        if re.fullmatch(r"d{2,3}m{2}(\.m+)?", unit.lower()) or (not column.unit and _degrees_minutes(table, quantity)):
            return "ddmm"
        return unit if factor(quantity, unit) else "deg"
    if re.fullmatch(REFERENCE, unit.strip().lower()) and known(quantity).period:
        return "deg"
    return unit or ("deg" if quantity in OF_COMPASS else "")  # nobody writes them in radians without a word


def _degrees_minutes(table: RawTable, quantity: str) -> bool:
    """Whether a column of latitudes or longitudes holds degrees and minutes in one number, as NMEA 0183 does: numbers
    beyond the globe whose last two digits are minutes, or a partner of which this is so."""
    shown = {}
    for name, header in ((q, h) for h in table.headers if (q := meaning(h).quantity) in ("latitude", "longitude")):
        if not table.numeric(header):
            return False
        values = np.abs(table.numbers(header))
        values = values[np.isfinite(values) & (values != 0) & ~np.isin(values, (99999.0, 9999.0, 91.0, 181.0))]
        if not len(values) or (values % 100 >= 60).any() or values.max() > 100 * known(name).limits[1]:
            return False
        shown[name] = bool((values > 360).mean() > 0.5)  # up to 360 both may be exchanged
    return quantity in shown and any(shown.values())


def _numbers(table: RawTable, quantity: str, column: ColumnMap) -> np.ndarray:
    """The ``quantity`` in the ``column`` of a ``table``, (N,) in the unit of the file. Raises UserError on text."""
    if quantity in ("latitude", "longitude", *OF_COMPASS) and not table.numeric(column.header):
        return np.array([_degrees(cell, table.name, column.header) for cell in table.cells(column.header)])
    return table.numbers(column.header)


def _degrees(cell: Any, where: str, header: str) -> float:
    """Decimal degrees of "34.5N", "34 30.0 N", "34°30,5'N", "34°30'00.0\\"N" or "3430.00,N"."""
    if cell is None or cell != cell or not str(cell).strip():
        return np.nan
    text = re.sub(r"(?<=\d),(?=\d)", ".", str(cell).strip().upper())
    parts = re.findall(r"\d+(?:\.\d+)?", text)
    if not 1 <= len(parts) <= 3 or not re.fullmatch(r"[-+NSEW\d.,\s°º'′\"″:]+", text):
        raise BadValue(
            f"{where}: column '{header}': '{text[:40]}' is no latitude or longitude, nor an angle to one side"
        )
    values = [float(p) for p in parts]
    if len(values) == 1 and (values[0] > 180 or re.match(r"\d{4,5}(\.|$)", parts[0])):  # in one number, as in NMEA
        values = [float(int(values[0] // 100)), values[0] % 100]
    total = sum(v / 60**i for i, v in enumerate(values))  # degrees, minutes, seconds
    return -total if text.startswith("-") or text[0] in "SW" or text[-1] in "SW" else total


def _check_globe(table: RawTable, columns: dict[str, np.ndarray], mapped: dict[str, ColumnMap]) -> None:
    """Raises OpenQuestion where most latitudes or longitudes [deg] lie beyond the globe: that is no lost satellite."""
    headers = {name: mapped[name].header for name in ("latitude", "longitude") if name in columns}
    for quantity in headers:
        most, values = known(quantity).limits[1], np.abs(columns[quantity])
        values = values[np.isfinite(values) & (values != most + 1)]  # 91 and 181 stand for none (ITU-R M.1371-5)
        if (values > most).sum() <= 0.5 * len(values):
            continue
        largest, choices = float(values.max()), dict[str, dict[str, Any]]()
        if len(headers) == 2 and largest <= 360:
            swapped = {"latitude": {"from": headers["longitude"]}, "longitude": {"from": headers["latitude"]}}
            choices["latitude and longitude are exchanged"] = {"columns": swapped}
        unit, words = ("1e-7 deg", "units of 1e-7 degrees") if largest > 1e6 else ("ddmm", "degrees and minutes in one")
        choices[words] = {"columns": {name: {"from": h, "unit": unit} for name, h in headers.items()}}
        words = f"column '{headers[quantity]}' reaches {largest:g}, which is no {quantity} in degrees"
        raise OpenQuestion(table.path, words, choices)


def _rows(
    stamps: np.ndarray, columns: dict[str, np.ndarray], turns: Mapping[str, float]
) -> tuple[np.ndarray, dict[str, np.ndarray], list[Message]]:
    """Rows with a time [s], those of coarse stamps apart and others with the same time averaged; and what was done.
    turns: of the directions among the columns, after which their values begin anew."""
    timed = np.isfinite(stamps)
    columns = {name: values[timed] for name, values in columns.items()}
    times, said = within_stamps(stamps[timed], columns.values())
    t, where = np.unique(times, return_inverse=True)
    for name, values in columns.items() if len(t) < len(times) else ():
        first = np.full(len(t), np.nan)
        good = np.flatnonzero(np.isfinite(values))[::-1]  # backwards: of rows of one time the first is written last
        first[where[good]] = values[good]
        off = values - first[where]
        if turn := turns.get(name):  # the short way round
            off = np.remainder(off + turn / 2, turn) - turn / 2
        count = np.bincount(where, np.isfinite(values), len(t))
        columns[name] = first + np.bincount(where, np.nan_to_num(off), len(t)) / np.maximum(count, 1)
    return t, columns, said


BY_CHANCE = 1e-9  # Probability of a row of equal values below which a channel stands still. Set by hand.
# Least time [s] and rows that a channel stands still, and its jump afterwards, in its larger changes from row to row.
FROZEN_S, FROZEN_ROWS, JUMP = 2.0, 10, 3.0  # set by hand
LARGEST = 1e15  # No measurement in any unit is larger. Set by hand.
# Channels that never stand still while the ship moves.
STATES = ("latitude", "longitude", "x", "y", "psi", "sog", "cog", "u", "v", "r")


def stands_still(t: np.ndarray, channels: dict[str, np.ndarray]) -> tuple[dict[str, np.ndarray], list[Message]]:
    """The ``channels`` (each (N,)) with NaN where a state stands still, and what was found. t: (N,) seconds. How often
    a channel repeats its value by rounding alone is taken from the channel itself. A stretch counts where the channel
    jumps at its end, or, at the end of the log, where most other states go on moving."""
    out, said = dict(channels), []
    states = [name for name in STATES if name in channels]
    for name in states:
        at = np.flatnonzero(np.isfinite(channels[name]))
        values = channels[name][at]
        change = np.abs(np.diff(values))
        if wraps(name):
            turn = turn_in(name, "", _largest(values))
            change = np.minimum(change, np.abs(turn - change))
        same = change == 0
        share = (same.sum() + 1) / (len(change) + 2)  # Laplace's rule of succession: never 0 or 1
        if share > 0.9:  # so coarsely rounded that nothing can be said
            continue
        rows = max(FROZEN_ROWS, int(np.ceil(np.log(BY_CHANCE) / np.log(share))))
        usual = float(np.percentile(change[~same], 95)) if not same.all() else np.inf
        for a, b in np.flatnonzero(np.diff(np.concatenate([[0], same, [0]]))).reshape(-1, 2):
            begin, end = at[a], at[b]
            if b - a + 1 < rows or t[end] - t[begin] < FROZEN_S:
                continue
            if b == len(change):
                others = [_moves(channels[other][begin : end + 1]) for other in states if other != name]
                frozen = np.mean(others or [False]) > 0.5
            else:
                frozen = change[b] > JUMP * usual
            if frozen:  # its first value was still measured
                out[name] = np.where((t > t[begin]) & (t <= t[end]), np.nan, out[name])
                words = f"stands still from {t[begin] - t[0]:.6g} to {t[end] - t[0]:.6g} s of the log and is left out"
                said.append(Message(f"{name} {words} there", "frozen"))
    return out, said


def lost_satellites(channels: dict[str, np.ndarray]) -> tuple[dict[str, np.ndarray], list[Message]]:
    """The ``channels``, latitude and longitude [deg] or x and y [m] (N,) among them, with NaN for positions that are
    none: (0, 0), beyond the globe, or far from those around them."""
    pair = ("latitude", "longitude") if "latitude" in channels else ("x", "y")
    if not set(pair) <= set(channels):
        return dict(channels), []
    a, b = (channels[name].copy() for name in pair)
    none = np.zeros(len(a), dtype=bool)
    if pair[0] == "latitude":
        none = ((a == 0) & (b == 0)) | (np.abs(a) > 90) | (np.abs(b) > 360)
    from scipy.ndimage import median_filter

    fixes = np.flatnonzero(np.isfinite(a) & np.isfinite(b) & ~none)
    if len(fixes) > 20:
        for values in (a, b):
            typical = median_filter(values[fixes], size=9, mode="nearest")  # up to 4 lost ones in a row
            off = np.abs(values[fixes] - typical)
            step = np.abs(np.diff(typical))
            usual = max(float(np.percentile(step, 95)), float(np.median(off)), 1e-12)
            none[fixes[off > 30 * usual]] = True  # 30: set by hand
    count = int((none & np.isfinite(a)).sum())
    if not count:
        return dict(channels), []
    for values in (a, b):
        values[none] = np.nan
    text = f"{count} positions of lost satellites (zero, or far from those before and after) are left out"
    return {**channels, pair[0]: a, pair[1]: b}, [Message(text, "position_lost")]


def _moves(values: np.ndarray) -> bool:
    """Whether a channel changes in each quarter of a stretch."""
    parts = np.array_split(values[np.isfinite(values)], 4)
    return all(len(part) > 1 and np.ptp(part) > 0 for part in parts)

"""What the files of a folder contradict, decided together, and the line of trials.toml that mends it, tried before; and
trials that contain each other, whatever their clocks say: one hash per row, one join over all files."""

from __future__ import annotations

import json
import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from cases.checks import single
from cases.checks.breaks import PROPELLERS
from cases.checks.report import CONTRADICTORY, DOUBTFUL, INFO, CheckFinding, CheckReport, Found
from cases.checks.stretches import DRIFTING, held_rudders, stretch_findings
from cases.evidence.competition import Judged, Keys, judged, rudder_nats, scores, standing, wrong_inputs
from cases.evidence.shifts import LAGS, TRACK, TURN, Scale, Shift, candidates, nats, scale, shifts
from cases.evidence.signals import Signals, independent, signals
from cases.io.conventions import SENTINEL, mislabelled
from cases.io.read import SUFFIXES, read_trial
from cases.io.sidecar import NAME, SidecarEntry, line_for, sidecar_entry
from cases.io.toml_file import as_toml
from cases.quantities import quantity, to_si, unit_by_factor
from cases.trial import Trial, left_out
from mmg.errors import UserError
from mmg.messages import message_rows

# Required of every trial and noisy, so that rows of different runs never agree in all of them.
COLUMNS = ("psi", "u", "v", "r")
# Values are compared on these grids (rad, m/s, rad/s); the coarse one finds copies with fewer digits. Set by hand.
GRIDS = (1e-7, 1e-3)
# One large odd multiplier per column, to mix its bits; a join of pandas would take a third of a second to import. Set
# by hand: any odd numbers do.
MULTIPLIERS = (0x9E3779B97F4A7C15, 0xC2B2AE3D27D4EB4F, 0x165667B19E3779F9, 0xD6E8FEB86659FD93)
VERBS = {"copy": "Is a copy of", "inside": "Is contained in", "contains": "Contains", "overlaps": "Overlaps"}
SHARE = 0.05  # Overlaps below this share of the shorter file are not reported: a matter of display. Set by hand.
Pair = tuple[int, int]
Duplicates = tuple[list[int], list[Found]]


def duplicates(trials: Sequence[Trial]) -> list[Duplicates]:
    """For each of ``trials``: the numbers of those that it shares rows with, and findings about them.

    Rows that occur twice within one file (a ship at rest) do not count, nor do matches out of step with
    the others. Cost: one join over all rows.
    """
    out: list[Duplicates] = [([], []) for _ in trials]
    reported: set[Pair] = set()
    for grid in GRIDS if len(trials) > 1 else ():
        for pair, rows in _matches(trials, grid).items():
            for me, other, finding in _overlap(trials, pair, rows) if pair not in reported else ():
                out[me][0].append(other)
                out[me][1].append(finding)
                reported.add(pair)
    return out


def _matches(trials: Sequence[Trial], grid: float) -> dict[Pair, np.ndarray]:
    """Pair of trials -> row indices (2, rows) of equal rows in the first and in the second: complete rows, each of them
    unique within its trial. Pairs in the order of their trials."""
    keys, parts = np.array(MULTIPLIERS, np.uint64), []
    for i, trial in enumerate(trials):
        values = np.column_stack([trial[c] for c in COLUMNS])
        complete = np.flatnonzero(np.isfinite(values).all(axis=1))
        gridded = np.rint(values[complete] / grid).astype(np.int64).view(np.uint64)
        # a hash (rows,) of four columns: products modulo 2^64 carry low bits to high ones, the shift carries them back
        mixed = (gridded * keys) ^ ((gridded * keys) >> np.uint64(29))
        hashed = (mixed * keys[::-1]).sum(axis=1, dtype=np.uint64)
        once, first, count = np.unique(hashed, return_index=True, return_counts=True)
        once, first = once[count == 1], first[count == 1]
        parts.append((once, np.full(len(once), i), complete[first]))
    hashes, number, row = (np.concatenate(some) for some in zip(*parts, strict=True))
    order = np.argsort(hashes, kind="stable")  # equal ones side by side, by trial
    hashes, number, row = hashes[order], number[order], row[order]
    matches: dict[Pair, list[tuple[np.ndarray, np.ndarray]]] = {}
    for apart in range(1, len(trials)):  # a row is in each trial once at most, so that equal ones lie this near
        at = np.flatnonzero(hashes[apart:] == hashes[:-apart])
        if not len(at):
            break
        both = number[at] * len(trials) + number[at + apart]
        for code in np.unique(both):
            one, pair = at[both == code], divmod(int(code), len(trials))
            matches.setdefault(pair, []).append((row[one], row[one + apart]))
    # row numbers of a pair in one piece: (2, rows) from its (first, second) by distance in the order
    return {pair: np.concatenate(matches[pair], axis=1) for pair in sorted(matches)}


def _overlap(trials: Sequence[Trial], pair: Pair, rows: np.ndarray) -> Iterator[tuple[int, int, Found]]:
    """For both trials of a ``pair``, its number, that of the other and what its report says of their overlap, if that
    is a run of ``rows`` (2, rows) in step."""
    # a copied run has one offset of row numbers; matches at another offset are chance
    offsets, count = np.unique(rows[1] - rows[0], return_counts=True)
    in_step = rows[1] - rows[0] == offsets[np.argmax(count)]
    if in_step.sum() < max(10, SHARE * min(len(trials[i]) for i in pair)):
        return
    ends = [(int(some[in_step].min()), int(some[in_step].max())) for some in rows]
    shares = [(last - first + 1) / len(trials[i]) for i, (first, last) in zip(pair, ends, strict=True)]
    for me, other in ((0, 1), (1, 0)):
        # not 1: a copy may lack a row at its ends
        inside, holds, name = shares[me] >= 0.99, shares[other] >= 0.99, trials[pair[other]].name
        relation = "copy" if inside and holds else "inside" if inside else "contains" if holds else "overlaps"
        text = (
            f"{VERBS[relation]} {name}: rows {ends[me][0]}-{ends[me][1]} are its rows "
            f"{ends[other][0]}-{ends[other][1]}; keep both on the same side of a train/test split."
        )
        yield pair[me], pair[other], (DOUBTFUL, "duplicate", text)


LATE = 1.5  # Lag [s] of a channel beyond which the verdict is no longer "ok". Set by hand (1, 1).
# The same for the angle between track and heading [rad], within which a compass is right (IMO A.424: 1 deg times the
# secant of the latitude), and for a lever arm [m].
TURNED, LEAST_ARM = math.radians(2.0), 0.05
# Gains [1] and angles [rad] below it are not worth a note: a metre in a kilometre. Set by hand (1, 1).
LEAST_SHARE = 0.001
# Relative misfit of the track beyond which positions and velocities have nothing to do with each other.
DISAGREE = 0.8  # set by hand: 1 is what a prediction of no motion misses by
# Nats from which one file refutes its labels although all others of its folder bear theirs out.
SURE = 20.0  # set by hand: below it one file is doubted, and a fit goes on
# Topic -> what looks at one trial: its numbers, and level, code and sentence of each finding.
LOOKS = {
    "sampling": single.sampling,
    "stretches": stretch_findings,
    "rudder": single.held_rudder,
    "wind": single.wind,
    "excitation": single.excitation,
}
# Code -> topic, where it is not kinematics.
TOPICS = {"unit": "units", "rudder_sign": "rudder", "revolutions_sign": "propeller"}


class Said(NamedTuple):
    """What is said of one trial: findings as (level, code, sentence), and the keys that mend it."""

    findings: list[Found]
    keys: Keys


def check(trials: Sequence[Trial], copies: Sequence[Duplicates] | None = None) -> list[CheckReport]:
    """One report for each of ``trials``, in their order: each by itself, and what their folders show together.

    copies: ``duplicates`` of the trials, where they are known. Notices of the reading come last.
    """
    reports = []
    for trial, (_, shared) in zip(trials, duplicates(trials) if copies is None else copies, strict=True):
        looks = {topic: look(trial) for topic, look in LOOKS.items()}
        read = [
            (DOUBTFUL if row["code"] == SENTINEL else INFO, row["code"], _capital(row["text"]) + ".")
            for row in message_rows(trial.notices)
        ]
        by_topic = {"reading": read, "duplicates": shared, **{topic: some for topic, (_, some) in looks.items()}}
        findings = tuple(CheckFinding(topic, *each) for topic, some in by_topic.items() for each in some)
        numbers = {topic: values for topic, (values, _) in looks.items() if values}
        reports.append(CheckReport(trial.name, str(trial.path or ""), findings, numbers))
    folders: dict[Path | None, list[int]] = {}
    for i, trial in enumerate(trials):
        folders.setdefault(trial.path.parent if trial.path else None, []).append(i)
    for rows in folders.values():
        together = _decided([trials[i] for i in rows], [reports[i] for i in rows])
        for i, report in zip(rows, together, strict=True):
            reports[i] = report
    return reports


def _decided(trials: Sequence[Trial], reports: Sequence[CheckReport]) -> list[CheckReport]:
    """``reports`` on the ``trials`` of a folder with what they show together: frames, signs, units, channels that stand
    still, lags, lever arms, gains, offsets, and what could not be checked; not what follows from a contradiction."""
    # Frames, signs and units come first: a lag or a gain of columns in a wrong frame means nothing.
    some = [_whole(*each) for each in zip(trials, reports, strict=True)]
    records = [signals(trial) for trial in some]
    still = [standing(trial) for trial in trials]
    turning = [single.following(trial)[0] for trial in trials]
    table = [
        scores(
            trial,
            record,
            None if "r" in names else follows,
            tuple(names),
            {c: u for c, (_, u) in labels(trial).items()},
        )
        for trial, record, names, follows in zip(some, records, still, turning, strict=True)
    ]
    said = [_contradicted(trials, k, *each) for k, each in enumerate(zip(still, judged(table), turning, strict=True))]
    frozen = [any(f.code == "frozen_channel" for f in report.findings) for report in reports]
    # Then inputs that the motion refutes.
    quiet = [k for k, each in enumerate(said) if not each.findings]
    for look in (single.revolutions_sign, held_rudders):
        for k, found in zip(quiet, look([trials[k] for k in quiet]), strict=True):
            said[k].findings.extend(found)
            if any(code == "revolutions_sign" for _, code, _ in found):
                shafts = [name for name in PROPELLERS if name in trials[k]]
                said[k].keys["sign"] = {name: -1 for name in shafts if np.nanmedian(trials[k][name]) < 0}
    # Then lags, of files that no reading refutes; what is late is taken back before gains are compared with the track.
    quiet = [k for k, each in enumerate(said) if not each.findings and not frozen[k]]
    for k, shift in zip(quiet, _shifted([some[k] for k in quiet], [records[k] for k in quiet]), strict=True):
        if shift:
            said[k] = _shift_said(shift, trials[k])
            some[k] = _in_time(some[k], shift)
    quiet = [k for k in quiet if all(level == INFO for level, *_ in said[k].findings)]
    sound = [some[k] for k in quiet]
    for k, more in zip(quiet, _scaled(sound), strict=True):
        said[k].findings.extend(more)
    # Last how she moves: it tells of relatives too, which the comparisons above pass over.
    sways = single.sway_findings([trials[k] for k in quiet])
    for k in quiet:
        derived = trials[k].has_position and not independent(trials[k], "track")
        said[k].findings.extend((level if derived else INFO, code, text) for level, code, text in sways)
        said[k].findings.extend([*single.headway(trials[k]), *single.turning_wind(trials[k])])
    return [
        _joined(*row) for row in zip(reports, _with_lines(trials, said), map(single.not_checked, trials), strict=True)
    ]


def _whole(trial: Trial, report: CheckReport) -> Trial:
    """``trial`` without its broken stretches, but for those in which positions and velocities drift apart: a wrong
    frame makes such ones, and they are what tells."""
    broken = report.numbers["stretches"]["broken"]
    spans = [(s["begin_s"], s["end_s"]) for s in broken if DRIFTING["position"][0] not in s["what"]]
    return left_out(trial, spans, "") if spans else trial


def _in_time(trial: Trial, shift: Shift) -> Trial:
    """``trial`` without the lag that ``shift`` says."""
    late = LAGS[shift.name][1] if shift.name in LAGS else ()
    t, by = trial.t, float(np.real(shift.value))
    lagged = {name: trial.psi_unwrapped if name == "psi" else trial[name] for name in late if name in trial}
    in_time = {name: np.interp(t + by, t, values, np.nan, np.nan) for name, values in lagged.items()}
    return trial.with_columns(**in_time)


def _scaled(trials: Sequence[Trial]) -> list[list[Found]]:
    """What is said of gains and the angle of the track of each of the ``trials``: what all files of a folder show
    together, or each by itself where they do not."""
    out: list[list[Found]] = [[] for _ in trials]
    for names in (TRACK[:6], TURN):  # without the drifts, which a current through the water would be
        able = {k: t for k, t in enumerate(trials) if independent(t, "turn" if names == TURN else "track")}
        every = list(able.values())
        together = scale(every, names)
        by_trial = {k: together if len(able) == 1 else scale([trial], names) for k, trial in able.items()}
        for name in names[:3]:
            shared = together is not None and together.significant(name, LEAST_SHARE)
            said = _scale_said(together, name, every) if together and shared else None
            for k, one in by_trial.items():
                if one is not None and (said or one.significant(name, LEAST_SHARE)):
                    out[k].append(said or _scale_said(one, name, [trials[k]]))
    return out


def _scale_said(fit: Scale, name: str, trials: Sequence[Trial]) -> Found:
    """What is said of a value of ``fit`` that is no chance, from these ``trials``."""
    files = f" over {len(trials)} files" if len(trials) > 1 else ""
    if name == "angle":
        side = "clockwise" if fit.values[name] > 0 else "counter-clockwise"
        size, error = abs(math.degrees(fit.values[name])), math.degrees(fit.std[name])
        text = (
            f"The track is turned {size:.1f} deg {side} from heading and velocities (standard error {error:.1g}"
            f"{files}), by an offset of the heading or by the axes"
        )
        return (DOUBTFUL if fit.significant(name, TURNED) else INFO), "heading_offset", text
    share = 1.0 / max(1.0 + fit.values[name], 0.1) - 1.0  # what the column is of the truth, less one
    of = "what the heading says" if name == "r" else "what the positions say"
    side = "below" if share < 0 else "above"
    text = f"{name} is {abs(share):.1%} {side} {of} (standard error {fit.std[name]:.2%}{files})"
    if name == "u":
        water = scale(trials, TRACK)  # once more, with a drift of the water left free
        current = water is None or not water.significant(name)
        text += ", u or the positions in a wrong unit or grid" + (", or u through the water in a current" * current)
    return (DOUBTFUL if fit.matters(name) else INFO), "gain", text


def _contradicted(
    trials: Sequence[Trial], k: int, still: Mapping[str, str], verdict: Judged, turning: float | None
) -> Said:
    """What refutes the labels of file number ``k`` of a folder: columns that stand ``still``, and the reading by
    its ``verdict``. turning: correlation of its turn rate with the rudder."""
    trial = trials[k]
    said = [
        (CONTRADICTORY, "frozen_channel", f"{name} is frozen at {float(np.nanmedian(trial[name])):.3g}, while {why}")
        for name, why in still.items()
    ]
    keys: Keys = {}
    alone = verdict.reading != verdict.folder
    psi_may = verdict.reading.rate == -1 and trial.has_position and not independent(trial, "track")  # as good, untested
    for code, meaning in [] if still else verdict.reading.statements():
        unsure = alone and len(trials) > 2 and verdict.odds < SURE
        # a rudder that differs from those of its folder: what else turns her is unknown
        turned = verdict.reading.rudder != verdict.folder.rudder and code == "rudder_sign"
        files = f"against {len(trials) - 1} others" if alone else f"over {len(trials)} files"
        odds = f" (log odds {verdict.odds:.0f} {files})" if len(trials) > 1 else f" (log odds {verdict.odds:.0f})"
        text = _sentence(code, meaning, verdict) + odds
        if psi_may and code == "r_sign":
            text += ", or psi counts counter-clockwise, and u and v were derived from it"
        said.append((DOUBTFUL if turned or unsure else CONTRADICTORY, code, text))
        advised = verdict.agreed and not (verdict.rival or unsure or psi_may)
        keys = verdict.reading.keys() if advised and verdict.reading.rudder == verdict.folder.rudder else {}
    if verdict.rival and not still:
        both = [line(wanted) for each in (verdict.reading, verdict.rival) if (wanted := settings(trial, each.keys()))]
        other = " and ".join(text for _, text in verdict.rival.statements()) or "the headers are right"
        choice = f"; one of these is true of them: {', or '.join(both)}" if len(both) > 1 else ""
        said = [(level, code, f"{text}, or {other}: the data cannot tell{choice}") for level, code, text in said]
    if not said and verdict.after > DISAGREE:
        text = f"Velocities and positions disagree (misfit {verdict.after:.0%}) and no other frame, sign or unit "
        said.append((CONTRADICTORY, "velocity_mismatch", f"{text}explains it; check units, clocks and axes"))
    wrong = mislabelled(trial.columns)
    if not said:  # how quickly the ship turns is known only where frames, clock and turn rates are right
        rudder = turning if turning is not None else single.following(trial, 1e-4)[0]
        wrong += [each for each in wrong_inputs(trial, rudder) if each[0] not in [name for name, *_ in wrong]]
    for name, factor, text in wrong:
        said.append((CONTRADICTORY, "unit", _capital(text)))
        keys = {**keys, "units": {**keys.get("units", {}), name: factor}}
    return Said(said, keys)


def _capital(words: str) -> str:
    return words[0].upper() + words[1:]


def _sentence(code: str, meaning: str, verdict: Judged) -> str:
    fits = f"misfit {verdict.after:.1%} against {verdict.before:.1%} as labelled"
    if code == "rudder_sign":
        also = ", or a wind turns her: in other files she turns to starboard" if verdict.folder.rudder == 1 else ""
        return f"Going ahead the ship turns to port when delta is positive: {meaning}{also}"
    if code == "r_sign" or meaning.startswith("r "):
        return meaning
    if code == "unit":
        return f"{meaning}: {fits} of velocities and track" if np.isfinite(verdict.after) else meaning
    return f"The track says that {meaning}: {fits}" if np.isfinite(verdict.after) else f"It looks as if {meaning}"


def _shifted(trials: Sequence[Trial], records: Sequence[Signals | None]) -> list[Shift | None]:
    """The shift of each of the ``trials``, None where there is none."""
    out: list[Shift | None] = [None for _ in trials]
    for track in (True, False):
        some = [(k, s) for k, s in enumerate(records) if s and s.has_track == track and (track or s.has_turn)]
        if not some:
            continue
        members = [trials[k] for k, _ in some]
        # longest lag [s] that is tried: a tenth of the shortest record up to a minute, 5 s and 20 samples at least
        longest = max(5.0, *(20 * t.dt for t in members), min(60.0, 0.1 * min(t.duration for t in members)))
        said = shifts(candidates([s for _, s in some], longest))
        if any(shift and shift.name == "arm" for shift in said):  # a late velocity in a turn looks like an arm ahead
            both = scale(members, TRACK[:6])
            if both is None or not (both.significant("arm_x") or both.significant("arm_y")):
                said = [shift and replace(shift, rivals=(*shift.rivals, "w")) for shift in said]
        for (k, _), shift in zip(some, said, strict=True):
            out[k] = shift
    return out


def _shift_said(shift: Shift, trial: Trial) -> Said:
    """A doubt and, where one key mends it, that key; only a note where it hardly matters. No sensor is early: where a
    channel of ``trial`` is ahead, what it is compared with is late."""
    value, real = shift.value, float(np.real(shift.value))
    keys: Keys = {}
    if shift.name in LAGS:
        _, columns, who = LAGS[shift.name]
        against, early = "the other columns", real < 0
        if early and shift.name == "r" and not independent(trial, "track"):  # it is compared with the heading alone
            who, columns, against, early = "psi is", ("psi",), "r", False
        code, text = "lag", f"{who} {abs(real):.3g} s late against {against}"
        keys = {"lag": dict.fromkeys(columns, float(f"{abs(real):.3g}"))}
        if early:
            others = "u and v, in the earth frame," if shift.name == "place" else "the other columns"
            named = "the positions" if shift.name == "place" else " and ".join(columns)
            text, keys = f"{others} are {-real:.3g} s late against {named}", {}
    else:
        x, y = float(f"{real:.3g}"), float(f"{np.imag(value):.3g}")
        code, text = "lever_arm", f"The positions are those of a point ({x:g}, {y:g}) m from midship (lever arm)"
        keys = {"reference_point": {"x": x, "y": y, "applies_to": "position"}}
    if shift.rivals:
        names = dict.fromkeys("a lag" if name in LAGS else "a lever arm" for name in shift.rivals)
        text, keys = f"{text} (or {' or '.join(names)}: the data cannot tell)", {}
    matters = abs(value) >= (LATE if shift.name in LAGS else LEAST_ARM)
    return Said([(DOUBTFUL if matters else INFO, code, text)], keys if shift.shared and matters else {})


def _with_lines(trials: Sequence[Trial], said: Sequence[Said]) -> list[Said]:
    """What is ``said`` of the ``trials`` of a folder, with the lines that mend it where they were tried on all files
    that they are for, and make the evidence of each of them better."""
    out = [Said([(level, code, f"{text.rstrip('.')}.") for level, code, text in each.findings], {}) for each in said]
    groups: dict[str, list[int]] = {}
    for k, (trial, each) in enumerate(zip(trials, said, strict=True)):
        if each.keys and (wanted := settings(trial, each.keys)):
            groups.setdefault(line(wanted), []).append(k)
    for text, rows in groups.items():  # files that need the same line are tried with it together
        gained = [_gained(trials[k], said[k]) for k in rows]
        if min(gained) < 0 or sum(gained) <= 0:
            continue
        everywhere = len(rows) == len(trials) and _all_there(trials)
        for k in rows:
            level, code, sentence = out[k].findings[0]
            path = trials[k].path  # there is one: a line is tried on files
            where = f"{path.parent / NAME}, [default]: {text}" if path and everywhere else line_for(path, "", text)
            tried = f"{sentence} Tried on these files, this ends the contradiction: {where}."
            out[k] = Said([(level, code, tried), *out[k].findings[1:]], said[k].keys)
    return out


def _all_there(trials: Sequence[Trial]) -> bool:
    """Whether the ``trials`` are all that their folder holds: what nobody looked at must not be changed with them."""
    paths = [trial.path for trial in trials if trial.path]
    inside = {file.name for file in paths[0].parent.iterdir() if file.suffix.lower() in SUFFIXES}
    return inside <= {path.name for path in paths}


def _gained(trial: Trial, said: Said) -> float:
    """Nats by which heading, track, turn rate and rudder of ``trial`` fit one another better once it is read as the
    keys of what is ``said`` want it; for inputs one where they then go with how quickly she turns; -inf where not."""
    wanted = settings(trial, said.keys)
    after = mended(trial, wanted) if wanted else None
    if after is None or mislabelled(after.columns) or wrong_inputs(after, single.following(after)[0]):
        return -math.inf
    if set(said.keys) == {"units"} and not {"psi", "u", "v", "r", "t"} & set(said.keys["units"]):
        return 1.0
    return round(_fit(trial) - _fit(after), 6)


def _fit(trial: Trial) -> float:
    """Nats of the columns of ``trial`` as they are; less is better."""
    s = signals(trial)
    return (nats(s) if s else 0.0) + rudder_nats(single.following(trial)[0])[1]


def _joined(report: CheckReport, said: Said, unchecked: Sequence[Found]) -> CheckReport:
    """``report`` with what is ``said`` and what is ``unchecked``; its own sentences on what follows from that are left
    out."""
    codes = {code for level, code, _ in said.findings if level != INFO}
    kept = [f for f in report.findings if not (codes and (f.topic == "rudder" or f.code in codes))]
    if codes & {"unit", "frozen_channel"}:  # of a wrong clock, or of turn rates in a wrong unit
        kept = [f for f in kept if f.code not in ("coarse_sampling", "gaps")]
    judged_findings = [
        CheckFinding(TOPICS.get(code, "kinematics"), level, code, text)
        for level, code, text in (*said.findings, *unchecked)
    ]
    return replace(report, findings=(*judged_findings, *kept))


def labels(trial: Trial) -> dict[str, tuple[str, str]]:
    """Column -> its header and unit in the file of ``trial``; names and units of a Trial where it has none."""
    logged = json.loads(trial.meta.get("labels", "{}"))
    return {name: tuple(logged.get(name, (name, quantity(name).unit))) for name in trial.columns}


def settings(trial: Trial, keys: Keys) -> dict[str, Any] | None:
    """What has to stand in the sidecar so that ``keys`` are true of ``trial``, over what stands there; None where no
    accepted unit makes it so. keys: of a reading: units as factors, columns by their canonical names."""
    known, entry = labels(trial), entry_of(trial)
    out: dict[str, Any] = {}
    if "columns" in keys:
        out["columns"] = {**entry.columns, **{name: known[other][0] for name, other in keys["columns"].items()}}
    if "units" in keys:
        units = dict(entry.units)
        for name, factor in keys["units"].items():
            units[name] = unit_by_factor(name, to_si(name, known[name][1], name) * factor)
            if not units[name]:
                return None
        out["units"] = units
    if "sign" in keys:
        out["sign"] = {**entry.sign, **{name: s * entry.sign.get(name, 1) for name, s in keys["sign"].items()}}
    if "lag" in keys:
        lags = {name: round(s + entry.lag.get(name, 0.0), 3) for name, s in keys["lag"].items()}
        out["lag"] = {**entry.lag, **lags}
    for key in ("velocity_frame", "rudder_positive", "heading_from", "reference_point"):
        if key in keys:
            out[key] = keys[key]
    if "reference_point" in out and (entry.reference_point.x or entry.reference_point.y):
        return None
    return out


def line(wanted: Mapping[str, Any]) -> str:
    """``wanted`` settings as lines of TOML, with "and" between them."""
    return " and ".join(f"{key} = {as_toml(value)}" for key, value in wanted.items())


def mended(trial: Trial, wanted: Mapping[str, Any]) -> Trial | None:
    """``trial`` as its file is read with the ``wanted`` settings; None without a file, and where that fails."""
    if trial.path is None or not trial.path.exists():
        return None
    try:
        return read_trial(trial.path, SidecarEntry(**{**entry_of(trial).model_dump(exclude_unset=True), **wanted}))
    except UserError:
        return None


def entry_of(trial: Trial) -> SidecarEntry:
    """What the sidecar says of ``trial`` so far."""
    return sidecar_entry(trial.path) if trial.path is not None and trial.path.exists() else SidecarEntry()

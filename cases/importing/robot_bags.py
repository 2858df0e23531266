"""Bags of ROS 1 and 2 and MCAP files, by rosbags: odometry, poses, twists, IMU, GNSS, joints, and topics of numbers.

Messages are in the axes of REP-103 unless their frames say NED or FRD, or the map does: world x east, y north, z up
(ENU), body x forward, y to port, z up (FLU). They are turned into north-east-down and forward-starboard-down.
"""

from __future__ import annotations

import re
from collections.abc import Iterable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from cases.importing.import_map import ImportMap
from cases.importing.raw_table import Account, Clock, RawTable
from cases.importing.series import SourceSeries, table_of_series
from cases.importing.vocabulary import Meaning, is_order, meaning
from mmg.errors import Unreadable, needed, reason
from mmg.messages import Message

# First bytes of the files of ROS 1, MCAP and ROS 2.
MAGIC = (b"#ROSBAG V2", b"\x89MCAP", b"SQLite format 3\0")
PARTS = (".db3", ".mcap")
RANKS = {  # Types of messages that are read; of two that say the same, that of the lower number is taken.
    "Odometry": 0, "PoseWithCovarianceStamped": 1, "PoseStamped": 2, "PoseWithCovariance": 3, "Pose": 4,
    "TwistWithCovarianceStamped": 1, "TwistStamped": 2, "TwistWithCovariance": 3, "Twist": 4, "Imu": 5, "NavSatFix": 5,
    "JointState": 0, "QuaternionStamped": 6,
}  # fmt: skip
NUMBERS = re.compile(r"u?int\d+|float\d+")
MOST_FIELDS = 20  # Numbers of a message of another type up to which they are read. Set by hand.
DOWN = r"ned|frd"  # Names of frames whose z axis points down
SINCE_1970 = 1e8  # Seconds: later stamps are no simulation time. Set by hand: three years.


def bag_of(path: Path) -> Path:
    """The first file of the bag that ``path`` is a part of; any other file itself."""
    return min(p for p in path.parent.iterdir() if p.suffix == path.suffix) if _in_parts(path) else path


def _in_parts(path: Path) -> bool:
    return path.suffix in PARTS and (path.parent / "metadata.yaml").is_file()


@dataclass
class Topic:
    """What is kept of the messages of a topic: their type (``kind``) without its package, times at which they were
    received and stamps [s], numbers by name (rows), and the names of the frames of world and body."""

    name: str
    kind: str
    received: list[float] = field(default_factory=list)
    stamps: list[float] = field(default_factory=list)
    rows: list[dict[str, float]] = field(default_factory=list)
    world: str = ""
    body: str = ""

    def column(self, name: str) -> np.ndarray:
        """The numbers (N,) called ``name``, NaN where a message has none."""
        return np.array([row.get(name, np.nan) for row in self.rows])


def read_bag(path: Path, chosen: ImportMap) -> RawTable:
    """The table of the bag that ``path`` is, or begins: ROS 1 (.bag), ROS 2 (.db3, .mcap, with all files beside its
    metadata.yaml), or MCAP.

    chosen: the map; it may name topics in ``ignore``, and ``axes``. Raises UserError where rosbags is missing, for a
    file that is cut off or damaged, and where two topics of one type say the same.
    """
    highlevel, typesys = (needed(f"rosbags.{part}", f"{path}: a ROS bag") for part in ("highlevel", "typesys"))
    accounts: list[Account] = []
    try:
        store = typesys.get_typestore(typesys.Stores.ROS2_HUMBLE)
        with highlevel.AnyReader([path.parent if _in_parts(path) else path], default_typestore=store) as reader:
            topics = _topics(reader, chosen.ignored_in(path), accounts)
    except Exception as error:  # rosbags and its decoders raise many kinds for damaged files
        raise Unreadable(f"{path}: is cut off, damaged or no bag ({reason(error)})") from None
    stamped = [topic for topic in topics if min(topic.stamps) > 0]  # 0 is no stamp
    received = np.array([t for topic in stamped for t in topic.received])
    stamps = np.array([t for topic in stamped for t in topic.stamps])
    series, axes = [], []
    for topic in topics:
        said, words = _columns(topic, chosen.axes == "ned")
        axes += [words] if words else []
        t = np.array(topic.stamps)
        if topic not in stamped:  # received by one clock, stamped by another: a line takes one to the other
            t = np.array(topic.received)
            if len(stamps) > 1 and np.ptp(received) > 0:
                slope, late = np.polyfit(received - received[0], stamps - stamps[0], 1)
                t = stamps[0] + late + slope * (t - received[0])
        order = np.argsort(t, kind="stable")  # of messages that overtook others
        columns = {header: values[order] for header, (_, values) in said.items()}
        means = {header: meant for header, (meant, _) in said.items()}
        series.append(SourceSeries(topic.name, t[order], columns, means, RANKS.get(topic.kind, 0)))
    absolute = bool(series) and min(float(one.t[0]) for one in series) > SINCE_1970
    clock = Clock(np.zeros(0), absolute, "time", "stamps of the messages, of those without one when they were received")
    notices = [Message(f"axes: {'; '.join(axes)}", "axes")] if axes else []
    return table_of_series(path, series, chosen, clock, notices, accounts)


def _topics(reader: Any, ignored: set[str], accounts: list[Account]) -> list[Topic]:
    """The topics that hold numbers, with what is kept of their messages."""
    wanted: dict[str, Topic] = {}
    fields: dict[str, list[str]] = {}
    for connection in reader.connections:
        kind = connection.msgtype.rsplit("/", 1)[-1]
        why = "an order" if is_order(connection.topic) else ""
        why = "ignored by the map" if connection.topic in ignored else why
        parts = [] if kind in RANKS else reader.typestore.get_msgdef(connection.msgtype).fields
        numbers = [name for name, node in parts if NUMBERS.fullmatch(str(node[1][0]))]
        fields[connection.topic] = numbers
        if not why and kind not in RANKS and not 0 < len(numbers) <= MOST_FIELDS:
            why = f"{connection.msgtype} holds no numbers that are read"
        if why:
            accounts.append(Account(connection.topic, connection.msgcount, (), why))
        else:
            wanted.setdefault(connection.topic, Topic(connection.topic, kind))
    connections = [one for one in reader.connections if one.topic in wanted]
    for connection, received, raw in reader.messages(connections) if connections else ():
        message, topic = reader.deserialize(raw, connection.msgtype), wanted[connection.topic]
        header = getattr(message, "header", None)
        stamp = getattr(header, "stamp", None)
        topic.received.append(1e-9 * received)
        topic.stamps.append(stamp.sec + 1e-9 * stamp.nanosec if stamp is not None else 0.0)
        topic.rows.append(_numbers(message, topic.kind, fields[connection.topic]))
        if len(topic.rows) == 1:
            topic.world = str(getattr(header, "frame_id", ""))
            topic.body = str(getattr(message, "child_frame_id", "")) or topic.world
    return [topic for topic in wanted.values() if topic.rows]


def _numbers(message: Any, kind: str, fields: list[str]) -> dict[str, float]:
    """The numbers of a ``message`` that are kept; fields: of a type that is not known here."""
    if kind == "JointState":
        parts = (("position", message.position), ("velocity", message.velocity))
        return {f"{n} {what}": float(v) for what, values in parts for n, v in zip(message.name, values, strict=False)}
    if kind == "NavSatFix":
        fixed = message.status.status >= 0  # sensor_msgs/NavSatStatus: -1 is no fix
        return {"latitude": float(message.latitude), "longitude": float(message.longitude)} if fixed else {}
    if kind not in RANKS:
        return {name: float(getattr(message, name)) for name in fields}
    values: dict[str, float] = {}
    pose, twist = _inner(message, "pose"), _inner(message, "twist")
    if hasattr(pose, "position"):
        values |= {"px": pose.position.x, "py": pose.position.y}
    turned = getattr(pose, "orientation", getattr(message, "quaternion", None))
    if turned is not None and getattr(message, "orientation_covariance", (0.0,))[0] != -1:  # it says that it has none
        values |= {f"q{axis}": getattr(turned, axis) for axis in "xyzw"}
    if hasattr(twist, "linear"):
        values |= {"ux": twist.linear.x, "uy": twist.linear.y, "rz": twist.angular.z}
    elif hasattr(message, "angular_velocity"):
        values |= {"rz": message.angular_velocity.z}
    return values


def _inner(message: Any, name: str) -> Any:
    """The pose or twist in a ``message``, below stamps and covariances."""
    while hasattr(message, name):
        message = getattr(message, name)
    return message


Columns = tuple[dict[str, tuple[Meaning, np.ndarray]], str]  # Header -> meaning and numbers (N,); the axes in words


def _columns(topic: Topic, ned: bool) -> Columns:
    """The columns of a ``topic``. ned: whether axes point down where frames do not say it."""
    names = dict.fromkeys(name for row in topic.rows for name in row)
    if topic.kind in RANKS and topic.kind not in ("JointState", "NavSatFix"):
        return _motion(topic, names, ned)
    columns = {}
    for name in names:
        header = topic.name if name == "data" else f"{topic.name} {name}"
        means = Meaning(name, "deg") if topic.kind == "NavSatFix" else _of_topic(header)
        if topic.kind == "JointState":  # of a shaft the velocity counts, of a rudder or pod the position
            joint, _, part = name.rpartition(" ")
            quantity, turns = _of_topic(joint).quantity, part == "velocity"
            fits = quantity.startswith("n" if turns else ("delta", "azimuth"))
            means = Meaning(quantity if fits else "", "rad/s" if turns else "rad")
        columns[header] = means, topic.column(name)
    return columns, ""


def _motion(topic: Topic, names: Iterable[str], ned: bool) -> Columns:
    """Poses, twists and inertial units in axes north-east-down and forward-starboard-down."""
    down, starboard = (ned or bool(re.search(DOWN, frame, re.IGNORECASE)) for frame in (topic.world, topic.body))
    sign, along = 1.0 if starboard else -1.0, ""  # of y and of turns about z
    columns: dict[str, tuple[Meaning, np.ndarray]] = {}
    if "qx" in names:
        psi = _heading(np.column_stack([topic.column(f"q{axis}") for axis in "xyzw"]), down)
        columns["orientation"] = Meaning("psi", "rad"), psi
    if "px" in names:
        north, east = (topic.column(name) for name in (("px", "py") if down else ("py", "px")))
        columns |= {"position north": (Meaning("x", "m"), north), "position east": (Meaning("y", "m"), east)}
    if "ux" in names:
        ux, uy = topic.column("ux"), topic.column("uy")
        velocity = ux + 1j * sign * uy  # ahead + 1j to starboard
        if "qx" in names:
            turned = (ux + 1j * uy if down else uy + 1j * ux) * np.exp(-1j * psi)  # from north + 1j east
            declared = topic.body == topic.world != ""
            if declared or ("px" in names and _fits_better(topic, velocity, turned, psi, north + 1j * east)):
                why = "as it says" if declared else "as its positions show"
                velocity, along = turned, f"; velocities along the axes of the world, {why}"
        columns["linear x"] = Meaning("u", "m/s"), velocity.real
        columns["linear y"] = Meaning("v", "m/s"), velocity.imag
    if "rz" in names:
        columns["angular z"] = Meaning("r", "rad/s"), sign * topic.column("rz")
    frames = f"{topic.world or 'no frame'}{f', {topic.body}' if topic.body != topic.world else ''}"
    axes = f"{'north-east-down' if down else 'ENU'}, {'FRD' if starboard else 'FLU'}{along}"
    return {f"{topic.name} {name}": column for name, column in columns.items()}, f"{topic.name} ({frames}) {axes}"


def _fits_better(topic: Topic, body: np.ndarray, turned: np.ndarray, psi: np.ndarray, place: np.ndarray) -> bool:
    """Whether a ``place`` (N,) [m, north + 1j east] moves as the ``turned`` velocities (N,) [m/s, ahead + 1j to
    starboard] say, not as those of the ``body``: by their definition messages hold the latter, but some drivers write
    the former. psi: (N,) [rad]."""
    h = np.diff(topic.stamps if min(topic.stamps) > 0 else topic.received)
    middle = np.exp(1j * psi[:-1]) * np.exp(0.5j * np.angle(np.exp(1j * np.diff(psi))))  # exp(i psi) between two rows
    off = []
    for velocity in (body, turned):
        apart = np.abs(np.diff(place) - h * 0.5 * (velocity[1:] + velocity[:-1]) * middle)
        off.append(float(np.median(apart[np.isfinite(apart)])) if np.isfinite(apart).any() else np.inf)
    return off[1] < 0.5 * off[0]  # 0.5: set by hand; the definition of the message stands where little shows


def _heading(q: np.ndarray, down: bool) -> np.ndarray:
    """Headings (N,) clockwise from north [rad] of quaternions (N, 4) x, y, z, w; NaN where one is none."""
    q = np.where(np.abs(q) < 2, q, np.nan)  # those of rotations have the length 1
    x, y, z, w = np.where((np.linalg.norm(q, axis=1) > 0.5)[:, None], q, np.nan).T
    along, across = w**2 + x**2 - y**2 - z**2, 2 * (x * y + w * z)  # the body's x axis in the axes of the world
    return np.arctan2(across, along) if down else np.arctan2(along, across)


def _of_topic(topic: str) -> Meaning:
    """What the words at the end of a ``topic`` mean, the longest that mean something."""
    parts = [part for part in re.split(r"[/ ]", topic) if part]
    ends = (meaning("_".join(parts[first:])) for first in range(len(parts)))
    return next((end for end in ends if end.quantity or end.may_be), meaning(topic))

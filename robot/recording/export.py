"""Export of a session to one file for other programs: CSV, or MCAP for viewers, with the robot's pose.

An MCAP file for viewers contains the ticks and trials of the recording, and one topic per subsystem, with units in its
schema (see tabular). Times are wall-clock times. Images, reasons, pose and scene use Foxglove's schemas as JSON. A test
compares the names and types of their fields with the official schemas (https://docs.foxglove.dev/docs/sdk/schemas);
optional fields are omitted. A scene contains lines and texts; its other primitives are empty lists. Lengths are in m,
and colours range from 0 to 1. The session's metadata is attached to the file. Messages are written as the ticks are
read.

The pose is given in the frame "target". Its origin is on the floor below the middle of the target; x points from the
target toward the robot, z points up, and y completes a right-handed frame (to the right as the robot sees it). The pose
uses the horizontal distance from the ball's exit to the target plane and, if the camera provides it, the bearing of the
target. It assumes that the robot stands straight in front of the target (y = 0) and that the camera points in the
direction of launch. Without a bearing the robot faces the target.
"""

import base64
import csv
import math
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import IO, Any, NamedTuple

import msgspec
from mcap.writer import Writer

from truearc.hw.reason import unit_of
from truearc.robot.config.rig_spec import Target
from truearc.robot.reasons import texts
from truearc.robot.recording import reader, tabular
from truearc.robot.recording import session as layout
from truearc.robot.recording.files import TickFile, load_pictures
from truearc.robot.recording.tabular import Column, FlatTicks, Value
from truearc.robot.types import Shot, Tick

# --- the pose

ASSUMED = (
    "frame target: origin on the floor below the middle of the target, x toward the robot, z up. Known: distance (ball "
    "exit to target plane) and bearing, if the camera gave one. Assumed: the robot is straight in front of the target "
    "(y = 0) and the camera looks where the launcher throws")


class FieldPose(NamedTuple):
    """The point on the floor below the ball's exit, in m, and the direction of the throw, anticlockwise from x, in
    rad."""

    x_m: float
    y_m: float
    yaw_rad: float


def pose_of(tick: Tick) -> FieldPose | None:
    """Return the pose at a tick; None while no distance is known."""
    if tick.estimate.distance_m is None:
        return None
    sighting = tick.memory.last_sighting
    bearing_deg = 0.0 if sighting is None or sighting.bearing_deg is None else sighting.bearing_deg
    return FieldPose(tick.estimate.distance_m, 0.0, math.remainder(math.pi + math.radians(bearing_deg), 2.0 * math.pi))


def in_target_frame(distance_m: float, x_m: float, y_m: float, z_m: float) -> tuple[float, float, float]:
    """Transform a point of the launcher's frame (x toward the target, y left, z up from the floor) for a robot at a
    distance."""
    return distance_m - x_m, -y_m, z_m


# --- messages for viewers

S_NS = 1_000_000_000
INFO, WARNING = 2, 3                  # levels of foxglove.Log
LINE_STRIP, LINE_LIST = 0, 2          # kinds of foxglove.LinePrimitive
TARGET, ROBOT, CAMERA = "target", "robot", "camera"
NO_TURN = {"x": 0.0, "y": 0.0, "z": 0.0, "w": 1.0}
ORIGIN = {"position": {"x": 0.0, "y": 0.0, "z": 0.0}, "orientation": NO_TURN}
Point = tuple[float, float, float]
Colour = tuple[float, float, float, float]
IMAGE, LOG, POSE, TRANSFORM, SCENE = "/camera/image", "/log", "/pose", "/tf", "/scene"
DRAWN = {IMAGE: "foxglove.CompressedImage", LOG: "foxglove.Log", POSE: "foxglove.PoseInFrame",
         TRANSFORM: "foxglove.FrameTransform", SCENE: "foxglove.SceneUpdate"}
ATTACHED = {".json": "application/json", ".jsonl": "application/x-ndjson", ".toml": "application/toml",
            ".onnx": "application/octet-stream"}
THICK_M, LETTER_M = 0.02, 0.12
GREY = (0.6, 0.6, 0.6, 1.0)
COLOURS = {"three": (0.1, 0.7, 0.2, 1.0), "two": (0.9, 0.7, 0.1, 1.0), "hit": (0.1, 0.7, 0.2, 1.0)}
MISSED = (0.85, 0.15, 0.15, 1.0)


_UNUSED = ("arrows", "cubes", "spheres", "cylinders", "triangles", "models")


def _schema(kind: str, what: str = "") -> dict[str, Any]:
    """JSON schema of a kind of value, as viewer.toml says."""
    if kind.endswith("[]"):
        return {"type": "array", "items": _schema(kind[:-2]), "description": what}
    if kind in tabular.TYPES.values():
        return {"type": kind} | ({"description": what} if what else {})
    said = tabular.VIEWER["foxglove"].get(kind)
    if said is None:
        return tabular.object_schema(kind, "none", {})
    if "title" in said:
        return dict(said)
    fields = {name: _schema(*field.split(" ", 1)) if isinstance(field, str) else field
              for name, field in said.items() if name != "about"}
    return tabular.object_schema(f"foxglove.{kind}", said["about"], fields) | {"required": list(fields)}


SCHEMAS = {name: _schema(name.removeprefix("foxglove.")) for name in DRAWN.values()}


def stamp(t_ns: int) -> dict[str, int]:
    return {"sec": t_ns // S_NS, "nsec": t_ns % S_NS}


def image(t_ns: int, data: bytes, kind: str) -> dict[str, Any]:
    """Return the foxglove.CompressedImage of a picture's file."""
    return {"timestamp": stamp(t_ns), "frame_id": CAMERA, "data": base64.b64encode(data).decode(), "format": kind}


def log(t_ns: int, level: int, message: str) -> dict[str, Any]:
    """Return a foxglove.Log."""
    return {"timestamp": stamp(t_ns), "level": level, "message": message, "name": "verdict", "file": "", "line": 0}


def pose_in_frame(t_ns: int, pose: FieldPose) -> dict[str, Any]:
    """Return the foxglove.PoseInFrame of the robot before the target."""
    return {"timestamp": stamp(t_ns), "frame_id": TARGET,
            "pose": {"position": _place(pose), "orientation": _turn(pose)}}


def transform(t_ns: int, pose: FieldPose) -> dict[str, Any]:
    """Return the foxglove.FrameTransform of the robot before the target."""
    return {"timestamp": stamp(t_ns), "parent_frame_id": TARGET, "child_frame_id": ROBOT,
            "translation": _place(pose), "rotation": _turn(pose)}


def scene(t_ns: int, name: str, notes: dict[str, str], lines: Iterable[dict[str, Any]],
          texts: Iterable[dict[str, Any]] = ()) -> dict[str, Any]:
    """Return a foxglove.SceneUpdate of one entity before the target, which stays until it is replaced."""
    entity = {"timestamp": stamp(t_ns), "frame_id": TARGET, "id": name, "lifetime": stamp(0), "frame_locked": False,
              "metadata": [{"key": key, "value": value} for key, value in notes.items()],
              "lines": list(lines), "texts": list(texts), **{kind: [] for kind in _UNUSED}}
    return {"deletions": [], "entities": [entity]}


def line(kind: int, points: Iterable[Point], thickness_m: float, colour: Colour) -> dict[str, Any]:
    """Return a foxglove.LinePrimitive."""
    return {"type": kind, "pose": ORIGIN, "thickness": thickness_m, "scale_invariant": False,
            "points": [dict(zip("xyz", point, strict=True)) for point in points], "color": _colour(colour),
            "colors": [], "indices": []}


def words(text: str, at: Point, size_m: float, colour: Colour) -> dict[str, Any]:
    """Return a foxglove.TextPrimitive that faces the viewer."""
    return {"pose": {"position": dict(zip("xyz", at, strict=True)), "orientation": NO_TURN}, "billboard": True,
            "font_size": size_m, "scale_invariant": False, "color": _colour(colour), "text": text}


def _place(pose: FieldPose) -> dict[str, float]:
    return {"x": pose.x_m, "y": pose.y_m, "z": 0.0}


def _turn(pose: FieldPose) -> dict[str, float]:
    return {"x": 0.0, "y": 0.0, "z": math.sin(pose.yaw_rad / 2.0), "w": math.cos(pose.yaw_rad / 2.0)}


def _colour(colour: Colour) -> dict[str, float]:
    return dict(zip("rgba", colour, strict=True))


class Flights(NamedTuple):
    """Flights of shots under a belief: {trial: its points before the target}, their description, and the belief's
    files."""

    points: Mapping[int, Sequence[Point]]
    what: str
    files: tuple[Path, ...]


NO_FLIGHTS = Flights({}, "none: a belief is needed (--belief)", ())


class ViewerMessages:
    """Adds a session's topics for viewers to an MCAP; `images_lost` counts pictures whose file is missing."""

    def __init__(self, mcap: Writer, session: Path, flat: FlatTicks, target: Target | None,
                 trials: Sequence[layout.Trial], wall: layout.WallTime, flights: Flights) -> None:
        self._mcap, self._session, self._flat, self._wall, self._flights = mcap, session, flat, wall, flights
        self._topics = [(topic, self._channel(topic.name, topic.schema)) for topic in tabular.topics_of(flat.columns)]
        self._drawn = {topic: self._channel(topic, SCHEMAS[name]) for topic, name in DRAWN.items()}
        self._marks = {trial.outcome.trial: trial.outcome.outcome for trial in trials}
        self._pictures = sorted(load_pictures(session), key=lambda picture: picture.t_ns)
        self._target = target
        self._is_begun = False
        self._reasons: tuple[str, ...] | None = None
        self._pose: FieldPose | None = None
        self.images_lost = 0

    def write(self, tick: Tick) -> None:
        """Write what viewers show of a tick, and the pictures since the last one."""
        t_ns = tick.inputs.t_ns + self._wall.offset_ns
        if not self._is_begun:
            self._begin(t_ns)
        row = self._flat.row(tick)
        for topic, channel in self._topics:
            message = topic.message(row)
            if message is not None:
                self._mcap.add_message(channel, t_ns, message, t_ns)
        while self._pictures and self._pictures[0].t_ns <= tick.inputs.t_ns:
            self._write_picture(self._pictures.pop(0))
        self._write_reasons(t_ns, tick)
        self._write_pose(t_ns, pose_of(tick))
        if tick.shot is not None:
            self._draw_flight(t_ns, tick.shot)

    def _begin(self, t_ns: int) -> None:
        self._is_begun = True
        self._mcap.add_metadata("truearc", {"session": self._session.resolve().name, "time": self._wall.how,
                                            "pose": ASSUMED, "flights": self._flights.what})
        aims = sorted((self._session / layout.AIMS).glob("*.json"))
        names = (layout.HEADER, layout.CONFIG, layout.MODEL, layout.AIM)
        for path in (*(self._session / name for name in names), *aims, *self._flights.files):
            if path.is_file():
                name = path.relative_to(self._session).as_posix() if self._session in path.parents else path.name
                self._mcap.add_attachment(0, t_ns, name, ATTACHED.get(path.suffix, "text/plain"), path.read_bytes())
        if self._target is not None:
            self._draw_target(t_ns, self._target)

    def _write_picture(self, picture: layout.Picture) -> None:
        path = self._session / layout.FRAMES / picture.file
        if not path.is_file():
            self.images_lost += 1
            return
        t_ns = picture.t_ns + self._wall.offset_ns
        self._draw(IMAGE, t_ns, image(t_ns, path.read_bytes(), path.suffix.lstrip(".")))

    def _write_reasons(self, t_ns: int, tick: Tick) -> None:
        codes = tuple(reason.code for reason in tick.verdict.reasons)
        if codes != self._reasons:
            self._reasons = codes
            level = WARNING if codes and tick.memory.request_t_ns else INFO
            said = f"HOLD: {'; '.join(texts(tick.verdict.reasons))}" if codes else "FIRE"
            self._draw(LOG, t_ns, log(t_ns, level, said))

    def _write_pose(self, t_ns: int, pose: FieldPose | None) -> None:
        if pose is not None and pose != self._pose:
            self._pose = pose
            self._draw(POSE, t_ns, pose_in_frame(t_ns, pose))
            self._draw(TRANSFORM, t_ns, transform(t_ns, pose))

    def _draw_target(self, t_ns: int, target: Target) -> None:
        """The opening's heights, as upright lines: a rig does not state how wide it is. None of one that faces up."""
        if target.faces_up:
            return
        lines = [line(LINE_LIST, [(0.0, 0.0, target.centre_height_m - half),
                                                    (0.0, 0.0, target.centre_height_m + half)], wide, colour)
                 for half, wide, colour in ((target.two_half_height_m, THICK_M, COLOURS["two"]),
                                            (target.three_half_height_m, 2.0 * THICK_M, COLOURS["three"])) if half]
        self._draw(SCENE, t_ns, scene(t_ns, "target", {"what": "heights of the opening; its width is not "
                                                                        "known"}, lines))

    def _draw_flight(self, t_ns: int, shot: Shot) -> None:
        points = self._flights.points.get(shot.trial)
        if not points:
            return
        mark = self._marks.get(shot.trial, "not marked")
        colour = GREY if mark == "not marked" else COLOURS.get(mark, MISSED)
        self._draw(SCENE, t_ns, scene(
            t_ns, f"shot {shot.trial}", {"trial": str(shot.trial), "mark": mark, "what": self._flights.what},
            [line(LINE_STRIP, points, THICK_M, colour)],
            [words(f"{shot.trial}: {mark}", points[-1], LETTER_M, colour)]))

    def _draw(self, topic: str, t_ns: int, message: dict[str, Any]) -> None:
        self._mcap.add_message(self._drawn[topic], t_ns, msgspec.json.encode(message), t_ns)

    def _channel(self, topic: str, schema: dict[str, Any]) -> int:
        made = self._mcap.register_schema(schema["title"], "jsonschema", msgspec.json.encode(schema))
        return int(self._mcap.register_channel(topic, "json", made))


# --- the file

_KINDS = {"trial": tabular.INT, "outcome_t_ns": tabular.INT, "outcome": tabular.TEXT, "reasons": tabular.TEXTS,
          "shot_t_ns": tabular.INT, "config_id": tabular.TEXT}
TRIAL_COLUMNS = tuple(Column(name, _KINDS.get(name, tabular.FLOAT), unit_of(name)) for name in (
    *_KINDS, "distance_m", "distance_sigma_m", "hood_deg", "motor_ratio", "motor_rad_s", "battery_v",
    "since_last_shot_s", "p_two", "p_three"))


class ExportRows:
    """A session's ticks as flat rows of `columns`; afterwards `count` and the reader's `cut_short`.

    Trials that trials.jsonl lacks are taken from the ticks and counted in `missing`; `unlike` counts those on which the
    two disagree, for which trials.jsonl is used.
    """

    def __init__(self, session: Path, progress: Callable[[float, str], None]) -> None:
        self.session, self.header = session, layout.load_header(session)
        self.config = layout.load_session_config(session)
        self.flat = FlatTicks(len(self.config.axes.flywheels))
        self.columns = self.flat.columns
        self.trials = layout.load_trials(session)
        self.count = self.missing = self.unlike = 0
        self._filed = {trial.outcome.trial: trial for trial in self.trials}
        self._told: dict[int, layout.Trial] = {}         # what the ticks say
        self._due: deque[layout.Trial] = deque()
        self.reader = reader.TickReader(session)
        self._progress = progress

    def __iter__(self) -> Iterator[list[Value]]:
        for tick, _ in self.ticks():
            yield self.flat.row(tick)

    def ticks(self) -> Iterator[tuple[Tick, bytes]]:
        for tick, data in self.reader:
            self.count += 1
            self._progress(min(self.reader.share, 0.99), f"{self.count} ticks")
            if tick.outcomes:
                self._compare(tick)
            yield tick, data
        missing = [trial for number, trial in self._told.items() if number not in self._filed]
        self.missing = len(missing)
        self.unlike = sum(trial != self._filed.get(number, trial) for number, trial in self._told.items())
        self.trials = sorted([*self.trials, *missing], key=lambda trial: trial.outcome.trial)

    def _compare(self, tick: Tick) -> None:
        for trial in layout.make_trials(tick):
            self._told[trial.outcome.trial] = trial
            if trial.outcome.trial not in self._filed:
                self._due.appendleft(trial)       # it was marked in this tick

    def trials_in_time(self) -> deque[layout.Trial]:
        """Trials that are still to be written, by the time of marking; reading ticks may add to it."""
        self._due = deque(sorted(self.trials, key=lambda trial: trial.outcome.t_ns))
        return self._due


def trial_row(trial: layout.Trial) -> list[Value]:
    """Return one marked trial under TRIAL_COLUMNS."""
    outcome, shot = trial.outcome, trial.shot
    row: list[Value] = [outcome.trial, outcome.t_ns, outcome.outcome, texts(outcome.reasons)]
    names = [column.name.removeprefix("shot_") for column in TRIAL_COLUMNS[len(row):]]
    return row + [None if shot is None else getattr(shot, name) for name in names]


def write_csv(columns: tuple[Column, ...], rows: Iterator[list[Value]], path: Path) -> None:
    """Write a header of names that end in their units, and a line per row; lists are joined by '; ', absent cells
    empty."""
    with path.open("w", encoding="utf-8", newline="") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow([column.name for column in columns])
        for row in rows:
            writer.writerow([_cell(column.kind, value) for column, value in zip(columns, row, strict=True)])


def write_mcap(rows: ExportRows, file: IO[bytes], flights: Flights = NO_FLIGHTS) -> int:
    """Write the recording's ticks and trials to one complete file, even if it is truncated or lacks /trial, with topics
    for viewers and wall-clock times. Return how many images are missing."""
    out, wall, trials = TickFile(file), layout.wall_time(rows.header), rows.trials_in_time()
    viewer = ViewerMessages(out.mcap, rows.session, rows.flat, rows.config.rig.target, rows.trials, wall, flights)

    def write_trials(t_ns: int | None) -> None:
        for trial in due(trials, t_ns):
            out.write_trial(trial.outcome.t_ns + wall.offset_ns, layout.encode_row(trial))

    for tick, data in rows.ticks():
        out.write(tick.inputs.t_ns + wall.offset_ns, data)
        viewer.write(tick)
        write_trials(tick.inputs.t_ns)
    write_trials(None)
    out.finish()
    return viewer.images_lost


def due(trials: deque[layout.Trial], t_ns: int | None = None) -> Iterator[layout.Trial]:
    """Take from the front the trials marked by a time; all of them without one."""
    while trials and (t_ns is None or trials[0].outcome.t_ns <= t_ns):
        yield trials.popleft()


def _cell(kind: str, value: Value) -> object:
    if kind == tabular.BOOL and value is not None:
        return "true" if value else "false"
    if kind in (tabular.TEXTS, tabular.FLOATS) and isinstance(value, list | tuple):
        return "; ".join(map(str, value))
    return value

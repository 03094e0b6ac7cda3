"""A session as one MCAP that viewers open well, beside the ticks and trials of the recording itself.

Times are the wall clock's. Every subsystem has a topic with units in its schema (by_subsystem); images, reasons, pose
and scene have Foxglove's schemas (foxglove); what made the session is attached. Written as the ticks are read.
"""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import msgspec
from mcap.writer import Writer

from truearc.robot.config.rig_spec import Target
from truearc.robot.reasons import texts
from truearc.robot.recording import session as layout
from truearc.robot.recording.export import foxglove
from truearc.robot.recording.export.by_subsystem import topics_of
from truearc.robot.recording.export.field_pose import ASSUMED, FieldPose, pose_of
from truearc.robot.recording.export.tabular import FlatTicks
from truearc.robot.recording.files import load_pictures
from truearc.robot.types import Shot, Tick

IMAGE, LOG, POSE, TRANSFORM, SCENE = "/camera/image", "/log", "/pose", "/tf", "/scene"
DRAWN = {IMAGE: "foxglove.CompressedImage", LOG: "foxglove.Log", POSE: "foxglove.PoseInFrame",
         TRANSFORM: "foxglove.FrameTransform", SCENE: "foxglove.SceneUpdate"}
ATTACHED = {".json": "application/json", ".jsonl": "application/x-ndjson", ".toml": "application/toml",
            ".onnx": "application/octet-stream"}
THICK_M, LETTER_M = 0.02, 0.12
GREY = (0.6, 0.6, 0.6, 1.0)
COLOURS = {"three": (0.1, 0.7, 0.2, 1.0), "two": (0.9, 0.7, 0.1, 1.0), "hit": (0.1, 0.7, 0.2, 1.0)}
MISSED = (0.85, 0.15, 0.15, 1.0)


class Flights(NamedTuple):
    """Flights of shots by a belief: {trial: its points before the target}, what they are, and the belief's files."""

    points: Mapping[int, Sequence[foxglove.Point]]
    what: str
    files: tuple[Path, ...]


NO_FLIGHTS = Flights({}, "none: a belief is needed (--belief)", ())


class ViewerMessages:
    """Adds a session's topics for viewers to an MCAP; `images_lost` counts pictures whose file is missing."""

    def __init__(self, mcap: Writer, session: Path, flat: FlatTicks, target: Target | None,
                 trials: Sequence[layout.Trial], wall: layout.WallTime, flights: Flights) -> None:
        self._mcap, self._session, self._flat, self._wall, self._flights = mcap, session, flat, wall, flights
        self._topics = [(topic, self._channel(topic.name, topic.schema)) for topic in topics_of(flat.columns)]
        self._drawn = {topic: self._channel(topic, foxglove.SCHEMAS[name]) for topic, name in DRAWN.items()}
        self._marks = {trial.outcome.trial: trial.outcome.outcome for trial in trials}
        self._pictures = sorted(load_pictures(session), key=lambda picture: picture.t_ns)
        self._target = target
        self._is_begun = False
        self._reasons: tuple[str, ...] | None = None
        self._pose: FieldPose | None = None
        self.images_lost = 0

    def write(self, tick: Tick) -> None:
        """What viewers show of a tick, and the pictures since the last one."""
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
        self._draw(IMAGE, t_ns, foxglove.image(t_ns, path.read_bytes(), path.suffix.lstrip(".")))

    def _write_reasons(self, t_ns: int, tick: Tick) -> None:
        codes = tuple(reason.code for reason in tick.verdict.reasons)
        if codes != self._reasons:
            self._reasons = codes
            level = foxglove.WARNING if codes and tick.memory.request_t_ns else foxglove.INFO
            said = f"HOLD: {'; '.join(texts(tick.verdict.reasons))}" if codes else "FIRE"
            self._draw(LOG, t_ns, foxglove.log(t_ns, level, said))

    def _write_pose(self, t_ns: int, pose: FieldPose | None) -> None:
        if pose is not None and pose != self._pose:
            self._pose = pose
            self._draw(POSE, t_ns, foxglove.pose_in_frame(t_ns, pose))
            self._draw(TRANSFORM, t_ns, foxglove.transform(t_ns, pose))

    def _draw_target(self, t_ns: int, target: Target) -> None:
        """The opening's heights, as upright lines: a rig does not state how wide it is."""
        lines = [foxglove.line(foxglove.LINE_LIST, [(0.0, 0.0, target.centre_height_m - half),
                                                    (0.0, 0.0, target.centre_height_m + half)], wide, colour)
                 for half, wide, colour in ((target.two_half_height_m, THICK_M, COLOURS["two"]),
                                            (target.three_half_height_m, 2.0 * THICK_M, COLOURS["three"])) if half]
        self._draw(SCENE, t_ns, foxglove.scene(t_ns, "target", {"what": "heights of the opening; its width is not "
                                                                        "known"}, lines))

    def _draw_flight(self, t_ns: int, shot: Shot) -> None:
        points = self._flights.points.get(shot.trial)
        if not points:
            return
        mark = self._marks.get(shot.trial, "not marked")
        colour = GREY if mark == "not marked" else COLOURS.get(mark, MISSED)
        self._draw(SCENE, t_ns, foxglove.scene(
            t_ns, f"shot {shot.trial}", {"trial": str(shot.trial), "mark": mark, "what": self._flights.what},
            [foxglove.line(foxglove.LINE_STRIP, points, THICK_M, colour)],
            [foxglove.words(f"{shot.trial}: {mark}", points[-1], LETTER_M, colour)]))

    def _draw(self, topic: str, t_ns: int, message: dict[str, Any]) -> None:
        self._mcap.add_message(self._drawn[topic], t_ns, msgspec.json.encode(message), t_ns)

    def _channel(self, topic: str, schema: dict[str, Any]) -> int:
        made = self._mcap.register_schema(schema["title"], "jsonschema", msgspec.json.encode(schema))
        return int(self._mcap.register_channel(topic, "json", made))

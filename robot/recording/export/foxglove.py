"""Foxglove's schemas for what viewers draw: image, log, pose, transform and scene; as JSON, and messages that fit.

Names and types of the fields are those of the official schemas (https://docs.foxglove.dev/docs/sdk/schemas), which a
test compares; the fields that those leave optional are left out. Of a scene's primitives, lines and texts are described
and the others are empty lists. Lengths in m, colours from 0 to 1.
"""

import base64
import math
from collections.abc import Callable, Iterable
from typing import Any

from truearc.robot.recording.export.by_subsystem import object_schema
from truearc.robot.recording.export.field_pose import FieldPose

S_NS = 1_000_000_000
INFO, WARNING = 2, 3                  # levels of foxglove.Log
LINE_STRIP, LINE_LIST = 0, 2          # kinds of foxglove.LinePrimitive
TARGET, ROBOT, CAMERA = "target", "robot", "camera"
NO_TURN = {"x": 0.0, "y": 0.0, "z": 0.0, "w": 1.0}
ORIGIN = {"position": {"x": 0.0, "y": 0.0, "z": 0.0}, "orientation": NO_TURN}
Point = tuple[float, float, float]
Colour = tuple[float, float, float, float]


def _nested(kind: str, about: str, /, **properties: dict[str, Any]) -> dict[str, Any]:
    return object_schema(f"foxglove.{kind}", about, properties) | {"required": list(properties)}


def _of_type(kind: str) -> Callable[[str], dict[str, Any]]:
    return lambda what: {"type": kind, "description": what}


def _several(items: dict[str, Any], what: str) -> dict[str, Any]:
    return {"type": "array", "items": items, "description": what}


def _time(title: str, what: str) -> dict[str, Any]:
    whole = {"type": "integer", "minimum": 0}
    return {"title": title, "type": "object", "description": what,
            "properties": {"sec": {**whole, "description": "unit: s"},
                           "nsec": {**whole, "maximum": S_NS - 1, "description": "unit: ns"}}}


_number, _text, _flag, _integer = map(_of_type, ("number", "string", "boolean", "integer"))
_STAMP = _time("time", "wall clock, since 1970")
_METRE = {axis: _number("unit: m") for axis in "xyz"}
_POINT, _VECTOR = _nested("Point3", "place", **_METRE), _nested("Vector3", "place", **_METRE)
_TURN = _nested("Quaternion", "orientation", **{axis: _number("unit: 1") for axis in "xyzw"})
_COLOUR = _nested("Color", "colour", **{part: _number("0 to 1") for part in "rgba"})
_POSE = _nested("Pose", "pose", position=_VECTOR, orientation=_TURN)
_PAIR = _nested("KeyValuePair", "a note", key=_text("name"), value=_text("value"))
_LINE = _nested("LinePrimitive", "points that lines join",
                type=_integer("0: one strip, 2: every two points"), pose=_POSE,
                thickness=_number("unit: m"), scale_invariant=_flag("thickness in pixels"),
                points=_several(_POINT, "in the entity's frame"), color=_COLOUR,
                colors=_several(_COLOUR, "of each point; empty: all alike"),
                indices=_several({"type": "integer"}, "empty: the points in their order"))
_WORDS = _nested("TextPrimitive", "a text", pose=_POSE, billboard=_flag("turned to whoever looks"),
                 font_size=_number("unit: m"), scale_invariant=_flag("size in pixels"), color=_COLOUR,
                 text=_text("text"))
_UNUSED = ("arrows", "cubes", "spheres", "cylinders", "triangles", "models")
_ENTITY = _nested("SceneEntity", "something drawn", timestamp=_STAMP, frame_id=_text("frame"),
                  id=_text("replaces what had it before"), lifetime=_time("duration", "0: until replaced"),
                  frame_locked=_flag("moves with its frame"), metadata=_several(_PAIR, "notes"),
                  lines=_several(_LINE, "lines"), texts=_several(_WORDS, "texts"),
                  **{name: _several(object_schema(name, "none", {}), "always empty") for name in _UNUSED})

SCHEMAS = {
    "foxglove.CompressedImage": _nested(
        "CompressedImage", "image behind a shot; the time is the middle of its exposure", timestamp=_STAMP,
        frame_id=_text("frame"), data={**_text("file"), "contentEncoding": "base64"}, format=_text("png")),
    "foxglove.Log": _nested(
        "Log", "why the robot holds, when that changes", timestamp=_STAMP,
        level=_integer("2 info, 3 warning"), message=_text("reasons"), name=_text("part"),
        file=_text("empty"), line={"type": "integer", "minimum": 0, "description": "0"}),
    "foxglove.PoseInFrame": _nested("PoseInFrame", "robot before the target", timestamp=_STAMP,
                                    frame_id=_text("frame"), pose=_POSE),
    "foxglove.FrameTransform": _nested(
        "FrameTransform", "robot before the target", timestamp=_STAMP, parent_frame_id=_text("frame"),
        child_frame_id=_text("frame"), translation=_VECTOR, rotation=_TURN),
    "foxglove.SceneUpdate": _nested(
        "SceneUpdate", "target and flights of the balls",
        deletions=_several(object_schema("deletion", "none", {}), "always empty"),
        entities=_several(_ENTITY, "drawn or replaced")),
}


def stamp(t_ns: int) -> dict[str, int]:
    return {"sec": t_ns // S_NS, "nsec": t_ns % S_NS}


def image(t_ns: int, data: bytes, kind: str) -> dict[str, Any]:
    """foxglove.CompressedImage of a picture's file."""
    return {"timestamp": stamp(t_ns), "frame_id": CAMERA, "data": base64.b64encode(data).decode(), "format": kind}


def log(t_ns: int, level: int, message: str) -> dict[str, Any]:
    """foxglove.Log."""
    return {"timestamp": stamp(t_ns), "level": level, "message": message, "name": "verdict", "file": "", "line": 0}


def pose_in_frame(t_ns: int, pose: FieldPose) -> dict[str, Any]:
    """foxglove.PoseInFrame of the robot before the target."""
    return {"timestamp": stamp(t_ns), "frame_id": TARGET,
            "pose": {"position": _place(pose), "orientation": _turn(pose)}}


def transform(t_ns: int, pose: FieldPose) -> dict[str, Any]:
    """foxglove.FrameTransform of the robot before the target."""
    return {"timestamp": stamp(t_ns), "parent_frame_id": TARGET, "child_frame_id": ROBOT,
            "translation": _place(pose), "rotation": _turn(pose)}


def scene(t_ns: int, name: str, notes: dict[str, str], lines: Iterable[dict[str, Any]],
          texts: Iterable[dict[str, Any]] = ()) -> dict[str, Any]:
    """foxglove.SceneUpdate of one entity before the target, which stays until it is replaced."""
    entity = {"timestamp": stamp(t_ns), "frame_id": TARGET, "id": name, "lifetime": stamp(0), "frame_locked": False,
              "metadata": [{"key": key, "value": value} for key, value in notes.items()],
              "lines": list(lines), "texts": list(texts), **{kind: [] for kind in _UNUSED}}
    return {"deletions": [], "entities": [entity]}


def line(kind: int, points: Iterable[Point], thickness_m: float, colour: Colour) -> dict[str, Any]:
    """foxglove.LinePrimitive."""
    return {"type": kind, "pose": ORIGIN, "thickness": thickness_m, "scale_invariant": False,
            "points": [dict(zip("xyz", point, strict=True)) for point in points], "color": _colour(colour),
            "colors": [], "indices": []}


def words(text: str, at: Point, size_m: float, colour: Colour) -> dict[str, Any]:
    """foxglove.TextPrimitive, turned to whoever looks."""
    return {"pose": {"position": dict(zip("xyz", at, strict=True)), "orientation": NO_TURN}, "billboard": True,
            "font_size": size_m, "scale_invariant": False, "color": _colour(colour), "text": text}


def _place(pose: FieldPose) -> dict[str, float]:
    return {"x": pose.x_m, "y": pose.y_m, "z": 0.0}


def _turn(pose: FieldPose) -> dict[str, float]:
    return {"x": 0.0, "y": 0.0, "z": math.sin(pose.yaw_rad / 2.0), "w": math.cos(pose.yaw_rad / 2.0)}


def _colour(colour: Colour) -> dict[str, float]:
    return dict(zip("rgba", colour, strict=True))

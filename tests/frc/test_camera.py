"""PhotonVision and Limelight over NetworkTables: distance by geometry of its own, latency, sigma, every trouble."""

import math
import struct
import time
from collections.abc import Mapping
from contextlib import suppress
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as some
from msgspec.structs import replace

from tests.frc.nt_server import Table
from tests.frc.test_advice import HZ, NS, Clock
from truearc.cli.common import SHIPPED
from truearc.hw.protocols import LinkLost
from truearc.hw.real.clock import MonotonicClock
from truearc.robot.config.schema import AprilTag, Config, load_config
from truearc.robot.types import Sighting
from truearc_frc.inputs import NtCamera, OwnNtCamera, keys_of_camera
from truearc_frc.keys import Reading
from truearc_frc.table import Nt4, Nt4Vision, nt4_of, with_nt4

KINDS = ("photonvision", "limelight")
TAG_M, BEHIND_M, LATENCY_S = 1.35, 0.6, 0.035
NOW_NS = 50 * NS


def config(kind: str, pitch_deg: float = 24.0, height_m: float = 0.6, **vision: float) -> Config:
    shipped = load_config(SHIPPED)
    camera = replace(shipped.camera, pitch_deg=pitch_deg, height_m=height_m)
    facts = replace(shipped, camera=camera, tick_hz=HZ, apriltag=AprilTag((4, 7), 0.1651, TAG_M, BEHIND_M),
                    gate=replace(shipped.gate, policy="model", reading_age_s=0.5, sighting_age_s=0.5))
    return with_nt4(facts, Nt4("254", Nt4Vision(kind, "front", **{"sigma_m": 0.03, **vision})))  # type: ignore[arg-type]


def seen_by(kind: str, distance_m: float, bearing_deg: float, pitch_deg: float, height_m: float) -> list[float]:
    """The tag's place in the camera's axes, by a rotation matrix."""
    right = math.radians(bearing_deg)
    world = np.array([distance_m * math.cos(right), -distance_m * math.sin(right), TAG_M - height_m])
    c, s = math.cos(math.radians(pitch_deg)), math.sin(math.radians(pitch_deg))
    axes = np.array([[c, 0.0, s], [0.0, 1.0, 0.0], [-s, 0.0, c]])       # rows: ahead, left, up
    ahead, left, up = axes @ world
    return [ahead, left, up] if kind == "photonvision" else [-left, -up, ahead]


def keys(kind: str, place: list[float], t_ns: int = NOW_NS, **other: float) -> dict[str, Reading]:
    if kind == "photonvision":
        table, pose = "/photonvision/front", "targetPose"
        values = {"heartbeat": 5.0, "hasTarget": 1.0, "latencyMillis": 1e3 * LATENCY_S}
    else:
        table, pose = "/front", "targetpose_cameraspace"
        values = {"hb": 5.0, "tv": 1.0, "cl": 20.0, "tl": 1e3 * LATENCY_S - 20.0, "stddevs/0": 0.03, "stddevs/1": 0.04,
                  "tid": 7.0}
    values |= {f"{pose}/{axis}": value for axis, value in enumerate(place)} | other
    return {f"{table}/{name}": Reading(t_ns, value) for name, value in values.items()}


def look(kind: str, found: Mapping[str, Reading], **facts: float) -> Sighting | None:
    return NtCamera(config(kind, **facts), Table(found), Clock()).read()


@pytest.mark.parametrize("kind", KINDS)
@given(some.floats(1.0, 8.0), some.floats(-30.0, 30.0), some.floats(-10.0, 40.0), some.floats(0.2, 1.2))
def test_the_distance_is_horizontal_to_the_target_plane(kind, distance_m, bearing_deg, pitch_deg, height_m):
    place = seen_by(kind, distance_m, bearing_deg, pitch_deg, height_m)
    seen = look(kind, keys(kind, place), pitch_deg=pitch_deg, height_m=height_m, sigma_share=0.01)
    assert seen is not None and seen.found and seen.t_ns == NOW_NS - round(LATENCY_S * 1e9)
    assert seen.distance_m == pytest.approx(distance_m + BEHIND_M) and seen.bearing_deg == pytest.approx(bearing_deg)
    own = (0.03, 0.01 * (distance_m + BEHIND_M)) + ((0.03, 0.04) if kind == "limelight" else ())
    assert seen.sigma_m == pytest.approx(math.sqrt(sum(one * one for one in own)))


WELL = {kind: seen_by(kind, 3.0, 5.0, 24.0, 0.6) for kind in KINDS}


@pytest.mark.parametrize(("kind", "other", "reason"), [
    ("photonvision", {"hasTarget": 0.0}, "no_tag"), ("limelight", {"tv": 0.0}, "no_tag"),
    ("limelight", {"tid": 3.0}, "no_tag"), ("limelight", {"stddevs/1": math.nan}, "nt_value_impossible"),
    ("limelight", {"stddevs/0": -1.0}, "nt_value_impossible"), ("limelight", {"tl": math.nan}, "nt_value_impossible"),
    *(("limelight", {key: math.nan}, "nt_value_impossible") for key in ("tid", "tv", "hb", "cl")),
    *(("photonvision", {key: value}, "nt_value_impossible") for key, value in (
        ("hasTarget", 2.0), ("heartbeat", math.nan), ("latencyMillis", 1e9), ("latencyMillis", -1.0))),
    *((kind, {f"{pose}/{axis}": value}, "nt_value_impossible") for kind, pose in (
        ("photonvision", "targetPose"), ("limelight", "targetpose_cameraspace"))
      for axis in range(3) for value in (math.nan, math.inf)),
    ("photonvision", {"targetPose/2": WELL["photonvision"][2] + 1.2}, "pose_off_mounting"),
    ("limelight", {"targetpose_cameraspace/1": WELL["limelight"][1] - 1.2}, "pose_off_mounting"),
    ("photonvision", {f"targetPose/{axis}": 0.0 for axis in range(3)}, "nt_value_impossible")])
def test_a_doubtful_value_is_no_sighting(kind: str, other: dict[str, float], reason: str) -> None:
    if reason == "nt_value_impossible":
        with pytest.raises(LinkLost, match="nt_value_impossible"):
            look(kind, keys(kind, WELL[kind], **other))
        return
    seen = look(kind, keys(kind, WELL[kind], **other))
    assert seen is not None and not seen.found and seen.reason is not None and seen.reason.code == reason


@pytest.mark.parametrize("kind", KINDS)
def test_all_keys_are_asked_for_and_a_lost_server_is_named(kind: str) -> None:
    whole = keys(kind, WELL[kind])
    assert set(whole) == set(keys_of_camera(nt4_of(config(kind)).vision))           # type: ignore[union-attr]
    with pytest.raises(LinkLost, match="nt_lost"):
        NtCamera(config(kind), Table(whole, connected=False), Clock()).read()


@pytest.mark.parametrize("kind", KINDS)
def test_each_image_is_told_once_and_a_jump_silences_it_for_half_a_second(kind: str) -> None:
    table = Table({})
    camera = NtCamera(config(kind), table, Clock())
    answers = []
    for number in range(60):
        far = 1.5 if 20 <= number < 22 else 0.0
        place = seen_by(kind, 3.0 + far, 0.0, 24.0, 0.6)
        table.found = keys(kind, place, NOW_NS + number * 20_000_000)
        for again in range(2):
            try:
                seen = camera.read()
                assert (seen is None) == bool(again)
            except LinkLost as lost:
                assert lost.reason.code == "key_jumped"
                seen = None
            answers += [] if again else [seen]
    found = [one is not None and one.found for one in answers]
    assert all(found[:20]) and not any(found[20:46]) and all(found[48:])
    table.found = keys(kind, place, NOW_NS + 59 * 20_000_000, **{"hb" if kind == "limelight" else "heartbeat": 99.0})
    assert camera.read() is None                  # a place that has frozen is nothing new


def test_a_struct_on_a_real_server_is_read(nt_server: tuple[Any, str]) -> None:
    server, address = nt_server
    table = server.getTable("photonvision/front")
    pose, late = table.getRawTopic("targetPose").publish("struct:Transform3d"), table.getDoubleTopic("latencyMillis")
    alive, seen = table.getIntegerTopic("heartbeat").publish(), table.getBooleanTopic("hasTarget").publish()
    latency = late.publish()
    camera = OwnNtCamera(with_nt4(config("photonvision"), Nt4(address, Nt4Vision("photonvision", "front", 0.03))),
                         MonotonicClock())
    began, told = time.monotonic(), list[Sighting]()
    while len(told) < 3 and time.monotonic() - began < 10.0:
        count = round((time.monotonic() - began) * 1e3)
        place = seen_by("photonvision", 3.0 + 1e-6 * count, 5.0, 24.0, 0.6)
        pose.set(struct.pack("<7d", *place, 1.0, 0.0, 0.0, 0.0))
        latency.set(1e3 * LATENCY_S)
        seen.set(True)
        alive.set(count)
        server.flush()
        time.sleep(0.01)
        with suppress(LinkLost):                  # not connected yet
            told += [sighting] if (sighting := camera.read()) is not None else []
    camera.close()
    assert len(told) >= 3 and told[-1].found and told[-1].distance_m == pytest.approx(3.0 + BEHIND_M, abs=0.011)
    assert LATENCY_S <= (time.monotonic_ns() - told[-1].t_ns) / NS < LATENCY_S + 1.0

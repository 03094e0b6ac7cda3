"""The doctor and the machine: the interface as `ip` prints it, disk, time of day, permissions, camera, box, model."""

import struct
import sys
from pathlib import Path

import msgspec
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from msgspec.structs import replace

import truearc.hw.real.system
from tests.robot.gate.test_model import METADATA, build
from tests.robot.good_tick import CONFIG
from tests.robot.test_rig import Stream, Time
from truearc import robot
from truearc.cli.main import main
from truearc.hw.devices.button_box import make_heartbeat
from truearc.hw.devices.family import FAILURE, OK, WARNING, Heard
from truearc.hw.fault_codes import CAMERA_ERROR
from truearc.hw.protocols import CameraFrame, LinkLost
from truearc.hw.real.system import CanLink, Exposure, parse_link, read_exposure
from truearc.robot import doctor
from truearc.robot.config.rig_spec import Target

# As iproute2 prints a gs_usb adapter and a virtual interface.
CAN0 = ('[{"ifindex":3,"ifname":"can0","flags":["NOARP","UP","LOWER_UP","ECHO"],"mtu":16,"operstate":"UP",'
        '"txqlen":64,"link_type":"can","linkinfo":{"info_kind":"can","info_data":{"state":"ERROR-ACTIVE",'
        '"berr_counter":{"tx":0,"rx":0},"restart_ms":100,"bittiming":{"bitrate":1000000,"sample_point":"0.750"},'
        '"clock":48000000}}}]')
VCAN0 = ('[{"ifname":"vcan0","flags":["NOARP","UP","LOWER_UP"],"txqlen":1000,"link_type":"can",'
         '"linkinfo":{"info_kind":"vcan"}}]')
WELL = CanLink(True, 64, "ERROR-ACTIVE", 1_000_000, 100)
HEARD = Heard((None,) * 50, 1.0)


def test_an_interface_is_read_as_ip_prints_it_or_is_none(monkeypatch):
    assert parse_link(CAN0) == WELL and parse_link("{no") is None
    assert parse_link(VCAN0) == CanLink(True, 1000, None, None, None)
    monkeypatch.setenv("PATH", "")
    assert truearc.hw.real.system.read_link("can0") is None and truearc.hw.real.system.is_clock_synchronised() is None


@given(st.recursive(st.none() | st.booleans() | st.floats(allow_nan=False) | st.text(),
                    lambda inner: st.lists(inner) | st.dictionaries(
                        st.sampled_from(["linkinfo", "info_data", "bittiming", "flags", "txqlen"]), inner)))
def test_whatever_else_it_prints_raises_nothing(said):
    parse_link(msgspec.json.encode(said).decode())


@pytest.mark.parametrize(("link", "level", "words"), [
    (WELL, OK, "up"),
    (None, FAILURE, "no network interface can0"),
    (replace(WELL, is_up=False), FAILURE, "down"),
    (replace(WELL, state="BUS-OFF"), FAILURE, "bus-off"),
    (replace(WELL, state="ERROR-PASSIVE"), FAILURE, "error-passive"),
    (replace(WELL, restart_ms=0), WARNING, "restart-ms 0"),
    (replace(WELL, queue=10), WARNING, "10 frames"),
    (CanLink(True, None, None, None, None), OK, "up")])
def test_the_adapter(link, level, words):
    finding = doctor.check_adapter(CONFIG.can, link)
    assert finding.level == level and words in finding.says and bool(finding.do) == (level != OK)


@pytest.mark.parametrize(("link", "heard", "level"), [
    (WELL, HEARD, OK), (None, HEARD, OK), (replace(WELL, bitrate=250_000), HEARD, FAILURE),
    (WELL, Heard((), 1.0), FAILURE)])
def test_the_bitrate(link, heard, level):
    assert doctor.check_bitrate(CONFIG.can, link, heard).level == level


@pytest.mark.parametrize(("free_bytes", "writable", "level"), [
    (30_000_000_000, True, OK), (1_500_000_000, True, WARNING), (150_000_000, True, FAILURE), (0, True, FAILURE),
    (30_000_000_000, False, FAILURE), (None, True, FAILURE)])
def test_a_disk_that_is_nearly_full(free_bytes, writable, level):
    assert doctor.check_disk(Path("sessions"), free_bytes, writable).level == level


@pytest.mark.parametrize(("synchronised", "level"), [(True, OK), (False, WARNING), (None, WARNING)])
def test_the_time_of_day(synchronised, level):
    assert doctor.check_clock(synchronised).level == level


def test_what_the_system_refuses_is_a_warning_with_its_reason():
    findings = doctor.check_real_time([("real-time scheduling (SCHED_FIFO 50)", "Operation not permitted"),
                                ("locked memory", "")])
    assert [finding.level for finding in findings] == [WARNING, OK] and "not permitted" in findings[0].says


@pytest.mark.parametrize(("exposure", "level"), [
    (Exposure(False, 0.005), OK), (Exposure(False, None), OK), (Exposure(True, 0.005), FAILURE),
    (Exposure(False, 0.051), FAILURE), (Exposure(None, None), WARNING), (None, WARNING)])
def test_exposure(exposure, level):
    fixed = replace(CONFIG.camera, exposure_s=0.005)
    assert doctor.check_exposure(fixed, exposure).level == OK and "5 ms" in doctor.check_exposure(fixed, exposure).says
    finding = doctor.check_exposure(CONFIG.camera, exposure)           # 20 images/s: 50 ms from one to the next
    assert finding.level == level and bool(finding.do) == (level != OK)
    for camera in (fixed, CONFIG.camera):                       # whatever is stated, nothing here can ask
        finding = doctor.check_exposure(replace(camera, device="http://camera.local/stream"), None)
        assert finding.level == WARNING and "network camera" in finding.says and "v4l2" not in finding.do


@pytest.mark.skipif(sys.platform != "linux", reason="V4L2 is Linux's")
@pytest.mark.parametrize(("controls", "exposure"), [
    ({0x9A0901: 1, 0x9A0902: 50}, Exposure(False, 0.005)), ({0x9A0901: 3, 0x9A0902: 157}, Exposure(True, 0.0157)),
    ({0x9A0902: 50}, Exposure(None, 0.005)), ({}, Exposure(None, None))])
def test_a_cameras_controls_are_asked_as_the_kernel_defines_them(monkeypatch, tmp_path, controls, exposure):
    def ioctl(handle, request, data):
        number, _ = struct.unpack("Ii", data)
        assert request == 0xC008561B                            # printed by a C program from <linux/videodev2.h>
        if number not in controls:
            raise OSError(22, "Invalid argument")
        return struct.pack("Ii", number, controls[number])

    monkeypatch.setattr("fcntl.ioctl", ioctl)
    (tmp_path / "video").touch()
    assert read_exposure(str(tmp_path / "video")) == exposure
    assert read_exposure(str(tmp_path / "none")) is None


class Showing:
    def __init__(self, *images):
        self.images = list(images)

    def read(self):
        image = self.images.pop(0) if self.images else None
        if isinstance(image, Exception):
            raise image
        return None if image is None else CameraFrame(1, image)

    def close(self): ...


def grey(value, share=1.0):
    image = np.zeros((480, 640, 3), np.uint8)
    image[:int(480 * share)] = value
    return image


def dark(noise, floor=4.0, hot=0, lamp=0):
    """A covered lens: the sensor's noise and hot pixels; or a dark room with a lamp of so many pixels in it."""
    random = np.random.default_rng(1)
    image = np.clip(np.rint(random.normal(floor, noise, (480, 640, 3))), 0, 255).astype(np.uint8)
    image[random.integers(0, 480, hot), random.integers(0, 640, hot)] = 255
    image[200:200 + lamp, 300:300 + lamp] = 220
    return image


@pytest.mark.parametrize(("images", "level", "words"), [
    ([dark(2.2)], WARNING, "black"), ([dark(20.0, 16.0)], WARNING, "black"), ([dark(5.0, hot=40)], WARNING, "black"),
    ([dark(2.2, lamp=10)], OK, "640"), ([dark(20.0, lamp=20)], OK, "640"), ([dark(2.2, 60.0)], OK, "640"),
    ([None, None, grey(40)], OK, "640 x 480"), ([], FAILURE, "no image"), ([grey(255)], WARNING, "full brightness"),
    ([grey(255, 0.1)], OK, "640"), ([grey(0)], WARNING, "black"),
    ([LinkLost(CAMERA_ERROR(camera="0", detail="gone"))], FAILURE, "gone")])
def test_images(images, level, words):
    finding = doctor.check_camera(Showing(*images), Time())
    assert finding.level == level and words in finding.says


@pytest.mark.parametrize(("data", "lost", "level", "words"), [
    (make_heartbeat(3), False, OK, "there"), (b"at*00\r\n" + make_heartbeat(3), False, OK, "there"),
    (b"", False, FAILURE, "silent"), (b"$H,0*00\r\n", False, FAILURE, "cannot be read"), (b"", True, FAILURE, "unpl")])
def test_the_button_box(data, lost, level, words):
    box = Stream()
    box.data, box.lost = data, lost
    finding = doctor.check_box(box, Time())
    assert finding.level == level and words in finding.says


def test_the_gate_model(tmp_path):
    path = tmp_path / "gate.onnx"
    path.write_bytes(build())
    asked = replace(CONFIG, gate=replace(CONFIG.gate, policy="model"))
    assert doctor.check_model(CONFIG, None).level == OK and doctor.check_model(asked, None).level == FAILURE
    finding = doctor.check_model(asked, path)
    assert finding.level == OK and "hood_deg 20 to 60" in finding.says
    path.write_bytes(build(metadata=METADATA | {"truearc.contract_sha256": "0" * 64}))
    finding = doctor.check_model(asked, path)
    assert finding.level == FAILURE and "another contract" in finding.says
    assert doctor.check_model(CONFIG, tmp_path / "nowhere.onnx").level == FAILURE
    hub = Target(1.83, facing="up", shape="circle", radius_m=0.6)
    path.write_bytes(build())
    finding = doctor.check_model(replace(asked, rig=replace(CONFIG.rig, target=hub)), path)
    assert finding.level == FAILURE and "faces front, but this robot's faces up" in finding.says


@pytest.fixture
def virtual(tmp_path):
    """launcher.toml of a robot whose wires all lead nowhere."""
    text = (Path(robot.__file__).parent / "launcher.toml").read_text()
    text = text.replace('"socketcan"', '"virtual"').replace('"/dev/buttonbox"', '"/dev/nobox"')
    path = tmp_path / "launcher.toml"
    path.write_text(text.replace('"/dev/video0"', '"/dev/novideo"'))
    return path


def test_the_door_says_all_that_is_wrong_and_ends_with_1(virtual, tmp_path, capsys):
    words = ["doctor", "--config", str(virtual), "--out", str(tmp_path), "--seconds", "0.5"]
    assert main(words) == 1
    said = capsys.readouterr().out.splitlines()
    assert said[-1].startswith(f"{len(said) - 1} checks: ")
    for start in ("ok       CAN adapter", "FAILURE  bitrate", "FAILURE  flywheel motor 1, firmware",
                  "FAILURE  button box", "FAILURE  camera: ", "ok       gate model"):
        assert any(row.startswith(start) for row in said), start
    assert all(" -> " in row for row in said[:-1] if not row.startswith("ok"))
    assert main([*words, "--json"]) == 1
    told = msgspec.json.decode(capsys.readouterr().out)
    assert told["failures"] == sum(row.startswith("FAILURE") for row in said)
    assert {finding["level"] for finding in told["findings"]} == {"ok", "warning", "failure"}

"""The tuning page as a browser meets it: pictures, reasons, replay, saving, and who may not."""

import json
import re
import shutil
import subprocess
from pathlib import Path

import cv2
import msgspec
import numpy as np
import pytest
from msgspec.structs import replace

from tests import waiting
from tests.robot.good_tick import CONFIG
from tests.waiting import serving
from truearc.cli.vision_tuner import Live, Recorded, Tuner, TuneServer, find_pictures
from truearc.errors import InputError
from truearc.hw.fault_codes import CAMERA_SILENT
from truearc.hw.protocols import CameraFrame, LinkLost
from truearc.robot.config.schema import CameraFile, load_toml

FILE = CameraFile(CONFIG.camera, CONFIG.tape, CONFIG.vision)
SETTINGS = msgspec.to_builtins(CONFIG.vision)
BROWSER = shutil.which("chromium") or shutil.which("chromium-browser")
BLIND = {**SETTINGS, "hue_low": 0, "hue_high": 5}


@pytest.fixture
def pictures(tmp_path, image):
    folder = tmp_path / "session" / "frames"
    folder.mkdir(parents=True)
    cv2.imwrite(str(folder / "1.png"), image)
    cv2.imwrite(str(folder / "2.png"), np.zeros_like(image))
    (folder / "3.png").write_bytes(b"broken")
    return tmp_path / "session"


@pytest.fixture(params=[{}])
def server(tmp_path, pictures, request):
    tuner = Tuner(FILE, Recorded(find_pictures([str(pictures)])), tmp_path / "tuned.toml", **request.param)
    with serving(TuneServer(tuner, "127.0.0.1", 0)) as server:
        yield server


def ask(server, path, said=None, token=None, **headers):
    """(status, content type, body)"""
    path += f"{'&' if '?' in path else '?'}token={server.token if token is None else token}"
    method, sent = ("GET", None) if said is None else ("POST", json.dumps(said).encode())
    status, answered, body = waiting.ask(server.server_port, path, method, sent, headers)
    return status, answered["Content-Type"], body


def test_page_state_and_views_are_of_the_pictures_and_settings(server, image):
    status, kind, body = ask(server, "/")
    text = body.decode()
    assert status == 200 and kind.startswith("text/html") and "http://" not in text and "https://" not in text
    for key in SETTINGS:
        assert f'"{key}"' in text
    state = json.loads(ask(server, "/state")[2])
    assert [Path(name).name for name in state["names"]] == ["1.png", "2.png", "3.png"]
    assert state["settings"] == SETTINGS and not state["live"]
    assert np.abs(view_of(server, "image", SETTINGS).astype(int) - image).mean() < 2
    assert 0.001 < (view_of(server, "mask", SETTINGS) > 200).mean() < 0.1
    assert (view_of(server, "mask", BLIND) > 200).mean() < 0.001
    drawn = view_of(server, "regions", SETTINGS)
    assert (drawn[..., 1] > 200).sum() > 100


def view_of(server, view, settings, index=0):
    said = json.dumps(settings, separators=(",", ":"))
    status, kind, body = ask(server, f"/picture?index={index}&view={view}&settings={said}")
    assert status == 200 and kind == "image/jpeg"
    return cv2.imdecode(np.frombuffer(body, np.uint8), cv2.IMREAD_COLOR)


def test_look_says_what_each_region_is_and_replay_compares(server):
    seen = json.loads(ask(server, "/look", {"index": 0, "settings": SETTINGS})[2])
    assert seen["found"] and seen["said"].startswith(("3.9", "4.0")) and "the target at" in " ".join(seen["regions"])
    strict = json.loads(ask(server, "/look", {"index": 0, "settings": {**SETTINGS, "max_reprojection_px": 1e-6}})[2])
    assert not strict["found"] and "miss the tape's shape" in strict["said"]
    rows = json.loads(ask(server, "/replay", {"settings": BLIND})[2])
    assert len(rows) == 3 and " m ± " in rows[0]["before"] and "colour" in rows[0]["after"]
    assert rows[1]["before"] == rows[1]["after"] and "3.png" in rows[2]["before"]


@pytest.mark.parametrize("server", [{"piece": 2}], indirect=True)
def test_replay_goes_on_where_it_is_asked_to(server):
    pieces = [json.loads(ask(server, "/replay", {"settings": BLIND, "begin": begin})[2]) for begin in (0, 2, 3)]
    assert [[Path(row["name"]).name for row in piece] for piece in pieces] == [["1.png", "2.png"], ["3.png"], []]
    assert ask(server, "/replay", {"settings": BLIND, "begin": -1})[0] == 400


def test_endless_brackets_other_sites_and_requests_without_token_are_refused(server, tmp_path):
    assert waiting.ask(server.server_port, f"/look?token={server.token}", "POST", b"[" * 9000)[0] == 400
    for token in ("", "guess", "%C3%A9"):
        assert ask(server, "/", token=token)[0] == ask(server, "/state", token=token)[0] == 403
        assert ask(server, "/save", {"settings": SETTINGS}, token=token)[0] == 403
    for there in ({"Origin": "http://elsewhere.example"}, {"Host": "elsewhere.example"}):
        assert ask(server, "/save", {"settings": SETTINGS}, **there)[0] == 403
    assert ask(server, "/state", Host="elsewhere.example")[0] == 403 and not (tmp_path / "tuned.toml").exists()


def test_save_writes_what_can_be_read_and_is_then_before(server, tmp_path):
    status, _, body = ask(server, "/save", {"settings": {**SETTINGS, "hue_low": 40}})
    assert status == 200 and "tuned.toml" in json.loads(body)["said"]
    saved = load_toml(tmp_path / "tuned.toml", CameraFile)
    assert saved == replace(FILE, vision=replace(FILE.vision, hue_low=40))
    assert json.loads(ask(server, "/state")[2])["settings"]["hue_low"] == 40


@pytest.mark.parametrize(("path", "said", "status"), [
    ("/look", {"index": 0, "settings": {**SETTINGS, "hue_low": "red"}}, 400), ("/look", {"index": 9}, 400),
    ("/look", {"index": 9, "settings": SETTINGS}, 400), ("/look", [1], 400), ("/save", {"settings": {}}, 400),
    ("/save", {"settings": {**SETTINGS, "corner_sigma_px": -1}}, 400), ("/picture", None, 400),
    ("/picture?index=x&view=mask&settings=1", None, 400), ("/else", None, 404), ("/else", {}, 404),
    ("/look", {"index": 2, "settings": SETTINGS}, 400), ("/look", {"pad": "x" * 20_000}, 404)])
def test_nonsense_is_told_and_saves_nothing(server, tmp_path, path, said, status):
    code, kind, body = ask(server, path, said)
    assert code == status and body and kind.startswith("text/plain")
    assert not (tmp_path / "tuned.toml").exists()


@pytest.mark.browser
@pytest.mark.slow
@pytest.mark.skipif(BROWSER is None, reason="needs chromium")
def test_a_browser_shows_the_distance_and_the_sliders(server, tmp_path):
    command = [BROWSER, "--headless", "--no-sandbox", "--disable-gpu", f"--user-data-dir={tmp_path / 'profile'}",
               "--virtual-time-budget=8000", "--dump-dom", server.url]
    page = subprocess.run(command, capture_output=True, text=True, timeout=120).stdout
    assert re.search(r'id="said"[^>]*class="found"[^>]*>(3\.9|4\.0)\d+ m ±', page)
    assert page.count('type="range"') == len(SETTINGS) and "<li>the target at" in page


class Fake:
    """A camera of one picture, which is then gone."""

    def __init__(self, image) -> None:
        self.frames = [CameraFrame(0, image), None]

    def read(self):
        if not self.frames:
            raise LinkLost(CAMERA_SILENT(camera="fake"))
        return self.frames.pop(0)

    def close(self) -> None:
        pass


def test_live_words_and_views_are_of_one_picture_until_it_is_gone(tmp_path, image):
    tuner = Tuner(FILE, Live(Fake(image)), tmp_path / "x.toml")
    assert tuner.state()["live"] and tuner.look(0, SETTINGS)["found"] and tuner.look(0, SETTINGS)["found"]
    with pytest.raises(InputError, match="fake"):
        tuner.look(0, SETTINGS)
    camera = Fake(image)
    camera.frames.append(CameraFrame(1, np.zeros_like(image)))
    tuner = Tuner(FILE, Live(camera), tmp_path / "x.toml")
    first, again, dark = (tuner.look(0, SETTINGS) for _ in range(3))
    assert first["frame"] == again["frame"] != dark["frame"] and first["found"] and not dark["found"]
    bright, black = (cv2.imdecode(np.frombuffer(tuner.picture(0, "image", SETTINGS, seen["frame"]), np.uint8), 1)
                     for seen in (first, dark))
    assert bright.max() > 150 and black.max() < 5
    with pytest.raises(InputError, match="no longer kept"):
        tuner.picture(0, "image", SETTINGS, 99)

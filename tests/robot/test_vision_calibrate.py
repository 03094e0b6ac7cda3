"""Calibration: from taped distances, from boards that other code projected, and as its users meet it."""

import csv
import functools
import itertools
import re
from pathlib import Path

import cv2
import msgspec
import numpy as np
import pytest
from msgspec.structs import replace

import truearc.cli.main as truearc
from tests.robot.good_tick import CONFIG
from truearc import robot
from truearc.errors import make_toml
from truearc.hw.emulated.camera import Lens, Stage, distort
from truearc.hw.protocols import CameraFrame
from truearc.robot.config.schema import CameraFile, load_toml
from truearc.robot.vision import detect
from truearc.robot.vision.calibration import Board, calibrate, find_board, fit_taped
from truearc_proof.world.camera_damage import StagedCamera, place

HOME = Path(robot.__file__).parent
TAPE, VISION = CONFIG.tape, CONFIG.vision
WRONG = replace(CONFIG.camera, fx_px=CONFIG.camera.fx_px * 1.06, fy_px=CONFIG.camera.fy_px * 1.06, focal_sigma=0.05)
LENS = Lens(640, 480, 655.0, 655.0, 331.0, 228.0, (0.09, -0.21, 0.001, -0.0015, 0.0))
CHESS, CHARUCO = Board(9, 6, 0.025), Board(10, 7, 0.03, 0.022, "DICT_4X4_50")


def picture(distance_m: float, seed: int) -> CameraFrame:
    """As the packaged camera would see it; the tape measure says `distance_m`."""
    camera = CONFIG.camera
    lens = Lens(camera.width_px, camera.height_px, camera.fx_px, camera.fy_px, camera.cx_px, camera.cy_px)
    view = place(distance_m, TAPE.centre_height_m - camera.height_m, camera.pitch_deg, bearing_deg=4.0)
    return StagedCamera(Stage(view), lens, TAPE, seed).expose(0)


def fit(distances_m, taped_m, **how):
    frames = [picture(distance_m, seed) for seed, distance_m in enumerate(distances_m)]
    return fit_taped(frames, taped_m, WRONG, TAPE, VISION, **{"tape_sigma_m": 0.005, "bias_sigma_m": 0.02, **how})


def test_taped_distances_find_the_focal_length():
    places = (2.6, 4.0, 6.0)
    found = fit(places, places)
    assert found.scale == pytest.approx(1 / 1.06, abs=0.006) and found.inflated < 1.5
    assert abs(found.scale * 1.06 - 1) < 3 * found.camera.focal_sigma < 0.03
    seen = detect(picture(8.0, 77), found.camera, TAPE, VISION)
    assert seen.distance_m == pytest.approx(8.0, abs=3 * seen.sigma_m)
    assert detect(picture(8.0, 77), WRONG, TAPE, VISION).distance_m > 8.0 + 0.3
    wrong = fit(places, [2.6 + 0.3, 4.0 - 0.3, 6.0 + 0.3])                # distances that do not agree
    assert wrong.inflated > 3.0 and wrong.camera.focal_sigma > 3 * found.camera.focal_sigma


def test_a_tape_that_began_elsewhere_is_a_bias():
    places = (2.5, 3.5, 5.0, 7.0, 8.5)
    found = fit(places, [distance_m - 0.15 for distance_m in places], bias_sigma_m=1.0)
    assert found.camera.bias_m == pytest.approx(0.15, abs=0.05) and found.scale == pytest.approx(1 / 1.06, abs=0.012)
    assert 0.0 < found.camera.bias_sigma_m < 0.1 and found.correlation > 0.5


def test_pictures_without_target_or_board_calibrate_nothing():
    black = CameraFrame(0, np.zeros((480, 640, 3), np.uint8))
    assert fit_taped([black, picture(4.0, 1)], [3.0, 4.0], WRONG, TAPE, VISION, tape_sigma_m=0.01,
                     bias_sigma_m=0.02) is None
    assert find_board(np.zeros((480, 640, 3), np.uint8), CHESS) is None
    assert find_board(board_picture(CHESS, (0, 0), 0, (0, 0, .42), 0), CHARUCO) is None


@pytest.mark.data
def test_real_photographs_calibrated_on_half_of_them(data_dir):
    """Over every split of the labelled 640 x 480 photographs into three and three: the other three are within
    max(0.05 m, 2.5 %) root mean square, and one sigma covers about 68 % of them."""
    file = load_toml(HOME / "cameras" / "lifecam_hd3000_480p.toml", CameraFile)
    with open(data_dir / "goal_images" / "labels.csv", encoding="utf-8") as stream:
        rows = [row for row in csv.DictReader(stream) if row["label_distance_m"] and row["height_px"] == "480"]
    frames = [CameraFrame(0, cv2.imread(str(data_dir / "goal_images" / row["file"]))) for row in rows]
    taped_m = [float(row["label_distance_m"]) for row in rows]
    assert len(rows) == 6
    ratios = []
    for used in itertools.combinations(range(6), 3):
        found = fit_taped([frames[k] for k in used], [taped_m[k] for k in used], file.camera, file.tape, file.vision,
                          tape_sigma_m=0.01, bias_sigma_m=0.02)
        misses = []
        for k in set(range(6)) - set(used):
            seen = detect(frames[k], found.camera, file.tape, file.vision)
            misses.append((seen.distance_m - taped_m[k]) / max(0.05, 0.025 * taped_m[k]))
            ratios.append((seen.distance_m - taped_m[k]) / seen.sigma_m)
        assert np.sqrt(np.mean(np.square(misses))) < 1.0
    assert 0.6 <= np.mean(np.abs(ratios) < 1.0) <= 0.9 and 0.5 < np.sqrt(np.mean(np.square(ratios))) < 1.3


@functools.cache
def rays_of_lens() -> np.ndarray:
    """Where each pixel of LENS looks, the same for all pictures."""
    columns, rows = np.meshgrid(np.arange(640.0), np.arange(480.0))
    seen = np.column_stack([columns.ravel(), rows.ravel()])
    ideal = seen.copy()
    for _ in range(40):
        ideal += seen - distort(ideal, LENS)
    return np.column_stack([(ideal[:, 0] - LENS.cx_px) / LENS.fx_px, (ideal[:, 1] - LENS.cy_px) / LENS.fy_px,
                            np.ones(len(ideal))])


def board_picture(board: Board, slant_deg, turn_deg: float, place_m, seed: int) -> np.ndarray:
    """A board as LENS sees it, traced back pixel by pixel: no projection code of OpenCV's."""
    rotation = cv2.Rodrigues(np.radians([slant_deg[0], slant_deg[1], 0.0]))[0] @ cv2.Rodrigues(
        np.radians([0.0, 0.0, turn_deg]))[0]
    flat = draw(board)
    rays = rays_of_lens()
    reach = (rotation[:, 2] @ np.array(place_m)) / (rays @ rotation[:, 2])
    on_board_m = (rays * reach[:, None] - np.array(place_m)) @ rotation
    where = on_board_m[:, :2] / board.square_m * PX + np.array(flat.shape[::-1]) / 2 - 0.5
    image = cv2.remap(flat, where.astype(np.float32).reshape(480, 640, 2), None, cv2.INTER_AREA, borderValue=128)
    noise = np.random.default_rng(seed).normal(0, 2, image.shape)
    return np.clip(cv2.GaussianBlur(image, (0, 0), 0.6) + noise, 0, 255).astype(np.uint8)


PX = 40                               # a square of the drawn board


def draw(board: Board) -> np.ndarray:
    if board.marker_m:
        marked = cv2.aruco.CharucoBoard((board.columns, board.rows), board.square_m, board.marker_m,
                                        cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, board.dictionary)))
        inside = marked.generateImage((PX * board.columns, PX * board.rows))
    else:
        fields = np.indices((board.rows + 1, board.columns + 1)).sum(axis=0) % 2
        inside = np.kron(255 - 255 * fields, np.ones((PX, PX))).astype(np.uint8)
    return np.pad(inside, PX, constant_values=255)


SLANTS = [(0, 0), (25, 0), (-25, 5), (0, 28), (5, -28), (20, 20), (-20, 18), (-22, -20), (18, -22)]
PLACES = [(0, 0, .42), (-.06, .03, .5), (.07, -.04, .5), (.05, .05, .45), (-.08, -.05, .5), (.08, .03, .55),
          (-.05, .06, .5), (.03, -.07, .5), (-.03, 0, .45)]


@pytest.mark.parametrize("board", [CHESS, CHARUCO], ids=["chessboard", "charuco"])
def test_a_board_finds_the_lens(board):
    views = []
    for seed, (slant, place_m) in enumerate(zip(SLANTS, PLACES, strict=True)):
        view = find_board(board_picture(board, slant, 3 * seed, place_m, seed), board)
        assert view is not None and view.points_m.shape == (len(view.seen_px), 3)
        views.append(view)
    found = calibrate(views, CONFIG.camera)
    camera = found.camera
    assert max(found.error_px) < 0.4
    assert camera.fx_px == camera.fy_px and 0 < camera.focal_sigma < 0.01
    assert camera.fx_px == pytest.approx(655.0, rel=4 * camera.focal_sigma)
    assert camera.cx_px == pytest.approx(331.0, abs=4 * camera.centre_sigma_px)
    assert camera.cy_px == pytest.approx(228.0, abs=4 * camera.centre_sigma_px) and camera.centre_sigma_px < 5
    assert camera.distortion[0] == pytest.approx(0.09, abs=0.05)
    assert "centre_sigma_px" in make_toml({"camera": msgspec.to_builtins(camera)})      # plain numbers, none of NumPy's


def run(capsys, *arguments):
    code = truearc.main(["vision-calibrate", *map(str, arguments), "--quiet"])
    out = capsys.readouterr()
    return code, out.out, out.err


def test_the_door_with_taped_distances(capsys, tmp_path):
    rows = ["file,distance_m"]
    for seed, distance_m in enumerate((2.6, 4.0, 6.0)):
        cv2.imwrite(str(tmp_path / f"{distance_m}.png"), picture(distance_m, seed).image)
        rows.append(f"{distance_m}.png,{distance_m}")
    cv2.imwrite(str(tmp_path / "none.png"), np.zeros((480, 640, 3), np.uint8))
    (tmp_path / "taped.csv").write_text("\n".join([*rows, "none.png,3"]))
    source = tmp_path / "camera.toml"
    text = (HOME / "cameras" / "lifecam_hd3000_480p.toml").read_text()
    source.write_text(re.sub(r"f([xy])_px = .*", r"f\1_px = 720.0", text))
    code, out, err = run(capsys, "--distances", tmp_path / "taped.csv", "--camera", source, "-o", tmp_path / "new.toml")
    assert code == 0 and out == "" and "focal lengths x" in err and "none.png" in err and "not found" in err
    new, old = (load_toml(path, CameraFile) for path in (tmp_path / "new.toml", source))
    assert new.tape == old.tape and new.vision == old.vision and new.camera.focal_sigma < old.camera.focal_sigma
    assert new.camera.fx_px < 720.0 and run(capsys, "--distances", tmp_path / "taped.csv", "--camera",
                                            source)[1] == (tmp_path / "new.toml").read_text()


def test_taped_distances_that_cannot_be_metres_are_told_as_such(capsys, tmp_path):
    for k, distance_m in enumerate((2.6, 4.0)):
        cv2.imwrite(str(tmp_path / f"{k}.png"), picture(distance_m, k).image)
    camera = HOME / "cameras" / "lifecam_hd3000_480p.toml"
    for text, complaint in (("file,distance_m\n0.png,2,6\n1.png,4,0\n", ":2: more cells than columns"),
                            ("file,distance_m\n0.png,102\n1.png,157\n", "Are they in metres?")):
        (tmp_path / "taped.csv").write_text(text)
        code, out, err = run(capsys, "--distances", tmp_path / "taped.csv", "--camera", camera)
        assert code == 2 and out == "" and complaint in err, err
    code, _, err = run(capsys, "--distances", tmp_path / "taped.csv", "--camera", camera, tmp_path / "2.png")
    assert code == 2 and "no distance for 2.png" in err


def test_the_door_with_boards(capsys, tmp_path):
    for k in range(5):
        cv2.imwrite(str(tmp_path / f"{k}.png"), board_picture(CHESS, SLANTS[k], 0, PLACES[k], k))
    code, out, err = run(capsys, *sorted(tmp_path.glob("*.png")), "--board", "chessboard:9x6:0.025")
    assert code == 0 and "focal length 6" in err and "[camera]" in out and "focal_sigma" in out
    small = board_picture(CHESS, (0, 0), 0, (0, 0, .42), 0)
    cv2.imwrite(str(tmp_path / "a.png"), small)
    cv2.imwrite(str(tmp_path / "b.png"), cv2.resize(small, (960, 720)))
    code, _, err = run(capsys, tmp_path / "a.png", tmp_path / "b.png", "--board", "chessboard:9x6:0.025")
    assert code == 2 and "b.png" in err and "960 x 720" in err


def test_a_board_that_does_not_move_is_no_calibration(capsys, tmp_path):
    """One picture four times is one view; ten of a board that is never slanted leave the focal length open."""
    picture_of = board_picture(CHESS, SLANTS[1], 0, PLACES[0], 1)
    for k in range(4):
        cv2.imwrite(str(tmp_path / f"same{k}.png"), picture_of)
    for k in range(6):
        cv2.imwrite(str(tmp_path / f"flat{k}.png"), board_picture(CHESS, (0.3 * k, 0), 0, (0.01 * k - 0.03, 0, .45), k))
    out = tmp_path / "camera.toml"
    board = ("--board", "chessboard:9x6:0.025", "-o", out)
    code, _, err = run(capsys, *sorted(tmp_path.glob("same*")), *board)
    assert code == 2 and err.count("the same view as") == 3 and "found in 1 of 4" in err and not out.exists()
    code, _, err = run(capsys, *sorted(tmp_path.glob("flat*")), *board)
    assert code == 2 and "leave the focal length open" in err and not out.exists()


@pytest.mark.parametrize(("arguments", "named"), [
    ((), "--board or --distances: one of the two is needed"),
    (("--board", "chessboard"), "chessboard:9x6:0.025"),
    (("--board", "charuco:8x11:0.015:0.011:DICT_NONE"), "charuco"),
    (("--board", "chessboard:9x6:0.025"), "found in 0 of 0 images"),
    (("--distances", "nowhere.csv"), "nowhere.csv"),
    (("--distances", "nowhere.csv", "--tape-sigma", "nan"), "--tape-sigma")])
def test_the_door_s_complaints(capsys, arguments, named):
    code, out, err = run(capsys, *arguments)
    assert code == 2 and out == "" and named in err and "Traceback" not in err

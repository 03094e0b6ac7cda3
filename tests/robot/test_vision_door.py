"""`truearc vision` as its users meet it, on image files that are damaged in every way, too."""

import csv
import io
import struct
import sys
import zlib
from pathlib import Path

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import truearc.cli.main as truearc
from truearc import robot
from truearc.cli import vision_images as images
from truearc.cli.vision_images import MAX_PIXELS, decode_image, image_size, load_image
from truearc.errors import InputError


@pytest.fixture
def good(tmp_path, image) -> str:
    path = tmp_path / "good.png"
    cv2.imwrite(str(path), image)
    return str(path)


def run(capsys, *arguments: str):
    code = truearc.main(["vision", *arguments])
    out = capsys.readouterr()
    return code, list(csv.DictReader(io.StringIO(out.out))), out


def test_a_found_target(capsys, good):
    code, rows, out = run(capsys, good)
    assert code == 0 and out.err == "" and len(rows) == 1
    assert out.out.splitlines()[0] == "file,found,distance_m,sigma_m,corners"
    row = rows[0]
    assert row["file"] == good and row["found"] == "true"
    assert float(row["distance_m"]) == pytest.approx(4.0, abs=0.05) and 0.002 < float(row["sigma_m"]) < 0.05
    corners = [tuple(map(float, pair.split())) for pair in row["corners"].split(",")]
    assert len(corners) == 4 and f'"{row["corners"]}"' in out.out


def test_no_target_is_an_answer_and_no_camera_file_an_error(capsys, tmp_path, good):
    path = tmp_path / "dark.png"
    cv2.imwrite(str(path), np.full((480, 640, 3), 5, np.uint8))
    code, rows, out = run(capsys, str(path))
    assert code == 0 and rows == [{"file": str(path), "found": "false", "distance_m": "", "sigma_m": "", "corners": ""}]
    assert str(path) in out.err and "dark all over" in out.err
    code, _, out = run(capsys, good, "--camera", "nowhere.toml")
    assert code == 2 and "nowhere.toml" in out.err


def test_bad_files_are_named_and_the_others_answered(capsys, tmp_path, image, good):
    corrupt, text, tiny = (tmp_path / name for name in ("corrupt.png", "text.jpg", "tiny.png"))
    data = bytearray(Path(good).read_bytes())
    data[2000:2040] = b"x" * 40
    corrupt.write_bytes(data)
    text.write_text("not an image")
    cv2.imwrite(str(tiny), image[:2, :2])
    bad = [corrupt, text, tmp_path / "missing.png"]
    code, rows, out = run(capsys, *map(str, bad), str(tiny), good)
    assert code == 2 and len(rows) == len(bad) + 2
    for path, row in zip(bad, rows, strict=False):
        assert row["found"] == "" and row["distance_m"] == ""
        assert any(line.startswith(f"truearc vision: {path}: ") for line in out.err.splitlines())
    assert rows[-2]["found"] == "false" and rows[-1]["found"] == "true"
    assert "Traceback" not in out.err


def test_alpha_is_ignored_and_other_sizes_are_said_once(capsys, tmp_path, image, good):
    path = tmp_path / "alpha.png"
    cv2.imwrite(str(path), np.dstack([image, np.full(image.shape[:2], 255, np.uint8)]))
    _, rows, _ = run(capsys, str(path), good)
    assert rows[0]["distance_m"] == rows[1]["distance_m"] != ""
    cv2.imwrite(str(tmp_path / "crop.png"), image[:400])
    code, rows, out = run(capsys, good, str(tmp_path / "crop.png"), str(tmp_path / "crop.png"))
    assert code == 0 and len(rows) == 3 and out.err.count("640 x 400: treated as modes that show the full height") == 1
    assert "full height" not in run(capsys, good)[2].err


def test_labels_give_an_error_table(capsys, tmp_path, good):
    labels = tmp_path / "labels.csv"
    labels.write_text("file,other,label_distance_m\ngood.png,x,3.5\nelse.png,y,\n")
    code, _, out = run(capsys, good, "--labels", str(labels))
    assert code == 0 and "good.png" in out.err and "3.500" in out.err and "1 labelled: mean error +0." in out.err


@pytest.mark.parametrize(("text", "named"), [
    ("file,distance\na,1\n", "labels.csv:1: missing column 'label_distance_m'"),
    ("file,label_distance_m\na,1\nb,far\n", "labels.csv:3: label_distance_m: 'far'"),
    ("file,label_distance_m\na,-1\n", "labels.csv:2: label_distance_m: '-1'"),
    ("file,label_distance_m\na,nan\n", "labels.csv:2: label_distance_m: 'nan'")])
def test_bad_labels(capsys, tmp_path, good, text, named):
    labels = tmp_path / "labels.csv"
    labels.write_text(text)
    code, _, out = run(capsys, good, "--labels", str(labels))
    assert code == 2 and named in out.err


def test_camera_by_file_by_name_and_whole_launcher(capsys, tmp_path, good):
    home = Path(robot.__file__).parent
    whole = tmp_path / "launcher.toml"
    whole.write_text((home / "launcher.toml").read_text())
    by_default, by_file = (run(capsys, good, *more)[1] for more in ((), ("--camera", str(whole))))
    assert by_default == by_file
    by_name, by_path = (run(capsys, good, "--camera", camera)[1]
                        for camera in ("lifecam_hd3000_480p", str(home / "cameras" / "lifecam_hd3000_480p.toml")))
    assert by_name == by_path != by_default and by_name[0]["found"] == "true"


@pytest.mark.parametrize(("change", "named"), [
    (("fx_px", "fx_pixels"), "fx_pixels"),
    (("hue_low = 50", 'hue_low = "green"'), "hue_low"),
    (("[tape]", "[tapes]"), "tape"),
    (("height_sigma_m = 0.30", "height_sigma_m = 0"), "height_sigma_m"),
    (("fx_px = 699.3778103", "fx_px = nan"), "fx_px"),
    (("height_m = 0.4318", "height_m = -1.0"), "height_m"),
    (("cx_px = 345.6059345", "cx_px = nan"), "cx_px"), (("cy_px = 207.12741326", "cy_px = -inf"), "cy_px"),
    (("distortion = [0.1", "distortion = [nan, 0.1"), "distortion"), (("3.0777378558802435]", "inf]"), "distortion"),
    (("height_m = 0.60 ", "height_m = nan "), "height_m"), (("behind_exit_m = 0.0", "behind_exit_m = inf"), "behind"),
    (("centre_height_m = 2.27965", "centre_height_m = nan"), "centre_height_m"),
    (("focal_sigma = 0.03", "focal_sigma = 1e6"), "focal_sigma"),
    (("centre_sigma_px = 40.0", "centre_sigma_px = 1e8"), "centre_sigma_px"),
    (("pitch_sigma_deg = 10.0", "pitch_sigma_deg = 1e6"), "pitch_sigma_deg"),
    (("[camera]", "[camera"), "")])
def test_bad_camera_files_name_the_key(capsys, tmp_path, good, change, named):
    text = (Path(robot.__file__).parent / "cameras" / "lifecam_hd3000_480p.toml").read_text()
    path = tmp_path / "camera.toml"
    path.write_text(text.replace(*change))
    code, rows, out = run(capsys, good, "--camera", str(path))
    assert code == 2 and rows == [] and str(path) in out.err and named in out.err


GREY_ALPHA = 4, (b"\0" + bytes(range(160))) * 60
RANDOM = np.random.default_rng(1)
PICTURE = cv2.GaussianBlur(RANDOM.integers(0, 256, (60, 80, 3), dtype=np.uint8), (5, 5), 0)
WHOLE = {end: cv2.imencode(end, PICTURE)[1].tobytes() for end in (".jpg", ".png", ".bmp", ".webp")}


@pytest.mark.parametrize("end", WHOLE)
def test_what_is_written_is_read(end):
    assert image_size(WHOLE[end]) == (80, 60)
    assert decode_image(WHOLE[end]).shape == (60, 80, 3)
    assert image_size(cv2.imencode(end, PICTURE[:7, :5])[1].tobytes()) == (5, 7)


def test_lossless_webp_states_its_size_elsewhere():
    data = cv2.imencode(".webp", PICTURE, [cv2.IMWRITE_WEBP_QUALITY, 101])[1].tobytes()
    assert data[12:16] == b"VP8L" and image_size(data) == (80, 60)
    assert np.array_equal(decode_image(data), PICTURE)


def png_of(width: int, height: int, kind: int = 2, pixels: bytes = b"") -> bytes:
    """A PNG that claims a size and has these pixels."""
    header = b"IHDR" + struct.pack(">IIBBBBB", width, height, 8, kind, 0, 0, 0)
    parts = (header, b"IDAT" + zlib.compress(pixels), b"IEND")
    return b"\x89PNG\r\n\x1a\n" + b"".join(struct.pack(">I", len(part) - 4) + part + struct.pack(">I", zlib.crc32(part))
                                           for part in parts)


@pytest.mark.parametrize(("data", "named"), [
    (b"", "empty"), (b"GIF89a....", "JPEG, PNG, BMP and WebP"), (b"\x89PNG\r\n\x1a\n", "corrupt"),
    (b"\xff\xd8", "corrupt"), (b"\xff\xd8\x00\x00", "corrupt"), (WHOLE[".png"][:-40], "cut short"),
    (WHOLE[".jpg"][:-40], "cut short"), (png_of(60_000, 60_000), f"more than {MAX_PIXELS // 1_000_000} million"),
    (png_of(10_000, 10_000), f"more than {MAX_PIXELS // 1_000_000} million"),
    (png_of(0, 5), "corrupt"), (png_of(80, 60), "corrupt"),
    (cv2.imencode(".png", PICTURE[:, :, 0])[1].tobytes(), "greyscale"),
    (png_of(80, 60, *GREY_ALPHA), "greyscale"),
    (cv2.imencode(".png", PICTURE.astype(np.uint16))[1].tobytes(), "16-bit")])
def test_what_is_wrong_is_said(data, named):
    with pytest.raises(InputError, match=named):
        decode_image(data)


def test_grey_is_enough_for_a_board_and_files_have_a_limit(monkeypatch, tmp_path):
    assert decode_image(cv2.imencode(".png", PICTURE[:, :, 0])[1].tobytes(), colour=False).shape == (60, 80)
    assert decode_image(png_of(80, 60, *GREY_ALPHA), colour=False).tolist() == [list(range(0, 160, 2))] * 60
    path = tmp_path / "large.bmp"
    path.write_bytes(WHOLE[".bmp"])
    monkeypatch.setattr(images, "MAX_BYTES", 1000)
    with pytest.raises(InputError, match=r"large.bmp: is longer than 1000 bytes"):
        load_image(str(path))


@settings(max_examples=500, deadline=None)
@given(st.sampled_from(sorted(WHOLE)), st.lists(st.tuples(st.integers(0, 20_000), st.binary(max_size=6),
                                                          st.integers(0, 60)), min_size=1, max_size=5),
       st.one_of(st.none(), st.integers(0, 20_000)))
def test_any_damage_is_an_image_or_told(end, changes, length):
    data = bytearray(WHOLE[end])
    for where, put, gone in changes:
        at = where % len(data) if where % 2 else where % 60
        data[at:at + gone] = put
        if not data:
            break
    try:
        image = decode_image(bytes(data[:length]))
    except InputError as error:
        assert str(error)
    else:
        assert image.dtype == np.uint8 and image.ndim == 3 and image.shape[2] == 3


@pytest.mark.parametrize("end", WHOLE)
def test_the_base_install_reads_pictures_without_pillow(monkeypatch, end):
    monkeypatch.setitem(sys.modules, "PIL", None)
    assert image_size(WHOLE[end]) is None and decode_image(WHOLE[end]).shape == (60, 80, 3)
    with pytest.raises(InputError):
        decode_image(WHOLE[end][:30])

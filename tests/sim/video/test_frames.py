"""Frames come with their own times, upright, and what cannot be read says why."""

from pathlib import Path

import cv2
import numpy as np
import pytest

from tests.sim.video.film import Scene, film
from truearc.errors import InputError
from truearc.sim.video.frames import open_clip

SMALL = Scene(width=160, height=96, rate_hz=30.0)


@pytest.fixture(scope="module")
def clip(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("frames") / "even.mp4"
    film(path, (), 2.0, SMALL)
    return path


def turned(path: Path, to: Path) -> Path:
    """A copy whose file says that it is to be shown a quarter turn clockwise, as phones write it."""
    data = bytearray(path.read_bytes())
    plain = b"".join(value.to_bytes(4, "big", signed=True) for value in (65536, 0, 0, 0, 65536, 0, 0, 0, 1 << 30))
    quarter = b"".join(value.to_bytes(4, "big", signed=True) for value in (0, 65536, 0, -65536, 0, 0, 0, 0, 1 << 30))
    place = data.index(plain, data.index(b"tkhd"))
    data[place:place + 36] = quarter
    to.write_bytes(data)
    return to


def test_uneven_times_are_read_as_they_are(tmp_path):
    times = list(np.cumsum([0.0, 0.033, 0.033, 0.066, 0.023, 0.044, 0.033, 0.1, 0.033, 0.017]))
    film(tmp_path / "a.mp4", (), 0.0, SMALL, times_s=times)
    assert [frame.time_s for frame in open_clip(tmp_path / "a.mp4").frames()] == pytest.approx(times, abs=1e-4)


def test_slow_motion_divides_times(clip):
    last = max(frame.time_s for frame in open_clip(clip, slow_motion=4.0).frames())
    assert last == pytest.approx(59 / 30 / 4, abs=1e-4)


def test_hevc_is_read(tmp_path):
    film(tmp_path / "a.mov", (), 0.3, SMALL, codec="libx265")
    assert len(list(open_clip(tmp_path / "a.mov").frames())) == 9


def test_frames_are_upright_after_the_phones_turn(clip, tmp_path):
    opened = open_clip(turned(clip, tmp_path / "turned.mp4"))
    upright, stored = next(opened.frames()), next(open_clip(clip).frames())
    assert (upright.luma == np.rot90(stored.luma, 3)).all()
    assert upright.to_bgr().shape == (160, 96, 3)


def test_frames_begin_where_asked(clip):
    opened = open_clip(clip)
    late, whole = list(opened.frames(1.0)), list(opened.frames())
    assert late[0].time_s == pytest.approx(1.0)
    assert (late[0].luma == whole[30].luma).all()


def test_folder_needs_a_rate_and_keeps_the_order(tmp_path):
    for number in range(12):
        cv2.imwrite(str(tmp_path / f"{number:03d}.png"), np.full((40, 60, 3), 10 * number, np.uint8))
    with pytest.raises(InputError, match="--rate"):
        open_clip(tmp_path)
    frames = list(open_clip(tmp_path, 25.0).frames())
    assert [frame.time_s for frame in frames] == pytest.approx(np.arange(12) / 25.0)
    assert [int(frame.to_bgr().mean()) for frame in frames] == pytest.approx(10 * np.arange(12), abs=2)


def test_cut_short_file_gives_what_came_before(clip, tmp_path):
    film(tmp_path / "a.mkv", (), 2.0, SMALL)
    whole = (tmp_path / "a.mkv").read_bytes()
    (tmp_path / "b.mkv").write_bytes(whole[:len(whole) // 2])
    opened = open_clip(tmp_path / "b.mkv")
    last = max(frame.time_s for frame in opened.frames())
    assert 0.2 < last < 1.7
    assert opened.is_cut_short(last)


@pytest.mark.parametrize(("name", "content", "words"), [
    ("none.mp4", None, "No such file"), ("empty.mp4", b"", "cannot be read as a video"),
    ("text.mp4", b"hello\n" * 100, "cannot be read as a video: .* input$"),
    ("noise.mp4", bytes(range(256)) * 40, "cannot be read")])
def test_unreadable_file_says_why(tmp_path, name, content, words):
    if content is not None:
        (tmp_path / name).write_bytes(content)
    with pytest.raises(InputError, match=words) as caught:
        open_clip(tmp_path / name)
    assert name in str(caught.value)


@pytest.mark.parametrize("share", [0.001, 0.02, 0.3, 0.9, 0.99])
def test_beginning_of_a_file_is_named_or_read(clip, tmp_path, share):
    """PyAV ends the process where a file is cut within its first frame and decoded all the same."""
    whole = clip.read_bytes()
    (tmp_path / "cut.mp4").write_bytes(whole[:int(share * len(whole))])
    with pytest.raises(InputError, match="cut short"):
        open_clip(tmp_path / "cut.mp4")


def test_empty_folder_and_sound_are_named(tmp_path):
    (tmp_path / "folder").mkdir()
    with pytest.raises(InputError, match="holds no pictures"):
        open_clip(tmp_path / "folder", 30.0)

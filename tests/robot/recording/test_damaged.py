"""What benchmarks/fuzz.py found in recordings: packed zeros, rows lost in silence, bytes that are no text."""

import json
import resource
import shutil
import struct
import zlib
from pathlib import Path

import cv2
import lz4.frame
import numpy as np
import pytest
import zstandard
from mcap.reader import make_reader
from mcap.writer import CompressionType, Writer

from truearc.cli.main import main
from truearc.errors import InputError
from truearc.robot.recording.files import MOST_PIXELS, load_image, load_pictures, parse_candump
from truearc.robot.recording.reader import LARGEST, TickReader
from truearc.robot.recording.session import FRAMES, INDEX, TELEMETRY, TRIALS, Picture, load_trials
from truearc.robot.recording.upkeep import recover
from truearc.sim.data.recordings import shots_from_sessions

ZEROS = 2_600_000_000                 # bytes, of which zstd makes 82 kB


@pytest.fixture
def session(plain: Path, tmp_path: Path) -> Path:
    return shutil.copytree(plain, tmp_path / "s")


def chunk(packed: bytes, name: bytes, said: int) -> bytes:
    body = struct.pack("<QQQII", 0, 0, said, 0, len(name)) + name + struct.pack("<Q", len(packed)) + packed
    return b"\x89MCAP0\r\n\x06" + struct.pack("<Q", len(body)) + body


def packed_zeros(size: int, is_said: bool) -> bytes:
    """A zstd frame, which states how much it holds or does not."""
    packer = zstandard.ZstdCompressor(write_content_size=is_said).compressobj(size=size if is_said else -1)
    block = bytes(10_000_000)
    return b"".join(packer.compress(block) for _ in range(size // len(block))) + packer.flush()


@pytest.mark.parametrize(("said", "is_said"), [(ZEROS, True), (100, True), (100, False), (LARGEST, False)])
def test_a_recording_that_unpacks_to_gigabytes_is_refused_by_what_it_says_and_by_what_it_is(
        session: Path, said: int, is_said: bool, capsys: pytest.CaptureFixture[str]) -> None:
    packed = packed_zeros(ZEROS, is_said)
    assert len(packed) < 300_000
    (session / TELEMETRY).write_bytes(chunk(packed, b"zstd", said))
    before_kb = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    assert main(["session", "replay", str(session)]) == 2
    error = capsys.readouterr().err
    assert f"{session / TELEMETRY}: byte 8: a chunk that" in error and "unpacks to" in error
    assert resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before_kb < 300_000
    assert recover(session).ticks == 0


def test_lz4_is_unpacked_no_further_either(session: Path) -> None:
    (session / TELEMETRY).write_bytes(chunk(lz4.frame.compress(bytes(LARGEST + 1)), b"lz4", 100))
    with pytest.raises(InputError, match="unpacks to more than"):
        list(TickReader(session))


def test_a_chunk_of_zeros_is_damage_at_once(session: Path) -> None:
    """Each nine of them were read as a record."""
    (session / TELEMETRY).write_bytes(chunk(packed_zeros(LARGEST // 10_000_000 * 10_000_000, True), b"zstd",
                                            LARGEST // 10_000_000 * 10_000_000))
    reader = TickReader(session)
    assert list(reader) == [] and "something other than rows" in str(reader.cut_short)


def rewrite(session: Path, numbers: list[int]) -> None:
    """telemetry.mcap as a whole file of these of its rows."""
    rows = [data for _, data in TickReader(session)]
    with (session / TELEMETRY).open("wb") as file:
        writer = Writer(file, compression=CompressionType.LZ4)
        writer.start()
        channel = writer.register_channel("/tick", "json", 0)
        for number in numbers:
            writer.add_message(channel, log_time=0, data=rows[number], publish_time=0, sequence=number)
        writer.finish()


@pytest.mark.parametrize("lost", [range(1), range(300, 301), range(300, 400)])
def test_rows_that_are_not_there_are_said(session: Path, lost: range) -> None:
    """A chunk whose opcode is damaged was passed over as a record of some other program."""
    count = sum(1 for _ in TickReader(session))
    rewrite(session, [number for number in range(count) if number not in lost])
    reader = TickReader(session)
    assert sum(1 for _ in reader) == lost.start and f"row {lost.start + 1} is missing" in str(reader.cut_short)


def test_a_file_says_how_many_rows_it_had(session: Path) -> None:
    data = (session / TELEMETRY).read_bytes()
    whole = sum(1 for _ in TickReader(session))
    with (session / TELEMETRY).open("rb") as stream:
        summary = make_reader(stream).get_summary()
    assert summary is not None
    last = bytearray(data)
    last[max(chunk.chunk_start_offset for chunk in summary.chunk_indexes)] = 0x80     # an opcode of nobody's
    (session / TELEMETRY).write_bytes(last)
    reader = TickReader(session)
    assert sum(1 for _ in reader) < whole and f"its end states {whole}" in str(reader.cut_short)


def test_a_chunk_that_stands_there_twice_is_recovered_once(session: Path) -> None:
    data = (session / TELEMETRY).read_bytes()
    first = data.index(b"\x04\x00\x00\x00zstd") - 37
    size = 9 + struct.unpack_from("<Q", data, first + 1)[0]
    rows = [row for _, row in TickReader(session)]
    (session / TELEMETRY).write_bytes(data[:first + size] + data[first:])
    recover(session)
    assert [row for _, row in TickReader(session)] == rows


def test_a_trial_that_only_the_ticks_have_is_said(session: Path) -> None:
    lines = (session / TRIALS).read_bytes().splitlines(keepends=True)
    (session / TRIALS).write_bytes(lines[0])
    left_out = shots_from_sessions([session], "d").left_out
    assert any("trial 1: is missing; truearc session recover" in line for line in left_out)
    row = json.loads(lines[0])
    row["shot"]["distance_m"] += 1.0
    (session / TRIALS).write_bytes(json.dumps(row).encode() + b"\n" + b"".join(lines[1:]))
    left_out = shots_from_sessions([session], "d").left_out
    assert [line for line in left_out if "trial 0: is not as the telemetry has it" in line]


@pytest.mark.parametrize(("text", "said"), [("{}", "tick_hz"), ("[]", "table"), ("null", "table"),
                                            ('{"rig":5}', "rig: a table is expected")])
@pytest.mark.parametrize("command", [
    ["session", "replay", "--check"], ["shots"], ["session", "convert", "--to", "csv"]], ids=lambda words: words[-1])
def test_a_configuration_that_is_none_is_named(session: Path, tmp_path: Path, command: list[str], text: str, said: str,
                                               capsys: pytest.CaptureFixture[str]) -> None:
    (session / "config.json").write_text(text)
    out = [] if "replay" in command else ["-o", str(tmp_path / "out")]
    assert main([*command, str(session), *out]) == 2
    error = capsys.readouterr().err
    assert f"{session / 'config.json'}: " in error and said in error


def test_lines_that_are_no_text_are_named_or_left_out(session: Path) -> None:
    line = (session / TRIALS).read_bytes()
    (session / TRIALS).write_bytes(line.replace(b'"outcome":"', b'"outcome":"\xff', 1))
    with pytest.raises(InputError, match=rf"{TRIALS}:1: "):
        load_trials(session)
    (session / INDEX).write_bytes((session / INDEX).read_bytes() + b'{"t_ns":1,"file":"\xb0"}\n')
    pictures = load_pictures(session)
    recover(session)
    assert len(load_pictures(session)) == len(pictures) and len(load_trials(session)) == 2


def test_a_line_of_can_with_a_byte_of_no_text_is_none() -> None:
    assert parse_candump("(1.000000) can0 123#00 R\n") and parse_candump("(1.000000) can\ufffd 123#00 R\n") is None


def test_an_image_larger_than_any_cameras_is_none(session: Path) -> None:
    """Its head alone is read: a plain one of 40,000 pixels square is 2 MB, and 5 GB when it is unpacked."""
    _, png = cv2.imencode(".png", np.zeros((2, 2), np.uint8))
    side_px = int(MOST_PIXELS ** 0.5) + 1
    head = b"IHDR" + struct.pack(">II", side_px, side_px) + png.tobytes()[24:29]
    data = png.tobytes()[:12] + head + struct.pack(">I", zlib.crc32(head)) + png.tobytes()[33:]
    (session / FRAMES / "large.png").write_bytes(data)
    (session / FRAMES / "small.png").write_bytes(png.tobytes())
    assert load_image(session, Picture(0, "large.png")) is None
    assert load_image(session, Picture(0, "small.png")) is not None

"""Sessions cut and damaged anywhere: nothing whole is lost when they are made whole, and nothing else is believed."""

import json
import resource
import shutil
import struct
import zlib
from pathlib import Path

import cv2
import lz4.frame
import msgspec
import numpy as np
import pytest
import zstandard
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from mcap.reader import make_reader
from mcap.records import Chunk, Message
from mcap.stream_reader import StreamReader, breakup_chunk
from mcap.writer import CompressionType, Writer

from truearc.cli.main import main
from truearc.errors import InputError
from truearc.robot.recording.files import MOST_PIXELS, Appender, TickFile, load_image, load_pictures, parse_candump
from truearc.robot.recording.reader import LARGEST, TickReader
from truearc.robot.recording.replay import Difference, replay, replay_frames
from truearc.robot.recording.session import CAN, FRAMES, INDEX, MOST_ROW_BYTES, TELEMETRY, TRIALS, Picture, load_trials
from truearc.robot.recording.upkeep import recover, salvage
from truearc.sim.data.recordings import shots_from_sessions

MANY = settings(max_examples=8, deadline=None,
                suppress_health_check=[HealthCheck.function_scoped_fixture, HealthCheck.too_slow])


@pytest.fixture(scope="module")
def chunks(plain):
    """(begin, end, ticks) of every chunk of the whole file, by the library's own reader."""
    found = []
    with (plain / TELEMETRY).open("rb") as file:
        for record in StreamReader(file, emit_chunks=True).records:
            if isinstance(record, Chunk):
                ticks = len([1 for message in _messages(record)])
                found.append((file.tell() - len(record.data), file.tell(), ticks))
    return found


def _messages(chunk):
    return [record for record in breakup_chunk(chunk) if isinstance(record, Message) and record.channel_id == 1]


def tear(path, keep):
    data = path.read_bytes()
    path.write_bytes(data[:keep])


def topics(file):
    """How many messages /tick and /trial have, as the file's summary says."""
    summary = make_reader(file).get_summary()
    ids = {channel.topic: number for number, channel in summary.channels.items()}
    return tuple(summary.statistics.channel_message_counts.get(ids[topic], 0) for topic in ("/tick", "/trial"))


def marked(some_rows):
    return sum(len(msgspec.json.decode(row)["outcomes"]) for row in some_rows)


def rows(session):
    return [data for _, data in TickReader(session)]


@MANY
@given(share=st.floats(0.06, 1.0))
def test_a_file_cut_anywhere_keeps_every_whole_chunk(plain, tmp_path_factory, chunks, share):
    session = shutil.copytree(plain, tmp_path_factory.mktemp("cut") / "s")
    size = (plain / TELEMETRY).stat().st_size
    keep = int(size * share)
    tear(session / TELEMETRY, keep)
    recovered = recover(session)
    assert recovered.ticks == sum(ticks for _, end, ticks in chunks if end <= keep)
    assert rows(session) == rows(plain)[:recovered.ticks]
    with (session / TELEMETRY).open("rb") as file:
        assert topics(file) == (recovered.ticks, marked(rows(plain)[:recovered.ticks]))
    assert replay(session) == (recovered.ticks, None)
    assert replay_frames(session)[0] == (recovered.ticks, None)
    assert recover(session).repairs == []


@MANY
@given(at=st.floats(0.0, 0.9), length=st.integers(1, 300), byte=st.integers(1, 255))
def test_damage_in_the_middle_costs_the_chunks_that_it_touches(plain, tmp_path_factory, chunks, at, length, byte):
    session = shutil.copytree(plain, tmp_path_factory.mktemp("damaged") / "s")
    data = bytearray((session / TELEMETRY).read_bytes())
    first = int(len(data) * at)
    for index in range(first, min(first + length, len(data))):
        data[index] ^= byte
    (session / TELEMETRY).write_bytes(data)
    untouched = sum(ticks for begin, end, ticks in chunks if end <= first or begin - 53 >= first + length)
    recovered = recover(session)
    assert untouched <= recovered.ticks <= 1413
    assert set(rows(session)) <= set(rows(plain))
    assert not TickReader(session).cut_short


def test_frame_that_claims_an_absurd_size_costs_its_chunk_alone(session, plain, chunks):
    """zstd allocates what a frame's header states: 2^60 bytes here."""
    data = bytearray((session / TELEMETRY).read_bytes())
    frame = data.index(b"\x28\xb5\x2f\xfd", chunks[3][0])
    data[frame + 4] |= 0xC0                       # the header's content size has eight bytes now
    (session / TELEMETRY).write_bytes(data)
    assert TickReader(session) and len(rows(session)) <= len(rows(plain))
    assert recover(session).ticks == len(rows(plain)) - chunks[3][2]


def test_ticks_behind_the_damage_are_kept_and_a_replay_says_where_they_are_missing(session, plain, chunks):
    data = bytearray((session / TELEMETRY).read_bytes())
    data[(chunks[10][0] + chunks[10][1]) // 2] ^= 0xFF
    (session / TELEMETRY).write_bytes(data)
    recovered = recover(session)
    assert recovered.ticks == len(rows(plain)) - chunks[10][2]
    assert f"{chunks[10][2]} before the last of them were damaged" in recovered.repairs[0]
    before = sum(ticks for _, _, ticks in chunks[:10])
    with pytest.raises(Difference, match=f"cycle {before + chunks[10][2] + 1} follows {before}"):
        replay(session)


def test_a_whole_or_running_session_is_left_alone_and_losses_told(session, plain, capsys):
    before = {path: path.stat().st_mtime_ns for path in session.rglob("*")}
    assert main(["session", "recover", str(session)]) == 0
    assert "was whole, 1413 ticks, 2 trials" in capsys.readouterr().out
    assert {path: path.stat().st_mtime_ns for path in session.rglob("*")} == before
    (session / "can0.log").unlink()
    shutil.rmtree(session / "frames")
    assert main(["session", "recover", str(session)]) == 0
    said = capsys.readouterr().err
    assert "can0.log is not there" in said and "frames/frames.jsonl is not there" in said
    pytest.importorskip("fcntl")
    (session / TELEMETRY).unlink()
    file = Appender(session / TELEMETRY)
    assert main(["session", "recover", str(session)]) == 2
    assert "is being recorded" in capsys.readouterr().err
    file.close()


def test_what_is_replaced_is_kept_aside_each_time(session, capsys):
    originals = []
    for keep in (150_000, 100_000):
        tear(session / TELEMETRY, keep)
        originals.append((session / TELEMETRY).read_bytes())
        assert main(["session", "recover", str(session)]) == 0
    assert "whole now" in capsys.readouterr().out
    assert [(session / "damaged" / name).read_bytes() for name in (TELEMETRY, "telemetry-2.mcap")] == originals


@pytest.mark.parametrize("keep", [0, 1, 200, 500, 762])
def test_trials_that_were_torn_come_back_from_the_ticks(session, plain, keep):
    tear(session / TRIALS, keep)
    recovered = recover(session)
    assert load_trials(session) == load_trials(plain)
    assert recovered.trials == 2 and (session / TRIALS).read_bytes().endswith(b"}\n")


def test_a_trial_that_only_its_own_file_knows_is_kept(session, plain):
    tear(session / TELEMETRY, 60_000)
    recovered = recover(session)
    assert recovered.trials == 2 and load_trials(session) == load_trials(plain)


@pytest.mark.parametrize("keep", [None, 0, 100, 1000])
def test_without_one_whole_tick_what_else_is_whole_is_kept(session, plain, keep):
    lines = (session / TRIALS).read_bytes().splitlines(keepends=True)
    (session / TRIALS).write_bytes(lines[0][:50] + b"\n" + lines[1])
    if keep is None:
        (session / TELEMETRY).unlink()
    else:
        tear(session / TELEMETRY, keep)
    recovered = recover(session)
    assert (recovered.ticks, recovered.trials) == (0, 1) and load_trials(session) == load_trials(plain)[1:]
    with (session / TELEMETRY).open("rb") as file:
        assert make_reader(file).get_summary().statistics.message_count == 0
    assert recover(session).repairs == []
    with pytest.raises(InputError, match="no ticks to replay"):
        replay(session)


def test_torn_frames_and_images_leave_the_whole_ones(session, plain):
    tear(session / CAN, 100_001)
    tear(session / "frames" / load_pictures(plain)[1].file, 1000)
    recovered = recover(session)
    lines = (session / CAN).read_text().splitlines(keepends=True)
    assert all(map(parse_candump, lines))
    assert "".join(lines) == (plain / CAN).read_text()[:100_001].rpartition("\n")[0] + "\n"
    assert [picture.t_ns for picture in load_pictures(session)] == [load_pictures(plain)[0].t_ns]
    assert len(recovered.repairs) == 2
    assert (session / "damaged" / "frames.jsonl").exists()


def test_what_is_no_session_is_bad_input(session, tmp_path, capsys):
    assert main(["session", "recover", str(tmp_path / "nowhere")]) == 2
    (session / "session.json").write_text("{}")
    before = sorted(path for path in session.rglob("*"))
    assert main(["session", "recover", str(session)]) == 2
    assert "not a recording" in capsys.readouterr().err and sorted(path for path in session.rglob("*")) == before


@given(data=st.binary(max_size=2000))
def test_salvage_makes_nothing_of_noise(data):
    assert list(salvage(data + b"\x04\x00\x00\x00zstd" + data, Path())) == []


def test_a_tick_of_another_format_is_named(session):
    (session / TELEMETRY).unlink()
    with (session / TELEMETRY).open("wb") as file:
        ticks = TickFile(file)
        ticks.write(0, msgspec.json.encode({"inputs": 3}))
        ticks.finish()
    tear(session / TELEMETRY, (session / TELEMETRY).stat().st_size - 1)
    with pytest.raises(InputError, match="row 1"):
        recover(session)


ZEROS = 2_600_000_000                 # bytes, of which zstd makes 82 kB


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


@pytest.mark.parametrize(("topic", "sizes", "said"), [
    ("/tick", [MOST_ROW_BYTES + 1], "row 1: has 1048577 bytes; at most 1048576 are read"),
    ("/other", [60 << 20, 60 << 20], "unpacks to more than")])
def test_a_small_recording_with_a_huge_row_or_many_large_chunks_is_refused(
        session: Path, topic: str, sizes: list[int], said: str, tmp_path: Path,
        capsys: pytest.CaptureFixture[str]) -> None:
    with (session / TELEMETRY).open("wb") as file:
        writer = Writer(file, compression=CompressionType.ZSTD)
        writer.start()
        channel = writer.register_channel(topic, "json", 0)
        for number, size in enumerate(sizes):
            writer.add_message(channel, log_time=0, data=bytes(size), publish_time=0, sequence=number)
            writer.flush()
        writer.finish()
    size = (session / TELEMETRY).stat().st_size
    for words in (["session", "replay"], ["session", "recover"], ["shots", "--out", str(tmp_path / "out")]):
        assert main([*words, str(session)]) == 2 and f"{session / TELEMETRY}: {said}" in capsys.readouterr().err
    assert (session / TELEMETRY).stat().st_size == size
    if topic == "/other":
        with pytest.raises(InputError, match=said):
            list(salvage((session / TELEMETRY).read_bytes(), session / TELEMETRY))


def test_lz4_is_unpacked_no_further_and_zeros_are_damage_at_once(session: Path) -> None:
    (session / TELEMETRY).write_bytes(chunk(lz4.frame.compress(bytes(LARGEST + 1)), b"lz4", 100))
    with pytest.raises(InputError, match="unpacks to more than"):
        list(TickReader(session))
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


@pytest.mark.parametrize("left", [None, b"\n"], ids=["no file", "an empty line"])
def test_a_session_without_its_trials_is_named_alone_and_beside_another(session: Path, tmp_path, left) -> None:
    whole = shutil.copytree(session, tmp_path / "whole")
    (session / TRIALS).unlink()
    if left is not None:
        (session / TRIALS).write_bytes(left)
    dataset = shots_from_sessions([whole, session], "d")
    assert set(dataset.shots.text("session")) == {"whole"}
    assert [line for line in dataset.left_out if f"{session / TRIALS}: trial 0: is missing" in line]
    with pytest.raises(InputError, match=r"no marked shots; .*truearc session recover"):
        shots_from_sessions([session], "d")


def test_marked_shots_outlive_their_telemetry(session: Path) -> None:
    whole = shots_from_sessions([session], "d").shots
    (session / TELEMETRY).unlink()
    dataset = shots_from_sessions([session], "d")
    assert dataset.shots.shot_id == whole.shot_id
    assert any("telemetry.mcap: missing" in line for line in dataset.left_out)


@pytest.mark.parametrize(("text", "said"), [("{}", "tick_hz"), ("[]", "table"), ("null", "table"),
                                            ('{"rig":5}', "rig: a table is expected")])
@pytest.mark.parametrize("command", [
    ["session", "replay", "--check"], ["shots"], ["session", "convert", "--to", "csv"]], ids=lambda words: words[-1])
def test_a_configuration_that_is_none_is_named(session, tmp_path, command, text, said, capsys):
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

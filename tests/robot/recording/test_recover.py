"""Sessions cut and damaged anywhere, made whole again: no whole chunk, trial, frame or image is lost."""

import shutil

import msgspec
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from mcap.reader import make_reader
from mcap.records import Chunk, Message
from mcap.stream_reader import StreamReader, breakup_chunk

from truearc.cli.main import main
from truearc.errors import InputError
from truearc.robot.recording.files import Appender, TickFile, load_pictures, parse_candump
from truearc.robot.recording.reader import TickReader
from truearc.robot.recording.replay import Difference, replay, replay_frames
from truearc.robot.recording.session import load_trials
from truearc.robot.recording.upkeep import recover, salvage

TELEMETRY, TRIALS, CAN = "telemetry.mcap", "trials.jsonl", "can0.log"
MANY = settings(max_examples=8, deadline=None,
                suppress_health_check=[HealthCheck.function_scoped_fixture, HealthCheck.too_slow])


@pytest.fixture
def session(plain, tmp_path):
    return shutil.copytree(plain, tmp_path / "s")


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
    assert untouched <= recovered.ticks <= 1391
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
    assert "was whole, 1391 ticks, 2 trials" in capsys.readouterr().out
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
    assert list(salvage(data + b"\x04\x00\x00\x00zstd" + data)) == []


def test_a_tick_of_another_format_is_named(session):
    (session / TELEMETRY).unlink()
    with (session / TELEMETRY).open("wb") as file:
        ticks = TickFile(file)
        ticks.write(0, msgspec.json.encode({"inputs": 3}))
        ticks.finish()
    tear(session / TELEMETRY, (session / TELEMETRY).stat().st_size - 1)
    with pytest.raises(InputError, match="row 1"):
        recover(session)

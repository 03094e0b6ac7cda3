"""Files on disks that refuse: by a real limit of the kernel, which takes what fits and no more, and by made-up ones."""

import errno

import pytest

from truearc.robot.reasons import DISK_BACKLOG_FULL, FILE_DELETED
from truearc.robot.recording.files import Appender, NotKept, claim
from truearc.robot.recording.writer import disk_trouble

resource = pytest.importorskip("resource")        # POSIX


@pytest.fixture
def room():
    """A function that limits how long any file of this process may grow, lifted at the end."""
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    yield lambda limit: resource.setrlimit(resource.RLIMIT_FSIZE, (soft if limit is None else limit, hard))
    resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))


def test_a_disk_that_is_full_for_a_while_loses_nothing(tmp_path, room):
    file = Appender(tmp_path / "f")
    lines = [b"%05d\n" % number for number in range(3000)]
    room(8191)                                    # in the middle of a line
    refused = 0
    for number, line in enumerate(lines):
        if number == 2000:
            room(None)
        file.write(line)
        try:
            file.flush()
        except OSError as error:
            assert error.errno == errno.EFBIG
            refused += 1
    assert refused == 2000 - 8191 // 6
    assert file.tell() == 18000
    file.close()
    assert (tmp_path / "f").read_bytes() == b"".join(lines)


def test_what_is_on_a_full_disk_is_a_whole_beginning(tmp_path, room):
    file = Appender(tmp_path / "f", pending_bytes=1000)
    room(100)
    for number in range(1000):
        file.write(b"%05d\n" % number)
    with pytest.raises(OSError):
        file.flush()
    room(None)
    for number in range(1000, 1010):
        file.write(b"%05d\n" % number)
    with pytest.raises(NotKept, match="not kept") as caught:
        file.flush()
    assert disk_trouble(caught.value) == DISK_BACKLOG_FULL()
    file.close()
    kept = (tmp_path / "f").read_bytes().split()
    assert kept == [b"%05d" % number for number in range(len(kept))] and 100 < 6 * len(kept) < 1100


def test_a_file_is_locked_while_it_grows_and_never_written_over(tmp_path):
    file = Appender(tmp_path / "f")
    with (tmp_path / "f").open("rb") as other, pytest.raises(BlockingIOError):
        claim(other)
    with pytest.raises(FileExistsError):
        Appender(tmp_path / "f")
    file.close()
    with (tmp_path / "f").open("rb") as other:
        claim(other)


def test_a_file_that_is_deleted_under_it_is_trouble_for_good(tmp_path):
    file = Appender(tmp_path / "trials.jsonl")
    file.write(b"one\n")
    file.flush()
    (tmp_path / "trials.jsonl").unlink()
    for _ in range(2):
        file.write(b"more\n")
        with pytest.raises(NotKept, match="has been deleted") as caught:
            file.flush()
        assert disk_trouble(caught.value) == FILE_DELETED(file="trials.jsonl")
    file.close()

"""Files that are written whole, or not at all: what was there stays until all of the new one is."""

import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from truearc.robot.config.schema import InputError


@contextmanager
def whole_file(path: str | Path) -> Iterator[Path]:
    """Yield the path of a file to write beside `path`; it takes the place of that once the block has ended well.

    A character device, such as /dev/stdout, is written to as it is, and stays.

    Raises:
        InputError: there is something at `path` that is not a file. One of the block's names `path` instead.
        OSError: it cannot be written.
    """
    if Path(path).is_char_device():
        yield Path(path)
        return
    check_file(path)
    place = Path(path).resolve()      # behind a link, which stays
    new = place.with_name(f".{place.name}.part")
    try:
        yield new
        if place.exists():
            shutil.copymode(place, new)
        new.replace(place)
    except OSError as error:
        raise OSError(error.errno, error.strerror, str(path)) from error
    except InputError as error:
        raise InputError(str(error).replace(str(new), str(path))) from error
    finally:
        new.unlink(missing_ok=True)


def save_whole(path: str | Path, data: bytes) -> None:
    """Write a file by whole_file."""
    with whole_file(path) as new:
        new.write_bytes(data)


def check_file(path: str | Path) -> None:
    """InputError where there is something at `path` that is not a file."""
    if Path(path).is_dir():
        raise InputError(f"{path}: is a directory; name a file")
    if Path(path).exists() and not Path(path).is_file():
        raise InputError(f"{path}: is a pipe or a device, not a file; name a file")

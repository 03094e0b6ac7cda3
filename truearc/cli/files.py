"""Files that commands write, and lists that options take."""

from pathlib import Path

from truearc.robot.config.schema import InputError


def check_place(path: str | Path | None) -> None:
    """InputError where a file could not be written, before it is worked out what to write."""
    if path is not None and not Path(path).resolve().parent.is_dir():
        raise InputError(f"{path}: there is no such directory to write to")


def write_out(path: str | Path, text: str) -> None:
    """Write UTF-8 text as it is; InputError where that fails."""
    try:
        Path(path).write_text(text, encoding="utf-8", newline="")
    except OSError as error:
        raise InputError(f"{path}: {error.strerror or error}") from error


def names_in(option: str, text: str | None) -> tuple[str, ...] | None:
    """The names of a comma-separated list, None for None; InputError where there is none in it."""
    if text is None:
        return None
    names = tuple(name.strip() for name in text.split(",") if name.strip())
    if not names:
        raise InputError(f"{option}: names no term")
    return names

"""WPILOG files as a source for `truearc import`. The reader is not imported until the first file is read."""

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

from truearc.sim.data.importers import Importer

if TYPE_CHECKING:
    from truearc.sim.data.log import Log


def _read(path: Path, progress: Callable[[float], None]) -> "Log":
    from truearc_frc.wpilog import read_wpilog
    return read_wpilog(path, progress)


WPILOG = Importer("wpilog", ("LOG.wpilog ...",), None, _read)

"""The time span of a fault: set by one process, known to all of a run."""

import mmap
import struct
from pathlib import Path

WORDS = struct.Struct("<qqqq")
ADVICE = struct.Struct("<?ddd")


class Span:
    """Numbers in a file that every process of a run maps. Times are the run's clock's; 0: not yet."""

    def __init__(self, path: Path) -> None:
        if not path.exists():
            path.write_bytes(bytes(WORDS.size + ADVICE.size))
        with path.open("r+b") as file:
            self._words = mmap.mmap(file.fileno(), WORDS.size + ADVICE.size)

    @property
    def begin_ns(self) -> int:
        """When the fault began."""
        return self._get(0)

    @property
    def end_ns(self) -> int:
        return self._get(1)

    @property
    def rearm_ns(self) -> int:
        """When the driver armed again after it."""
        return self._get(2)

    @property
    def over_ns(self) -> int:
        """When all that was to be seen had been seen: the robot is to end."""
        return self._get(3)

    def begin(self, t_ns: int) -> None:
        self._put(0, t_ns)

    def end(self, t_ns: int) -> None:
        self._put(1, t_ns)

    def rearm(self, t_ns: int) -> None:
        self._put(2, t_ns)

    def finish(self, t_ns: int) -> None:
        self._put(3, t_ns)

    def advise(self, *torques_nm: float) -> None:
        """Torques that the robot commands: flywheels, hood and feeder."""
        ADVICE.pack_into(self._words, WORDS.size, True, *torques_nm)

    def advice(self) -> tuple[float, float, float]:
        _, wheel_nm, hood_nm, feeder_nm = ADVICE.unpack_from(self._words, WORDS.size)
        return wheel_nm, hood_nm, feeder_nm

    @property
    def is_advised(self) -> bool:
        """Whether the robot has said anything yet; on the bus one that only advises never does."""
        return bool(ADVICE.unpack_from(self._words, WORDS.size)[0])

    def stands(self) -> bool:
        return self.begin_ns > 0 and self.end_ns == 0

    def _get(self, index: int) -> int:
        return int(struct.unpack_from("<q", self._words, 8 * index)[0])

    def _put(self, index: int, t_ns: int) -> None:
        struct.pack_into("<q", self._words, 8 * index, t_ns)

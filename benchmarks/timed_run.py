"""`truearc run` with a record of each tick's lateness: `python -m benchmarks.timed_run FILE OPTIONS...`

FILE has 64-bit integers in nanoseconds: the time and the lateness of each tick, and at the end the CPU time of the
process. This is a separate module because the processes that a run starts import it again.
"""

import sys
import time
from array import array
from pathlib import Path

from truearc.cli.main import main
from truearc.robot.runtime import Lateness

if __name__ == "__main__":
    noted, note = array("q"), Lateness.note

    def note_and_keep(self: Lateness, t_ns: int, late_ns: int) -> None:
        noted.extend((t_ns, late_ns))
        note(self, t_ns, late_ns)

    Lateness.note = note_and_keep     # type: ignore[method-assign]
    began_ns = time.process_time_ns()
    code = main(["run", *sys.argv[2:]])
    noted.append(time.process_time_ns() - began_ns)
    Path(sys.argv[1]).write_bytes(noted.tobytes())
    sys.exit(code)

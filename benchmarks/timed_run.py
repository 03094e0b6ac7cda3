"""`truearc run`, noting how late each tick came and what it cost: `python benchmarks/timed_run.py FILE OPTIONS...`

A file of its own, for the processes that a run starts import it again.
"""

import sys
import time
from array import array
from pathlib import Path

from robot.lateness import Lateness
from truearc import main

if __name__ == "__main__":
    late_us, note = array("d"), Lateness.note

    def note_and_keep(self: Lateness, t_ns: int, late_ns: int) -> None:
        late_us.append(late_ns / 1000)
        note(self, t_ns, late_ns)

    Lateness.note = note_and_keep     # type: ignore[method-assign]
    began_s = time.process_time()
    code = main(["run", *sys.argv[2:]])
    late_us.append(time.process_time() - began_s)
    Path(sys.argv[1]).write_bytes(late_us.tobytes())
    sys.exit(code)

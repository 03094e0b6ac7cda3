"""CAN frames per second that each bus brings to the tick without loss, against the capacity of a wire of 1 Mbit/s.

A sender, in a process of its own wherever the bus leaves it, sends numbered frames at a steady rate; the robot's
supervised bus receives them, read by a tick 200 times per second. The rate is doubled until frames are lost, or cannot
be sent in time, then found by bisection.
"""

import argparse
import struct
import subprocess
import sys
import threading
from collections import Counter
from pathlib import Path

from benchmarks.real_robot import ROOT
from truearc.hw.emulated.serial_link import SlcanAdapter, SocketCable, open_cable
from truearc.hw.protocols import Bus, Frame, LinkLost
from truearc.hw.real.can_bus import WAIT_S, SupervisedBus, open_can
from truearc.hw.real.clock import MonotonicClock

BITRATE = 1_000_000
NS_PER_S = 1_000_000_000
FRAME_ID, NUMBER = 0x070E0005, struct.Struct("<q")
TICK_NS, BURST_NS = 5_000_000, 1_000_000          # the tick; how often the sender sends what is due
FIRST_HZ, MOST_HZ, STEPS, TRIES = 1000, 64_000, 3, 2
KEPT_UP = 0.98                                    # share of the asked rate that the sender must have sent
QUIET_NS = 500_000_000                            # without a frame: it is over

# Fields of a data frame between start of frame and checksum, which are stuffed, and those after, which are not.
STUFFED_BITS = {"11-bit id": 1 + 11 + 1 + 1 + 1 + 4 + 64 + 15, "29-bit id": 1 + 11 + 1 + 1 + 18 + 1 + 2 + 4 + 64 + 15}
REST_BITS = 1 + 1 + 1 + 7 + 3                     # checksum delimiter, acknowledgement and delimiter, end, pause


def wire_limits() -> dict[str, tuple[float, float]]:
    """Frames of 8 bytes a second on 1 Mbit/s: with the most stuffing, and with none."""
    return {kind: (BITRATE / (bits + (bits - 1) // 4 + REST_BITS), BITRATE / (bits + REST_BITS))
            for kind, bits in STUFFED_BITS.items()}


def send(bus: Bus, rate_hz: float, seconds: float) -> float:
    """Numbered frames at a steady rate; how long it took, which is longer than asked where they could not be sent."""
    clock, number = MonotonicClock(), 0
    began_ns = due_ns = clock.now_ns()
    while number < round(rate_hz * seconds):
        due_ns += BURST_NS
        clock.sleep_until_ns(due_ns)
        bus.read()
        now_ns = clock.now_ns()
        while number < min(rate_hz * (now_ns - began_ns) / NS_PER_S, rate_hz * seconds):
            bus.write(Frame(0, FRAME_ID, NUMBER.pack(number), True))
            number += 1
    return (clock.now_ns() - began_ns) / NS_PER_S


class Far:
    """The sender on one bus; `port`: what the robot opens."""

    def __init__(self, bus: str, rate_hz: float, seconds: float) -> None:
        self._took_s = 0.0
        self._thread: threading.Thread | None = None
        self._process: subprocess.Popen[str] | None = None
        if bus == "virtual":
            self.port, self._rate_hz, self._seconds = "virtual:frames", rate_hz, seconds
        else:
            self._process = subprocess.Popen([sys.executable, "-m", "benchmarks.loop_frames", bus, str(rate_hz),
                                              str(seconds)], cwd=ROOT, text=True, stdin=subprocess.PIPE,
                                             stdout=subprocess.PIPE)
            assert self._process.stdout is not None
            self.port = self._process.stdout.readline().strip()

    def start(self) -> None:
        if self._process is not None:
            assert self._process.stdin is not None
            self._process.stdin.write("\n")
            self._process.stdin.flush()
            return

        def work() -> None:
            bus = open_can("virtual", "frames", BITRATE, MonotonicClock())
            self._took_s = send(bus, self._rate_hz, self._seconds)
            bus.close()

        self._thread = threading.Thread(target=work)
        self._thread.start()

    def took_s(self) -> float:
        """How long it took to send; not to be asked before all has been received that will be."""
        if self._thread is not None:
            self._thread.join()
            return self._took_s
        assert self._process is not None
        words, _ = self._process.communicate("\n")
        return float(words)


def be_far(bus: str, rate_hz: float, seconds: float) -> None:
    """Run the sender: print its port, wait for a line, send, wait for a line, print how long it took."""
    if bus.startswith("slcan"):
        adapter = SlcanAdapter(open_cable(prompt=False) if bus == "slcan:auto" else SocketCable())
        print(f"slcan:{adapter.port}", flush=True)
        started = threading.Event()
        threading.Thread(target=lambda: (sys.stdin.readline(), started.set()), daemon=True).start()
        while not (started.is_set() and adapter.is_open):
            adapter.read()
            started.wait(0.001)
        far: Bus = adapter
    else:
        far = open_can(*bus.split(":"), BITRATE, MonotonicClock())      # type: ignore[call-arg]
        print(bus, flush=True)
        sys.stdin.readline()
    took_s = send(far, rate_hz, seconds)
    sys.stdin.readline()
    print(took_s, flush=True)
    far.close()


def receive(far: Far) -> tuple[int, int]:
    """(frames received, of which were preceded by a gap) through the robot's bus."""
    clock, tally = MonotonicClock(), Counter[str]()
    interface, channel = far.port.split(":", 1)
    bus = SupervisedBus(lambda: open_can(interface, channel, BITRATE, clock, WAIT_S, tally), clock, tally)
    far.start()
    received = gaps = 0
    heard_ns = due_ns = clock.now_ns()
    while clock.now_ns() - heard_ns < QUIET_NS + (NS_PER_S if not received else 0):
        due_ns = max(due_ns + TICK_NS, clock.now_ns())
        clock.sleep_until_ns(due_ns)
        try:
            frames = bus.read()
        except LinkLost:
            gaps += 1
            break
        for frame in frames:
            gaps += NUMBER.unpack(frame.data)[0] != received + gaps
            received += 1
            heard_ns = frame.t_ns
    bus.close()
    return received, gaps


def is_whole(bus: str, rate_hz: float, seconds: float) -> float:
    """Frames a second that came over, all of them; 0 when one was lost or they could not be sent in time."""
    far = Far(bus, rate_hz, seconds)
    received, gaps = receive(far)
    took_s = far.took_s()
    count = round(rate_hz * seconds)
    return count / took_s if received == count and not gaps and took_s * KEPT_UP <= seconds else 0.0


def sustained(bus: str, seconds: float, most_hz: float) -> float:
    """The highest rate without loss."""
    def attempt(rate_hz: float) -> float:
        return max(is_whole(bus, rate_hz, seconds) for _ in range(TRIES))

    low, best = 0.0, 0.0
    high = float(FIRST_HZ)
    while high <= most_hz and (found := attempt(high)):
        low, best, high = high, found, 2 * high
    for _ in range(STEPS):
        middle = (low + high) / 2
        if high > most_hz or not middle:
            break
        found = attempt(middle)
        low, best, high = (middle, found, high) if found else (low, best, middle)
    return best


def report(seconds: float, wanted: list[str], most_hz: float) -> None:
    """The table; wanted: of which buses, by the beginning of their names."""
    limits = wire_limits()
    for kind, (most, none) in limits.items():
        print(f"1 Mbit/s carries {most:.0f} (most stuffing) to {none:.0f} (none) frames/s of 8 bytes, {kind}")
    limit = limits["29-bit id"][1]
    print("bus                  sender                   frames/s without loss   to the wire (29-bit, no stuffing)")
    buses = [("virtual", "a thread of this process"), ("slcan:auto", "another process"),
             ("slcan:socket", "another process")]
    if Path("/sys/class/net/vcan0").exists():
        buses.append(("socketcan:vcan0", "another process"))
    for bus, where in buses:
        if not bus.startswith(tuple(wanted)):
            continue
        rate_hz = sustained(bus, seconds, most_hz)
        print(f"{bus:20s} {where:24s} {rate_hz:12.0f} {rate_hz / limit:24.2f} x", flush=True)
    if len(buses) < 4:
        print("socketcan:vcan0      not here")


if __name__ == "__main__":
    parser = argparse.ArgumentParser()
    parser.add_argument("bus")
    parser.add_argument("rate_hz", type=float)
    parser.add_argument("seconds", type=float)
    args = parser.parse_args()
    be_far(args.bus, args.rate_hz, args.seconds)

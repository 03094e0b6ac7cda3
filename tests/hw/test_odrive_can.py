"""The emulated ODrive under a driver that others wrote: odrive-can, which speaks by the maker's own DBC file."""

import asyncio
import math
import threading
import time
from collections.abc import Callable, Coroutine, Iterator
from contextlib import suppress
from typing import Any

import can
import pytest
from odrive_can.odrive import ODriveCAN

from tests.hw.host_speed import excuse_stalls
from tests.hw.spinning_plant import SpinningPlant
from truearc.hw.devices.odrive.emulator import OdriveNode, OdriveSettings
from truearc.hw.devices.odrive.frames import OdriveAxis
from truearc.hw.emulated.nodes import Twin
from truearc.hw.real.can_bus import open_can
from truearc.hw.real.clock import MonotonicClock

CHANNEL = "test_odrive_can"
TRIES = 5
WATCHDOG_MS = 800                     # heartbeats and the driver's looks at them: each 0.1 s; and a stall
Played = Callable[[Callable[[ODriveCAN], Coroutine[Any, Any, None]]], None]


@pytest.fixture
def plant() -> SpinningPlant:
    return SpinningPlant()


@pytest.fixture
def play(plant: SpinningPlant) -> Iterator[Played]:
    """Runs a program of the driver's against the emulated axis 1, in real time, on a virtual bus."""
    clock, over = MonotonicClock(), threading.Event()
    far = open_can("virtual", CHANNEL, 1_000_000, clock)
    node = OdriveNode(OdriveAxis(1, 1), "flywheel_a", plant, OdriveSettings(watchdog_ms=WATCHDOG_MS))
    twin, start_ns = Twin(plant, far, (node,), ()), clock.now_ns()

    def turn() -> None:
        while not over.is_set():
            twin.advance(clock.now_ns() - start_ns + 1)
            time.sleep(0.002)

    thread = threading.Thread(target=turn)
    thread.start()

    async def program(steps: Callable[[ODriveCAN], Coroutine[Any, Any, None]]) -> None:
        drive = ODriveCAN(1, can.Bus(interface="virtual", channel=CHANNEL))
        try:
            await asyncio.wait_for(drive.start(), 10.0)
            await steps(drive)
        finally:
            drive.stop()

    def played(steps: Callable[[ODriveCAN], Coroutine[Any, Any, None]]) -> None:
        with excuse_stalls():
            asyncio.run(program(steps))

    yield played
    over.set()
    thread.join()
    far.close()


async def hold_velocity(drive: ODriveCAN, rev_s: float, seconds: float) -> None:
    """Ask for a velocity ten times a second."""
    for _ in range(round(10 * seconds)):
        drive.set_input_vel(rev_s)
        await asyncio.sleep(0.1)


async def reach(drive: ODriveCAN, state: str) -> None:
    """Ask for a state as often as a slow machine needs: the driver itself waits one second for the heartbeat.

    The driver's reader waits for room in its queue of one answer where a second frame of the kind came before the
    question was closed, and then takes no heartbeat until somebody takes the answer out.
    """
    for _ in range(TRIES):
        while not drive._response_queue.empty():
            drive._response_queue.get_nowait()
        with suppress(TimeoutError):
            return await drive.set_axis_state(state)
    raise TimeoutError(f"no heartbeat said {state}")


async def answer_with(signal: str, ask: Callable[[], Coroutine[Any, Any, dict[str, float]]]) -> dict[str, float]:
    """The answer that has the signal.

    The driver keeps one answer at a time. Where a cyclic frame of the same kind follows the answer before the driver
    has closed the question, it gives that frame as the answer to its next question.
    """
    for _ in range(TRIES):
        answer = await ask()
        if signal in answer:
            return answer
    raise AssertionError(f"no answer with {signal}")


def test_its_questions_are_answered_and_velocity_control_feeds_the_watchdog(play: Played, plant: SpinningPlant) -> None:
    async def steps(drive: ODriveCAN) -> None:
        await drive.wait_for_heartbeat()
        warmth = await answer_with("FET_Temperature", lambda: drive._request("Get_Temperature"))
        assert warmth == {"FET_Temperature": 25.0, "Motor_Temperature": 25.0}
        assert (await answer_with("Bus_Voltage", drive.get_bus_voltage_current))["Bus_Voltage"] == plant.volts
        assert set(await answer_with("Iq_Measured", drive.get_iq)) == {"Iq_Setpoint", "Iq_Measured"}
        drive.check_alive()
        drive.check_errors()
        drive.set_controller_mode("VELOCITY_CONTROL", "PASSTHROUGH")
        await reach(drive, "CLOSED_LOOP_CONTROL")
        await hold_velocity(drive, 5.0, 2.0)              # more than twice the watchdog's time
        drive.check_errors()
        told = await answer_with("Vel_Estimate", drive.get_encoder_estimates)
        assert told["Vel_Estimate"] == pytest.approx(5.0, rel=0.05)
        assert plant.velocity_rad_s["flywheel_a"] == pytest.approx(5.0 * math.tau, rel=0.05)
        await reach(drive, "IDLE")

    play(steps)

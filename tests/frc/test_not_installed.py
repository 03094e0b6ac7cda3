"""Where truearc-frc is not installed: its recordings replay to the bit, and what needs it says so."""

import math
import subprocess
import sys
from collections.abc import Mapping
from functools import partial
from pathlib import Path

import pytest
from msgspec.structs import replace

from tests.frc.nt_server import Table
from tests.frc.test_advice import GATE, MAP, Clock, Robot
from tests.frc.test_advice import config as advised
from tests.robot.good_tick import CONFIG, NOW_NS, good_inputs
from truearc.cli.common import SHIPPED
from truearc.hw.protocols import CameraFrame
from truearc.robot.advice import ADVICE, advise_step
from truearc.robot.config.named_tables import ReadEncoder
from truearc.robot.config.schema import AprilTag, Config
from truearc.robot.gate import load_gate
from truearc.robot.reasons import ROBOT_TOO_FAST
from truearc.robot.recording.reader import TickReader
from truearc.robot.recording.replay import replay
from truearc.robot.recording.session import make_header
from truearc.robot.recording.writer import SessionWriter
from truearc.robot.runtime import run
from truearc.robot.types import Command, Inputs, Sent
from truearc_frc.advice import AdviceIo
from truearc_frc.inputs import NtCamera, NtEncoder, NtVelocity, keys_of_camera
from truearc_frc.keys import Reading
from truearc_frc.table import Nt4, Nt4Velocity, Nt4Vision, with_nt4

VISION = Nt4Vision("photonvision", "front", 0.03)
NT4 = Nt4("127.0.0.1:1", VISION, Nt4Velocity("/v", 2.0, 2.0, delay_s=0.1))
AHEAD_M = 4.0                         # of the tag along the camera's axis
TAG_M = CONFIG.camera.height_m + AHEAD_M * math.sin(math.radians(CONFIG.camera.pitch_deg))
READING = with_nt4(replace(CONFIG, hood_encoder=ReadEncoder("nt4", "/Hood/Rot", "rev", 90.0, -1),
                           apriltag=AprilTag((4,), 0.1651, TAG_M)), NT4)
TICKS = 80
ABSENT = '''
import sys
from importlib import metadata

GONE, every = ("truearc_frc", "ntcore", "wpiutil"), metadata.distributions

class Absent:
    def find_spec(self, name, path=None, target=None):
        if name.partition(".")[0] in GONE:
            raise ModuleNotFoundError(f"No module named {name!r}", name=name)

sys.meta_path.insert(0, Absent())
if sys.argv.pop(1) == "no":
    metadata.distributions = lambda **asked: (one for one in every(**asked) if one.name != "truearc-frc")
from truearc.cli.main import main
code = main(sys.argv[1:])
assert not {*GONE} & {*sys.modules}
sys.exit(code)
'''


def without(*words: object, listed: str = "no") -> subprocess.CompletedProcess[str]:
    """A command where truearc_frc cannot be imported; listed: its distribution is still there, broken."""
    return subprocess.run([sys.executable, "-c", ABSENT, listed, *map(str, words)], text=True,
                          capture_output=True, check=False)


class Launcher:
    """A launcher whose hood's angle, target and velocity come by keys; it drives ever faster."""

    def __init__(self, config: Config) -> None:
        self.clock, self.table = Clock(), Table({})
        self.clock.t_ns = NOW_NS
        self.encoder = NtEncoder(config.hood_encoder, self.table)       # type: ignore[arg-type]
        self.camera = NtCamera(config, self.table, self.clock)
        self.velocity = NtVelocity(config, self.table, self.clock)
        self.tick = 0

    def keys(self) -> Mapping[str, float]:
        alive, seen, latency, x, y, z = keys_of_camera(VISION)
        return {alive: self.tick, seen: 1.0, latency: 12.0, x: AHEAD_M, y: 0.1, z: 0.0, "/Hood/Rot": 0.11,
                "/v/0": 0.04 * self.tick, "/v/1": 0.01}

    def read(self) -> Inputs | None:
        self.tick += 1
        if self.tick > TICKS:
            return None
        self.clock.t_ns += 5_000_000
        t_ns = self.clock.t_ns
        self.table.found = {key: Reading(t_ns - 1_000_000, value) for key, value in self.keys().items()}
        velocity = self.velocity.read()
        assert velocity is not None
        return replace(good_inputs(), t_ns=t_ns, cycle=self.tick, hood_angle=self.encoder.read(t_ns),
                       sighting=self.camera.read(), velocity=velocity)

    def write(self, command: Command) -> Sent:
        return Sent(False, False, False, 0.0, 0.0, 0.0)

    def picture(self) -> CameraFrame | None:
        return None


@pytest.fixture(scope="module")
def launched(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A recording of a launcher of ours that reads the robot's keys."""
    folder = tmp_path_factory.mktemp("launched") / "session"
    recorder = SessionWriter(folder, make_header(READING, None, None), READING, None, lossless=True)
    assert run(Launcher(READING), READING, None, recorder) == TICKS
    recorder.close()
    return folder


@pytest.fixture(scope="module")
def beside(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A recording of `truearc advise`."""
    folder = tmp_path_factory.mktemp("beside") / "session"
    facts, gate, clock = advised(), load_gate(GATE), Clock()
    end_ns = clock.t_ns + 2_000_000_000
    header = replace(make_header(facts, gate, None), policy=ADVICE)
    recorder = SessionWriter(folder, header, facts, GATE.read_bytes(), lossless=True)
    rig = AdviceIo(facts, MAP, Robot(), clock, lambda: clock.t_ns >= end_ns, 0.02)
    assert run(rig, facts, gate, recorder, partial(advise_step)) > TICKS
    recorder.close()
    return folder


def test_readings_are_recorded_and_judged(launched: Path) -> None:
    tick = [tick for tick, _ in TickReader(launched)][-1]
    assert tick.inputs.hood_angle is not None and tick.memory.last_sighting is not None
    assert tick.estimate.toward_m_s == pytest.approx(0.04 * TICKS, rel=0.01)
    assert ROBOT_TOO_FAST.name in {reason.code for reason in tick.verdict.reasons}


@pytest.mark.parametrize(("session", "listed"), [("launched", "no"), ("beside", "yes")])
def test_a_recording_replays_to_the_bit(session: str, listed: str, request: pytest.FixtureRequest) -> None:
    folder = request.getfixturevalue(session)
    done = without("session", "replay", folder, "--check", listed=listed)
    assert done.returncode == 0, done.stderr
    assert f"{replay(folder).ticks} ticks" in done.stdout


@pytest.mark.parametrize(("words", "said"), [
    ("doctor --config {launcher}", "{launcher}: [nt4]: needs truearc-frc: pip install ./frc"),
    ("advise --nt 254", "truearc advise: needs truearc-frc: pip install ./frc"),
    ("import wpilog {log} --guess --rig rig.toml -o {out}", "wpilog: needs truearc-frc: pip install ./frc"),
    ("session convert {session} --to wpilog -o {out}", "--to wpilog: needs truearc-frc: pip install ./frc"),
], ids=["table", "advise", "import", "convert"])
def test_what_needs_it_says_so(words: str, said: str, launched: Path, tmp_path: Path) -> None:
    names = {"launcher": tmp_path / "launcher.toml", "log": tmp_path / "a.wpilog", "out": tmp_path / "out",
             "session": launched}
    names["launcher"].write_text(f'{SHIPPED.read_text(encoding="utf-8")}\n[nt4]\nserver = "254"\n', encoding="utf-8")
    names["log"].write_bytes(b"WPILOG")
    done = without(*words.format(**names).split())
    assert done.returncode == 2 and said.format(**names) in done.stderr
    assert not names["out"].exists()

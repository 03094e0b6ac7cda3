"""Artefacts to recompute: each makes a folder of results from committed inputs and references of others.

Inputs come from references, never from results made in the same run, so that one change shows in one artefact. In this
order `--write` makes them, each after what it reads.
"""

import json
import shutil
import tarfile
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from tests.golden.commands import run
from tests.golden.compare import COMPUTED, EXACT, FITTED, REFITTED, TRAINED

HERE = Path(__file__).parent
INPUTS = HERE / "inputs"
REFERENCE = HERE / "reference"
PROOF_1 = REFERENCE.with_name("proof_1")
DATA = Path("data")                   # in `scratch`, where commands run
RECORDING = HERE.parent / "robot" / "recording" / "golden_2.tar.xz"


@dataclass(frozen=True)
class Artefact:
    """`make(scratch, out)` fills `out`; `scratch` holds the unpacked inputs, shared by all artefacts of a run.

    Datasets are named relative to it, since some results state the path of their dataset.
    """

    name: str
    limit: float
    make: Callable[[Path, Path], None]


def unpack(scratch: Path) -> None:
    """Datasets and the golden recording."""
    for archive, folder in ((INPUTS / "datasets.tar.xz", "data"), (RECORDING, "recording")):
        with tarfile.open(archive) as tar:
            tar.extractall(scratch / folder, filter="data")


def replay(scratch: Path, out: Path) -> None:
    """Ticks of every output bit-equal, from inputs and from frames: a difference exits 1."""
    said = [run(scratch, "replay", "recording", *options) for options in ((), ("--check",), ("--from", "frames"))]
    counts = {"ticks_1116": ["1116" in text for text in said], "frames_4188": "4188" in said[2]}
    (out / "replay.json").write_text(json.dumps(counts))


def shots(scratch: Path, out: Path) -> None:
    """The dataset of the golden recording."""
    run(scratch, "shots", "recording", "-o", out / "dataset")


def launcher(scratch: Path, out: Path) -> None:
    """The configuration's hash, as session.json stamps it, and a trial with it."""
    _emulate(scratch, out, "--seed", "3", "--config", INPUTS / "launcher.toml")


def gated(kind: str) -> Callable[[Path, Path], None]:
    """The robot loads the golden gate and rates with it."""
    return lambda scratch, out: _emulate(scratch, out, "--seed", "3", "--config", INPUTS / "launcher.toml", "--gate",
                                         REFERENCE / f"export-{kind}" / "gate.onnx")


def _emulate(scratch: Path, out: Path, *options: str | Path) -> None:
    session = scratch / "sessions" / out.name
    run(scratch, "emulate", "--quiet", "--trials", "1", "--out", session, *options)
    for name in ("session.json", "trials.jsonl"):
        shutil.copy(session / name, out)


def synth(scratch: Path, out: Path) -> None:
    run(scratch, "synth", "--quiet", "--rig", DATA / "l0-null" / "rig.toml", "--coefficients",
        INPUTS / "coefficients.toml", "-n", "90", "--seed", "3", "-o", out / "synth")


def grid(scratch: Path, out: Path) -> None:
    """The whole map of the default grid, and tied pairs; 400 shots that the paper's method fits ill."""
    run(scratch, "fit grid", "--quiet", DATA / "l0-backlash", "-o", out / "coefficients.toml", "--tied",
        out / "tied.csv")


def grid_synth(scratch: Path, out: Path) -> None:
    """Simulated shots of cd 0.91 and cl 0.06, and a coarse map as a whole."""
    run(scratch, "fit grid", "--quiet", REFERENCE / "synth" / "synth", "--step", "0.05", "-o",
        out / "coefficients.toml", "--map", out / "map.npz", "--tied", out / "tied.csv")


def belief(scratch: Path, out: Path) -> None:
    run(scratch, "fit ml", "--quiet", DATA / "l1-target", "-o", out / "belief.toml")


def predict(scratch: Path, out: Path) -> None:
    """Heights by the golden belief, by one that discovery adopted, and by coefficients in the paper's two numbers."""
    for name, believed in (("belief", REFERENCE / "belief" / "belief.toml"),
                           ("adopted", PROOF_1 / "finding-l2-home_adopted.toml"),
                           ("paper", INPUTS / "coefficients.toml")):
        run(scratch, "predict", "--quiet", DATA / "l2-distance", "--coefficients", believed, "-o",
            out / f"{name}.csv")


def train_network(scratch: Path, out: Path) -> None:
    run(scratch, "train network", "--quiet", "--real", DATA / "l0-null", "--sim", REFERENCE / "synth" / "synth",
        "--epochs", "100", "--learning-rate", "0.003", "--seed", "2", "-o", out / "weights")


def train_physics(scratch: Path, out: Path) -> None:
    run(scratch, "train", "--quiet", "--real", DATA / "l0-null", "--coefficients",
        REFERENCE / "belief" / "belief.toml", "-o", out / "weights")


def export(kind: str) -> Callable[[Path, Path], None]:
    """The golden weights once more as ONNX: contract and its hash, domain, provenance, operators, constants."""
    def make(scratch: Path, out: Path) -> None:
        run(scratch, "export", REFERENCE / f"train-{kind}" / "weights", "-o", out / "gate.onnx")
    return make


def gate(kind: str) -> Callable[[Path, Path], None]:
    """The golden gate's probabilities, and `verify` against the golden weights, which exits 1 on a difference."""
    def make(scratch: Path, out: Path) -> None:
        golden, dataset = REFERENCE / f"export-{kind}" / "gate.onnx", DATA / "l0-null"
        run(scratch, "predict gate", golden, dataset, "-o", out / "rows.csv")
        run(scratch, "verify", golden, "--weights", REFERENCE / f"train-{kind}" / "weights", "--data", dataset)
    return make


def finding(dataset: str, *options: str) -> Callable[[Path, Path], None]:
    def make(scratch: Path, out: Path) -> None:
        run(scratch, "discover", "--quiet", DATA / dataset, "--json", out / "finding.json", *options)
    return make


def finding_home(scratch: Path, out: Path) -> None:
    """The session before any change, and the belief adopted from it."""
    finding("l2-home", "--believe", "gravity,drag,magnus,exit_efficiency", "--adopt", str(out / "adopted.toml"))(
        scratch, out)


def finding_since(scratch: Path, out: Path) -> None:
    """What has changed since the session whose belief was adopted at proof-1."""
    finding("l2-wind", "--belief", str(PROOF_1 / "finding-l2-home_adopted.toml"), "--since",
            str(DATA / "l2-home"))(scratch, out)


def identifiability(scratch: Path, out: Path) -> None:
    run(scratch, "identifiability", DATA / "l0-null" / "rig.toml", "--quiet", "--json", out / "identifiability.json")


def design(scratch: Path, out: Path) -> None:
    run(scratch, "design", "--quiet", DATA / "l1-target", "--json", out / "design.json")


ARTEFACTS = (
    Artefact("replay", EXACT, replay),
    Artefact("shots", COMPUTED, shots),
    Artefact("launcher", COMPUTED, launcher),
    Artefact("synth", COMPUTED, synth),
    Artefact("grid", COMPUTED, grid),
    Artefact("grid-synth", COMPUTED, grid_synth),
    Artefact("belief", FITTED, belief),
    Artefact("finding-l0-null", FITTED, finding("l0-null")),                # verdict none
    Artefact("finding-l0-backlash", FITTED, finding("l0-backlash")),        # a set, by outcomes
    Artefact("finding-l1-target", FITTED, finding("l1-target")),            # a set of names, with telemetry
    Artefact("finding-l2-distance", FITTED, finding("l2-distance")),        # named, by tracks
    Artefact("finding-l2-seam", FITTED, finding("l2-seam")),                # unknown, by tracks
    Artefact("finding-l2-home", FITTED, finding_home),
    Artefact("finding-l2-since", FITTED, finding_since),                    # against a belief
    Artefact("predict", COMPUTED, predict),
    Artefact("identifiability", FITTED, identifiability),
    Artefact("design", FITTED, design),
    Artefact("train-network", TRAINED, train_network),
    Artefact("train-physics", TRAINED, train_physics),
    Artefact("export-network", EXACT, export("network")),
    Artefact("export-physics", REFITTED, export("physics")),
    Artefact("gate-network", TRAINED, gate("network")),
    Artefact("gate-physics", TRAINED, gate("physics")),
    Artefact("gated-network", COMPUTED, gated("network")),
    Artefact("gated-physics", COMPUTED, gated("physics")),
)

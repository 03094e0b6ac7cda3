"""A drawn world -> the data that are given away, by the engine that it was drawn for."""

from collections.abc import Sequence
from dataclasses import replace
from importlib.metadata import version
from pathlib import Path

import mujoco
from msgspec import structs

from truearc import robot
from truearc.robot.config.rig_spec import Believe
from truearc.robot.config.schema import load_config
from truearc.sim.data.dataset import Dataset
from truearc.sim.data.files import save_dataset
from truearc.sim.world.options import Options
from truearc.sim.world.season import Season, ShotSetting
from truearc_proof.rounds.documents import canonical
from truearc_proof.truth.generate import Asked, follow, write
from truearc_proof.truth.world import make_world
from truearc_proof.world.season import play_season
from truearc_proof.worlds.instruments import read_off
from truearc_proof.worlds.sampling_plan import MUJOCO, Drawn, dirty_options, dirty_plan, dirty_sensors

MEASURED = "measured.json"
HOME = "home"                         # the session of the unmodified robot that MuJoCo's worlds are compared with


def make_data(drawn: Drawn, directory: Path) -> str:
    """Write the dataset; whose work it is (engine and version). The directory must be new or empty."""
    if drawn.engine == MUJOCO:
        save_dataset(directory, _season(drawn, drawn.seed, dirty_plan(drawn.dirt, drawn.seed, drawn.shots),
                                        directory.name))
        return f"mujoco {mujoco.__version__}, truearc {version('truearc')}"
    write(make_world(drawn.effects, drawn.level, drawn.shots, drawn.seed, drawn.dirt), directory)
    return f"numpy {version('numpy')}, truearc {version('truearc')}"


def make_more(drawn: Drawn, asked: Sequence[Asked], directory: Path) -> None:
    """Write the dataset of more shots of the same world: in MuJoCo another session of its robot, with fresh balls."""
    if drawn.engine == MUJOCO:
        settings = [ShotSetting(*one[:3]) for one in asked for _ in range(one.shots)]
        dataset = _season(drawn, drawn.seed + 1, settings, directory.name)
        ids = tuple(f"f1-{one}" for one in dataset.shots.shot_id)
        texts = {**dataset.shots.texts, "session": ("2",) * len(ids)}
        save_dataset(directory, replace(dataset, shots=replace(dataset.shots, shot_id=ids, texts=texts)))
        return
    dataset = follow(make_world(drawn.effects, drawn.level, drawn.shots, drawn.seed, drawn.dirt), asked)
    save_dataset(directory, replace(dataset, name=directory.name))


def _season(drawn: Drawn, seed: int, settings: Sequence[ShotSetting], name: str) -> Dataset:
    return replace(play_robot(drawn, seed, settings).dataset, name=name)


def play_robot(drawn: Drawn, seed: int, settings: Sequence[ShotSetting]) -> Season:
    """A session of MuJoCo's robot with what is hidden in it at work, and the truth beside it."""
    # what is to be believed of it is not said in rig.toml but shown in the home session
    rig = structs.replace(load_config(Path(robot.__file__).parent / "launcher.toml").rig, believe=Believe(()))
    options = structs.replace(Options(), **drawn.effects, **dirty_options(drawn.dirt, drawn.shots))
    return play_season(rig, options, seed, settings, drawn.level, dirty_sensors(drawn.dirt, rig.noise))


def make_reading(drawn: Drawn, tool: str, written: str, directory: Path) -> None:
    """Write the readings of an instrument (an id of truearc_proof.worlds.instruments) on this world's robot; `written`:
    the instrument as the claims name it."""
    directory.mkdir(parents=True)
    read = {"measure": written, "terms": read_off(tool, drawn.effects, drawn.seed)}
    (directory / MEASURED).write_bytes(canonical(read) + b"\n")


def home_of(worlds: tuple[Drawn, ...], seed: int) -> Drawn | None:
    """The unmodified session that a round with MuJoCo's worlds begins with; None for one without."""
    mine = [one for one in worlds if one.engine == MUJOCO]
    return None if not mine else Drawn(HOME, MUJOCO, "clean", mine[0].level, mine[0].shots, seed, change="nothing")

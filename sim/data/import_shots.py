"""Import of shots from the logs and tables of any team."""

from collections.abc import Mapping, Sequence
from pathlib import Path

from msgspec import structs

from truearc.errors import InputError
from truearc.robot.config.rig_spec import Rig
from truearc.robot.config.shot_map import SCHEMA, ShotMap, TimeColumn, load_map
from truearc.sim.data.dataset import Dataset
from truearc.sim.data.files import load_rig, states_three
from truearc.sim.data.guess_map import Guess, guess_map, time_column
from truearc.sim.data.log import Log, log_of
from truearc.sim.data.mapped_shots import SECONDS, read_log, shots_from_logs, shots_from_tables
from truearc.sim.data.table import XLSX, RawTable, any_table, is_shot_column
from truearc.sim.printed import Progress

TABLES = (".csv", ".txt", ".parquet", XLSX)           # of logs, or with a row per shot


def import_shots(files: Sequence[str | Path], *, rig: Rig | str | Path, shot_map: str | Path | ShotMap | None = None,
                 name: str = "imported", outcomes: Mapping[str, str] | None = None,
                 progress: Progress = lambda done, note: None) -> Dataset:
    """Return the shots of robot logs or tables as a dataset; its `left_out` lists excluded data.

    A log is a CSV file, or has a format that an installed distribution reads.

    Args:
        files: Logs, one per session, or tables.
        rig: Ball, wheels and target, or the path of a rig.toml.
        shot_map: Path of a shots.toml, or the name of an included map (docs/how-to/importing.md); None: guessed from
            names, units and numbers of the first log, or of tables with a row per shot.
        name: Name of the dataset.
        outcomes: Without a map, what words of the data mean whose meaning is not certain: {"rim": "two"}.
        progress: Called with the share of the logs read so far, and the name of the log.

    Raises:
        InputError: names file, line and key of unreadable data or of data that the map requires but are missing; or
            there are no shots.
    """
    facts = rig if isinstance(rig, Rig) else load_rig(rig)
    if shot_map is None:
        guessed = guess(files, rig, outcomes)
        if guessed.asked:
            raise InputError(f"{guessed.asked}; state what they mean: outcomes={dict(guessed.proposed)}")
        found = guessed.map
    else:
        found = shot_map if isinstance(shot_map, ShotMap) else load_map(shot_map, is_shot_column)
    words = (*found.outcome.values.values(), *found.outcome.buttons.values(), found.outcome.otherwise)
    if facts.target and not states_three(rig) and "hit" in words and "three" not in words:
        facts = structs.replace(facts, target=structs.replace(facts.target, three_half_height_m=0.0))
    paths = [Path(file) for file in files]
    if found.rows == "time":
        return shots_from_logs(paths, found, facts, name, progress)
    return shots_from_tables(paths, found, facts, name)


def guess(files: Sequence[str | Path], rig: Rig | str | Path, outcomes: Mapping[str, str] | None = None,
          progress: Progress = lambda done, note: None) -> Guess:
    """Propose a map for logs, from the first one, or for tables with a row per shot.

    InputError if nothing looks like a speed, a distance or an angle.
    """
    paths, time = [Path(file) for file in files], TimeColumn()
    facts = rig if isinstance(rig, Rig) else load_rig(rig)
    source: Log | list[RawTable]
    if paths[0].suffix.lower() in TABLES:
        tables = [any_table(paths[0])]
        if not tables[0].lines:
            raise InputError(f"{paths[0]}: has no row below its header ({', '.join(tables[0].columns)}); write a row "
                             "for each shot")
        if (found := time_column(tables[0])) is None:
            source = [*tables, *map(any_table, paths[1:])]
        else:
            time, source = found, log_of(tables[0], found.column, SECONDS[found.unit])
    else:
        source = read_log(paths[0], ShotMap(SCHEMA), progress)
    return guess_map(source, facts, str(paths[0]), time=time, has_three=states_three(rig), outcomes=outcomes)


def only(dataset: Dataset, wanted: str) -> Dataset:
    """Select shots whose text is one of those wanted, as in `ball_quality=new` or `version=a,b`.

    InputError if the column is not text, or no shot has one of the texts.
    """
    name, equals, listed = wanted.partition("=")
    texts = dataset.shots.texts
    if not equals or name not in texts:
        raise InputError(f"--only: {wanted!r} is not COLUMN=TEXT with one of the columns "
                         f"{', '.join(texts) or '(none)'}")
    column, parts = dataset.shots.text(name), listed.split(",")
    for part in parts:
        if part not in column:
            known = ", ".join(repr(text) for text in dict.fromkeys(column))
            raise InputError(f"--only: no shot has {part!r} as its {name}; there are {known}")
    return dataset.take([row for row, text in enumerate(column) if text in parts])

"""The command `demo`, which plays the acts, prints them and writes the report."""

import argparse
import secrets
import textwrap
import time
from collections import Counter
from collections.abc import Mapping
from concurrent.futures import Future, ThreadPoolExecutor
from pathlib import Path
from typing import TYPE_CHECKING

import truearc as ta
from truearc.cli.common import SHIPPED, OutFolder, make_progress, number, origin_of, write_out
from truearc.cli.datasets import GAMES, robot_of_game
from truearc.robot.config.schema import Config, load_config

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from truearc.cli.demo_acts import Act, Envelope, Sizes
    from truearc.sim.report import Origin

MARK = ".truearc-demo"                # a folder with this in it was made by us and may be made again
SEEDS = (100_000, 1_000_000)          # of which one is drawn where none is given
WIDTH = 110


def demo_options(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--out", type=OutFolder(mark=MARK), default=Path("report"),
                        help="folder for the report and all it rests on")
    parser.add_argument("--game", choices=GAMES, help="play at that game's target (default: the paper's)")
    parser.add_argument("--seed", type=number(int, 0), help="of everything drawn, the effect too (default: by entropy)")


def demo(args: argparse.Namespace, sizes: "Sizes | None" = None) -> int:
    """Let an emulated robot practise, meet a changed world, learn from marked shots what has changed, and aim again.

    In practice it learns what the paper's physics lacks of its launcher. For the event an effect is drawn and sealed;
    no sensor sees it. The control is an event at which nothing has changed. The answer comes last: what was wrong, how
    large, and what it was worth.
    """
    from truearc.cli import demo_acts as acting
    from truearc.sim.compute import keep_compiled
    from truearc.sim.data.files import hash_dataset
    keep_compiled()
    began, folder, sizes = time.monotonic(), args.out, sizes or acting.Sizes()
    seed = secrets.choice(range(*SEEDS)) if args.seed is None else args.seed
    folder.mkdir(parents=True, exist_ok=True)
    (folder / MARK).touch()
    config, envelope = _robot(folder, args.game), acting.draw_effect(seed)
    practice = _practise(folder, config, seed, sizes, args.quiet)
    with ThreadPoolExecutor(1) as beside:              # the gate needs practice alone, the film not the control
        gate = beside.submit(_save_gate, folder / "gate.onnx", practice, seed)
        acts, filmed = _play(folder, config, practice, envelope, seed, sizes, args.quiet, beside)
    gate.result()
    _say(f"what practice taught the gate: truearc serve {folder / 'gate.onnx'}")
    if filmed.result() is None and args.game is None:
        _say("the page shows no filmed flights: none could be matched to a shot, or PyAV is not installed.")
    origin = origin_of(args)
    _keep(folder, acts, origin, envelope.effect.terms)
    page = acting.save_page(folder, acts, envelope, origin._replace(sha256=hash_dataset(acts["event"].shots)),
                            filmed.result())
    print(f"\n== page: {page}; the same again: --seed {seed}   ({time.monotonic() - began:.0f} s)")
    for what, line in acting.tell(acts, envelope.effect):
        print(f"{what}: {line}")
    return 0


def _save_gate(path: Path, practice: "Act", seed: int) -> None:
    from truearc.cli.demo_acts import aimed_shots
    training = ta.train_gate(aimed_shots(practice.shots), practice.adopted, seed=seed, progress=lambda done, note: None)
    training.export(path)


def _play(folder: Path, config: Config, practice: "Act", envelope: "Envelope", seed: int, sizes: "Sizes",
          quiet: bool, beside: ThreadPoolExecutor) -> "tuple[dict[str, Act], Future[Figure | None]]":
    """Play and tell the event and the control; return all acts, and the event's film, which is made beside."""
    from truearc.cli import demo_acts as acting
    print(f"\n== the event: one of {len(acting.EFFECTS)} changes has been drawn; it is in an envelope, and no sensor "
          "sees it")
    _say(f"the envelope's SHA-256: {envelope.sha256}")
    event = acting.play_event(config.rig, practice, envelope.effect.options, seed, 2 + envelope.number, sizes,
                              make_progress("event", quiet))
    _say(f"{_marks(event)}.")
    _say(event.finding.change)
    write_out(folder / "envelope.txt", envelope.text)
    words = f"in the words of a finding: {envelope.effect.truth}" if envelope.effect.terms else acting.NO_TERM
    _say(f"the envelope is opened: {envelope.effect.name} (sha256sum {folder / 'envelope.txt'}); {words}")
    filmed = beside.submit(acting.film_event, folder, config.rig, envelope.effect.options, seed, 2 + envelope.number,
                           sizes, practice, event)
    print("\n== the control: another day, and nothing has changed")
    control = acting.play_event(config.rig, practice, acting.NOTHING.options, seed, 1, sizes,
                                make_progress("control", quiet))
    _say(f"{_marks(control)}. Verdict: {control.finding.verdict}")
    return {"practice": practice, "event": event, "control": control}, filmed


def _robot(folder: Path, game: str | None) -> Config:
    if game is None:
        return load_config(SHIPPED)
    write_out(folder / "launcher.toml", robot_of_game(SHIPPED.read_text(encoding="utf-8"), game))
    return load_config(folder / "launcher.toml")


def _practise(folder: Path, config: Config, seed: int, sizes: "Sizes", quiet: bool) -> "Act":
    from truearc.cli.demo_acts import full_points, practise
    print(f"\n== practice in the hall: {sizes.practice} shots with telemetry")
    ta.emulate(config, folder / "session", sizes.robot, seed, progress=make_progress("robot", quiet))
    recorded = ta.shots_from_sessions([folder / "session"], "practice")
    _say(f"{len(recorded.shots)} of them by the robot's own runtime on emulated devices, with images and CAN frames; "
         f"the other {sizes.practice - len(recorded.shots)} by the same MuJoCo world without buses and images")
    act = practise(config.rig, seed, sizes, recorded, make_progress("practice", quiet))
    before, after = act.volleys
    scores = {"hit": "hit", "three": "score three"}[full_points(config.rig)]
    _say(f"aimed with the paper's physics (gravity, drag, lift) {before.best(config.rig)} of {before.balls} balls "
         f"{scores}")
    _say(act.finding.change)
    _say(f"aimed again with that: {after.best(config.rig)} of {after.balls}")
    return act


def _marks(act: "Act") -> str:
    shots = act.shots.shots
    counts, sides = (Counter(shots.text(name)) for name in ("outcome", "side"))
    target = act.shots.rig.target
    scored = [f"{counts[one]} {one if target is None else target.word(one)}" for one in ("three", "two") if counts[one]]
    passed = [f"{sides[one]} {one}" for one in ("low", "high", "short", "long", "left", "right") if sides[one]]
    return (f"{len(act.shots.shots)} marked shots, aimed by what practice taught, at all its hood angles: "
            f"{', '.join([*scored, str(counts['miss'])])} missed" + f"; {', '.join(passed)}" * bool(passed))


def _keep(folder: Path, acts: "dict[str, Act]", origin: "Origin", truth: Mapping[str, float]) -> None:
    """Write each act's shots, finding and belief, for the commands that read them."""
    for name, act in acts.items():
        ta.save_dataset(folder / "data" / name, act.shots)
        act.adopted.save(folder / f"{name}.toml")
        act.finding.to_html(folder / f"{name}.html", made_at=origin.made_at, command=origin.command,
                            truth=truth if name == "event" else None)


def _say(text: str) -> None:
    print(textwrap.fill(text, WIDTH), flush=True)

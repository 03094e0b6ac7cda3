"""`truearc follow`: shots as they come, an alarm where something changed, and a proposal that changes nothing."""

import hashlib
from argparse import Namespace
from contextlib import nullcontext, redirect_stdout
from dataclasses import replace
from io import StringIO
from pathlib import Path
from typing import NamedTuple
from unittest.mock import patch

import msgspec
import numpy as np
import pytest
from msgspec import structs

import truearc as ta
from truearc.api.following import propose, sealed
from truearc.cli.aim import ShotWatch
from truearc.cli.common import SHIPPED
from truearc.cli.main import main
from truearc.hw.real.clock import MonotonicClock
from truearc.robot.aim_file import load_aim
from truearc.robot.config.schema import load_config
from truearc.robot.operator_ui.aim_inbox import AimInbox, AimOrders
from truearc.robot.operator_ui.server import OperatorPage
from truearc.sim.data.dataset import Tracks, join_datasets
from truearc.sim.discover.finding import Adoption, AimProposal, BeliefFile
from truearc.sim.discover.investigate import discover, make_belief
from truearc.sim.printed import Progress
from truearc_proof.truth.generate import shoot
from truearc_proof.truth.world import make_world

pytestmark = pytest.mark.slow
BEFORE, AFTER = 30, 40
HOME = make_world({}, "L1", 200, 21, side=True)


class Proposed(NamedTuple):
    """The folder of shots, belief and out/, what was printed, and the finding."""

    folder: Path
    said: str
    finding: ta.Finding


def session(seed: int, shots: int, effects: dict[str, float], name: str) -> ta.Dataset:
    """Shots of HOME's launcher; shot_id and session by `name`, columns of their time as if it were one session."""
    made = shoot(replace(HOME, seed=seed, shots=shots, effects=effects))
    texts = {**made.shots.texts, "session": (name,) * shots}
    numbers = {key: column for key, column in made.shots.numbers.items() if key in (
        "distance_m", "hood_deg", "motor_ratio")}
    numbers["t_s"] = 10.0 * np.arange(shots)
    ids = tuple(f"{name}{number:03d}" for number in range(1, shots + 1))
    return replace(made, name=name, traces=None, shots=replace(made.shots, shot_id=ids, numbers=numbers, texts=texts))


@pytest.fixture(scope="module")
def belief() -> ta.Belief:
    return make_belief(replace(discover(shoot(HOME), seed=1), steps=()))[0]


@pytest.fixture(scope="module")
def changed() -> ta.Dataset:
    return join_datasets(session(31, BEFORE, {}, "a"), session(32, AFTER, {"wind_x": -2.5}, "b"))


@pytest.fixture(scope="module")
def found(changed: ta.Dataset, belief: ta.Belief) -> "ta.Following":
    return ta.follow(changed, belief)


@pytest.fixture(scope="module")
def proposed(changed: ta.Dataset, belief: ta.Belief, tmp_path_factory: pytest.TempPathFactory) -> "Proposed":
    """What the command says, writes and finds, once for all tests."""
    folder, finds, find = tmp_path_factory.mktemp("proposed"), [], ta.Following.find
    ta.save_dataset(folder / "event", changed)
    belief.save(folder / "home.toml")

    def find_and_keep(following: "ta.Following", progress: Progress) -> ta.Finding:
        finds.append(find(following, progress))
        return finds[-1]

    with patch.object(ta.Following, "find", find_and_keep), redirect_stdout(StringIO()) as said:
        assert main(["follow", str(folder / "event"), "--belief", str(folder / "home.toml"), "--once", "--quiet",
                     "--distances", "3,4,5", "--out", str(folder / "out")]) == 0
    return Proposed(folder, said.getvalue(), finds[0])


@pytest.fixture(scope="module")
def named(proposed: "Proposed") -> ta.Finding:
    return proposed.finding


def test_follow_finds_since_when(found: "ta.Following") -> None:
    assert found.alarm is not None and found.since is not None
    assert BEFORE < found.alarm <= BEFORE + AFTER and abs(found.since - BEFORE - 1) <= 6
    assert found.shot(found.since) == found.dataset.shots.shot_id[found.since - 1]
    table = found.table()
    assert len(table) == BEFORE + AFTER and table.column("alarm").index(True) == found.alarm - 1
    assert "change: alarm at shot" in str(found)


def test_e_values_of_earlier_shots_do_not_depend_on_later_ones(found, changed, belief):
    part = ta.follow(changed.take(range(45)), belief)
    assert part.e_values == pytest.approx(found.e_values[:45], rel=1e-6)


def test_follow_says_no_change_of_the_same_launcher(belief, tmp_path, capsys):
    ta.save_dataset(tmp_path / "event", session(33, 60, {}, "c"))
    belief.save(tmp_path / "home.toml")
    assert main(["follow", str(tmp_path / "event"), "--belief", str(tmp_path / "home.toml"), "--once", "--quiet",
                 "--out", str(tmp_path / "out")]) == 0
    assert "60 shots: e-value" in (said := capsys.readouterr().out) and "no change" in said
    assert not (tmp_path / "out").exists()


def test_follow_proposes_a_belief_and_its_aim(proposed, changed, belief, tmp_path):
    belief.save(tmp_path / "home.toml")
    old, out = (tmp_path / "home.toml").read_bytes(), proposed.folder / "out"
    assert "; accept?" in proposed.said
    made = msgspec.json.decode((out / "proposal.json").read_bytes(), type=AimProposal)
    new = (out / made.after.file).read_bytes()
    assert [one.sha256 for one in (made.before, made.after)] == [hashlib.sha256(one).hexdigest() for one in (old, new)]
    assert (proposed.folder / "home.toml").read_bytes() == old and len(made.id) == 16 and made.t is not None
    adopted = ta.load_belief(out / "belief.toml")
    assert adopted.provenance["adopted"] and made.effects[0].low90 < made.effects[0].value < made.effects[0].high90
    tables = [ta.aim(one, changed.rig, distances_m=[4.0], hood_deg=(45.0, 60.0)).rows[0] for one in (belief, adopted)]
    assert tables[1].points > 0.3 and [row.distance_m for row in made.rows] == [3.0, 4.0, 5.0]
    for row in made.rows:
        assert row.points_after is not None and row.points_kept is not None
        assert row.points_after > row.points_kept + 0.2


def test_follow_sends_the_aim_file_to_the_robot_that_offers_it(named, changed, belief, tmp_path, capsys, monkeypatch):
    # the same shots have the same finding; how it is sent is asked here
    monkeypatch.setattr(ta.Following, "find", lambda following, progress: named)
    config = load_config(SHIPPED)
    config = structs.replace(config, rig=changed.rig, hood=structs.replace(config.hood, low_deg=10.0, high_deg=80.0))
    inbox = tmp_path / "inbox"
    page = OperatorPage(config, "", "127.0.0.1", 0, MonotonicClock(), orders=AimOrders(inbox, config))
    ta.save_dataset(tmp_path / "event", changed)
    belief.save(tmp_path / "home.toml")
    asked = ["follow", str(tmp_path / "event"), "--belief", str(tmp_path / "home.toml"), "--once", "--quiet",
             "--distances", "4:4.25:0.25", "--force", "--out", str(tmp_path / "out"), "--send", page.url, "--token"]
    try:
        (tmp_path / "wrong").write_text("wrong")
        assert main([*asked, str(tmp_path / "wrong")]) == 0
        assert "not handed over: " in (said := capsys.readouterr().out) and "401" in said
        assert main([*asked, str(inbox / "token")]) == 0
        assert "offered to the driver" in capsys.readouterr().out
    finally:
        page.close()
    box = AimInbox(inbox, config, tmp_path, {})
    box.look()
    assert box.offer is not None and "since shot" in box.offer.note
    assert load_aim(tmp_path / "out" / "aim.json").sha256 == box.offer.sha256
    assert main([*asked, str(inbox / "token")]) == 0             # the page is closed
    assert "no answer" in capsys.readouterr().out
    assert main(asked[:-1]) == 2 and main([*asked[:-4], "--token", "t"]) == 2


def test_ids_differ_with_the_content_and_not_with_the_time(found, named, changed):
    made = propose(found, named, changed.rig, (BeliefFile("home.toml", "0" * 64), "belief.toml"), [4.0])
    one, same, other = (sealed(made, content, at).proposal for content, at in (
        (b"one", "2026-03-01T10:00:00+00:00"), (b"one", None), (b"other", None)))
    assert one.id == same.id != other.id


def test_implausible_shots_are_refused_unless_accepted(changed: ta.Dataset, belief: ta.Belief) -> None:
    numbers = changed.shots.numbers | {"hood_deg": np.radians(changed.shots.number("hood_deg"))}
    radians = replace(changed, shots=replace(changed.shots, numbers=numbers))
    with pytest.raises(ta.InputError, match=r"hood_deg: .* radians"):
        ta.follow(radians, belief)
    assert ta.follow(radians, belief, accept=["hood"]).accept == ["hood"]


def test_watch_looks_again_only_after_the_files_have_changed(belief, tmp_path, capsys):
    whole = session(34, 14, {}, "d")
    watch = ShotWatch(Namespace(paths=(tmp_path / "event",), belief="home.toml", rig=None, out=None, distances=None,
                                false_alarm=0.05, seed=0, quiet=True, accept=()), belief)
    watch.look_if_grown()
    assert capsys.readouterr().err.startswith("waiting: ")
    ta.save_dataset(tmp_path / "event", whole.take(range(12)))
    watch.look_if_grown()
    assert "12 shots: e-value" in capsys.readouterr().out
    watch.look_if_grown()
    assert capsys.readouterr().out == ""
    ta.save_dataset(tmp_path / "more", whole)
    for path in (tmp_path / "more").iterdir():
        path.replace(tmp_path / "event" / path.name)
    watch.look_if_grown()
    assert "14 shots: e-value" in capsys.readouterr().out


def test_nothing_is_found_without_an_alarm(belief: ta.Belief) -> None:
    quiet = ta.follow(session(33, 20, {}, "c"), belief)
    assert quiet.alarm is None and quiet.since is None
    with pytest.raises(ta.InputError, match="no alarm"):
        quiet.find()


@pytest.mark.parametrize(("options", "error"), [
    (["--false-alarm", "0"], "--false-alarm"), (["--belief", "missing.toml"], "missing.toml"),
    (["--every", "0"], "--every"), (["--distances", "4:2:1"], "--distances")])
def test_follow_refuses_what_cannot_be(options, error, belief, tmp_path, capsys):
    belief.save(tmp_path / "home.toml")
    assert main(["follow", str(tmp_path), "--belief", str(tmp_path / "home.toml"), "--once", *options]) == 2
    assert error in capsys.readouterr().err


def test_follow_refuses_another_rig_and_mixed_folders(belief, tmp_path, capsys):
    made = session(35, 12, {}, "e")
    ta.save_dataset(tmp_path / "event", made)
    heavier = structs.replace(made.rig, ball=structs.replace(made.rig.ball, mass_kg=0.2))
    ta.save_dataset(tmp_path / "other", replace(made, facts=heavier))
    belief.save(tmp_path / "home.toml")
    assert main(["follow", str(tmp_path / "event"), "--belief", str(tmp_path / "home.toml"), "--once", "--rig",
                 str(tmp_path / "other" / "rig.toml")]) == 2
    assert "differs from that of" in capsys.readouterr().err
    (tmp_path / "live").mkdir()
    (tmp_path / "live" / "session.json").write_text("{}")
    assert main(["follow", str(tmp_path / "live"), str(tmp_path / "event"), "--belief", str(tmp_path / "home.toml"),
                 "--once"]) == 2
    assert "not a recorded session" in capsys.readouterr().err


def test_a_direction_is_proposed_only_where_marks_or_tracks_show_it(found: "ta.Following", named: ta.Finding) -> None:
    shots = found.dataset.shots
    blind = replace(found, dataset=replace(found.dataset, shots=replace(
        shots, texts={**shots.texts, "side": ("",) * len(shots)})))
    with pytest.raises(ta.InputError, match=r"nothing is proposed: of \d+ shots since the change 0 say on which side"):
        propose(blind, named, found.dataset.rig, (BeliefFile("home.toml", "0" * 64), "belief.toml"), [4.0])
    count = len(shots)
    tracks = Tracks(np.arange(count), np.zeros(count), np.ones(count), np.zeros(count), np.ones(count))
    filmed = replace(blind, dataset=replace(blind.dataset, tracks=tracks))
    assert "; accept?" in str(propose(filmed, named, found.dataset.rig, (BeliefFile("a", "0" * 64), "b"), [4.0]))


@pytest.mark.parametrize(("low90", "offered"), [(0.0, False), (0.01, True)])
def test_no_gain_is_proposed_that_may_be_nothing(low90, offered, found, named):
    worth = named.record.adoption
    assert isinstance(worth, Adoption)
    record = structs.replace(named.record, adoption=structs.replace(worth, low90=low90))
    files = (BeliefFile("home.toml", "0" * 64), "belief.toml")
    with nullcontext() if offered else pytest.raises(ta.InputError, match="which may be nothing"):
        propose(found, replace(named, investigation=replace(named.investigation, finding=record)), found.dataset.rig,
                files, [4.0])

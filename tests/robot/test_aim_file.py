"""The aim file, the collection plan and prescribed shots: read as they are or refused; every uncertainty is a HOLD."""

import errno
import math
from pathlib import Path

import msgspec
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from msgspec import UNSET
from msgspec.structs import replace
from scipy.interpolate import CubicHermiteSpline

from tests.robot.aim_files import BY_BELIEF, CONTENT, HOOD, LEAD, RATIO, SEGMENT, X, sealed, shifted, write
from tests.robot.good_tick import CONFIG, DISTANCE_M, HOOD_DEG, NOW_NS, good_inputs, good_memory, seconds
from truearc.cli.common import SHIPPED
from truearc.cli.main import main
from truearc.errors import InputError
from truearc.hw.protocols import ButtonEvent
from truearc.robot.aim import REAIM_M, aim, config_id, plan, step_walk, vacuum_speed_m_s, walked
from truearc.robot.aim_file import AimFile, Curve, load_aim, load_aim_for, load_plan, with_plan
from truearc.robot.config.schema import Prescribed
from truearc.robot.estimate import estimate, remember
from truearc.robot.operator_ui.aim_inbox import AimInbox, AimOrders, OfferingRig
from truearc.robot.operator_ui.view import Glance, describe, tell
from truearc.robot.operator_ui.what_if import QuestionError
from truearc.robot.reasons import AIM_FILE_MISSING, FIRE_NOT_REQUESTED, NO_SET_POINT
from truearc.robot.tick import step
from truearc.robot.types import AimOffer, Shot, Sighting

FREE_RAD_S = CONFIG.rig.launcher.free_speed_rad_s
FILE = AimFile(CONTENT, "a" * 64)
OTHER = AimFile(replace(CONTENT, segments=(replace(SEGMENT, motor_ratio=shifted(RATIO, 0.05)),)), "b" * 64)
AIMS = {"": FILE, OTHER.sha256: OTHER}
OFFER = AimOffer(OTHER.sha256, "wind 1.6 m/s")


@given(st.floats(2.0, 6.0))
def test_between_distances_it_is_the_cubic_that_scipy_has(distance_m):
    point = FILE.at(distance_m)
    expected = [float(CubicHermiteSpline(X, curve.value, curve.slope)(distance_m)) for curve in (HOOD, RATIO, LEAD)]
    assert point == pytest.approx(expected, rel=1e-12)


@pytest.mark.parametrize("distance_m", [1.999, 6.001, -1.0, 1e300, math.inf, math.nan])
def test_beyond_its_ends_it_has_no_set_point(distance_m):
    assert FILE.at(distance_m) is None


@given(at=st.integers(0, len(sealed()) - 1), to=st.integers(0, 255))
def test_a_changed_byte_is_refused_by_file_and_cause(tmp_path_factory, at, to):
    data = sealed()
    spoilt = data[:at] + bytes([to]) + data[at + 1:]
    path = tmp_path_factory.mktemp("a") / "a.json"
    path.write_bytes(spoilt)
    if spoilt == data:
        load_aim(path)
    else:
        with pytest.raises(InputError, match=r"a\.json: "):
            load_aim(path)


@pytest.mark.parametrize(("content", "words"), [
    (replace(CONTENT, schema="truearc.aim/9"), "schema 'truearc.aim/9'"),
    (replace(CONTENT, contract_sha256="0" * 64), "contract 000000000000"),
    (replace(CONTENT, segments=()), "segments: there is none"),
    (replace(CONTENT, segments=(replace(SEGMENT, distance_m=(2.0, 4.5, 3.0, 6.0)),)), "must be above 0 and"),
    (replace(CONTENT, segments=(replace(SEGMENT, hood_deg=Curve(HOOD.value[1:], HOOD.slope)),)), "as many of"),
    (replace(CONTENT, segments=(replace(SEGMENT, motor_ratio=shifted(RATIO, 0.5)),)), "no launcher can do that"),
    (replace(CONTENT, segments=(replace(SEGMENT, motor_ratio=Curve(RATIO.value, (9.0,) * 4)),)), "no launcher can"),
    (replace(CONTENT, segments=(SEGMENT, SEGMENT)), "must ascend without overlap"),
    (replace(CONTENT, note="two\nlines"), "note: not a line")])
def test_what_no_launcher_can_do_is_refused(tmp_path, content, words):
    with pytest.raises(InputError, match=words):
        load_aim(write(tmp_path / "a.json", content))


def test_a_file_for_another_launcher_is_refused_with_both_values(tmp_path):
    path = write(tmp_path / "a.json")
    rig = CONFIG.rig
    with pytest.raises(InputError, match=r"rig\.launcher: .*release_height_m 0\.75, this robot has 0\.8"):
        load_aim_for(path, replace(CONFIG, rig=replace(rig, launcher=replace(rig.launcher, release_height_m=0.8))))
    with pytest.raises(InputError, match="hood travels from 50"):
        load_aim_for(path, replace(CONFIG, hood=replace(CONFIG.hood, low_deg=50.0)))


def ready(distance_m=5.0, aims=AIMS, **remembered):
    """A tick before the shot: aimed by belief, wheels and hood where that aim wants them, steady."""
    seen = Sighting(NOW_NS - seconds(0.05), True, None, distance_m + CONFIG.camera.behind_exit_m, 0.03, 0.0)
    memory = replace(good_memory(), aim=None, aim_place_m=None, last_sighting=seen, **remembered)
    tick = step(good_inputs(200.0, 45.0), memory, BY_BELIEF, None, aims)
    return tick, replace(tick.memory, steady_t_ns=good_memory().steady_t_ns)


def test_it_fires_with_the_set_point_of_the_file_and_holds_without():
    tick, memory = ready(walk=(0.02, 5.0, 5.0))
    point = FILE.at(tick.estimate.distance_m)
    assert tick.aim.source == "belief" and tick.aim.hood_deg == point.hood_deg
    assert tick.aim.motor_ratio == point.motor_ratio * math.exp(0.02) and tick.aim.correction == 0.02
    assert tick.aim.lead_deg == point.lead_deg > 0.0
    fired = step(good_inputs(tick.aim.motor_ratio * FREE_RAD_S, tick.aim.hood_deg), memory, BY_BELIEF, None, AIMS)
    assert fired.verdict.fire and fired.shot is not None
    for tick, code in ((ready(aims={})[0], AIM_FILE_MISSING), (ready(7.0)[0], NO_SET_POINT),
                       (ready(5.0, walk=(1.0, 0.0, 0.0))[0], NO_SET_POINT),
                       (ready(5.0, aim_sha256="c" * 64)[0], AIM_FILE_MISSING)):
        assert code.name in {reason.code for reason in tick.verdict.reasons}
        assert tick.aim.motor_ratio == 0.0 and tick.memory.aim is None and tick.command.flywheel_torque_nm == 0.0
        assert all(one.means for one in tell(tick.verdict.reasons))


def test_a_robot_that_moves_while_its_request_stands_aims_anew():
    tick, memory = ready()
    inputs = good_inputs(tick.aim.motor_ratio * FREE_RAD_S, tick.aim.hood_deg)
    assert step(inputs, memory, BY_BELIEF, None, AIMS).verdict.fire

    def moved(by_m):
        seen = memory.last_sighting
        return replace(memory, last_sighting=replace(seen, distance_m=seen.distance_m + by_m))

    assert step(inputs, moved(0.9 * REAIM_M), BY_BELIEF, None, AIMS).aim == tick.aim
    away = step(inputs, moved(1.1 * REAIM_M), BY_BELIEF, None, AIMS)
    assert away.aim.motor_ratio == FILE.at(away.estimate.distance_m).motor_ratio != tick.aim.motor_ratio
    gone = step(inputs, moved(2.0), BY_BELIEF, None, AIMS)
    assert not gone.verdict.fire and gone.memory.aim is None


def press(button, memory, **inputs):
    buttons = (ButtonEvent(NOW_NS, 1, button),)
    return step(replace(good_inputs(200.0, 45.0, buttons), **inputs), memory, BY_BELIEF, None, AIMS).memory


def test_an_offer_is_taken_by_button_or_page_while_disarmed_alone():
    memory = replace(good_memory(), walk=(0.03, 0.0, 0.0))
    disarmed = replace(memory, armed=False, aim=None, request_t_ns=0)
    assert press("accept", memory, aim_offer=OFFER).aim_sha256 is UNSET
    assert press("accept", disarmed).aim_sha256 is UNSET
    for button in ("arm", "fire", "miss-low", "reject"):
        assert press(button, disarmed, aim_offer=OFFER).aim_sha256 is UNSET
    taken = press("accept", disarmed, aim_offer=OFFER)
    assert taken.aim_sha256 == OTHER.sha256 and taken.walk == (0.0, 0.0, 0.0)
    marked = replace(taken, walk=(0.01, 0.0, 0.0))
    assert press("accept", marked, aim_offer=OFFER).walk == (0.01, 0.0, 0.0)      # a second press changes nothing
    tick, _ = ready(aim_sha256=OTHER.sha256)
    assert tick.aim.motor_ratio == OTHER.at(tick.estimate.distance_m).motor_ratio
    disarmed = replace(good_memory(), armed=False, aim=None, request_t_ns=0)
    assert accept_on_page(good_memory(), OFFER.sha256).aim_sha256 is UNSET
    assert accept_on_page(disarmed, "c" * 64).aim_sha256 is UNSET
    assert accept_on_page(disarmed, OFFER.sha256, UNSET).aim_sha256 is UNSET
    assert accept_on_page(disarmed, OFFER.sha256).aim_sha256 == OTHER.sha256


def accept_on_page(memory, sha256, offer=OFFER):
    inputs = replace(good_inputs(200.0, 45.0), aim_offer=offer, aim_accept=sha256)
    return step(inputs, memory, BY_BELIEF, None, AIMS).memory


@pytest.fixture
def orders(tmp_path):
    return AimOrders(tmp_path / "in", CONFIG)


def bearer(orders, tmp_path):
    return "Bearer " + (tmp_path / "in" / "token").read_text().strip()


def refusal(order, token, body):
    with pytest.raises(QuestionError) as refused:
        order(token, body)
    return refused.value


def test_the_page_keeps_a_sound_file_for_who_has_the_token_and_hands_on_its_acceptance(orders, tmp_path):
    token, data = bearer(orders, tmp_path), sealed()
    assert (tmp_path / "in" / "token").stat().st_mode & 0o077 == 0
    assert orders.keep(token, data).status == 201
    inbox = AimInbox(tmp_path / "in", CONFIG, tmp_path, {})
    inbox.look()
    assert inbox.offer is not None and inbox.accepted is None
    accepted = msgspec.json.encode({"sha256": inbox.offer.sha256})
    assert orders.accept(token, accepted).status == 202
    inbox.look()

    class Rig:
        def read(self):
            return good_inputs(200.0, 45.0)

    rig = OfferingRig(Rig(), inbox)
    first, second = rig.read(), rig.read()
    assert first.aim_accept == inbox.offer.sha256 and first.aim_offer == inbox.offer
    assert second.aim_accept is UNSET and second.aim_offer == inbox.offer
    assert AimOrders(tmp_path / "in", CONFIG).accept(token, accepted).status == 202        # the token stays


def test_a_page_on_a_full_disk_takes_no_order_and_makes_its_token_at_the_next_start(tmp_path, monkeypatch):
    with monkeypatch.context() as patch:
        patch.setattr("os.open", lambda *_, **__: (_ for _ in ()).throw(OSError(errno.ENOSPC, "No space left")))
        full = AimOrders(tmp_path, CONFIG)
    assert "the token" in str(refusal(full.keep, "Bearer ", b""))
    (tmp_path / "token").touch()                  # as a disk that was full leaves it
    AimOrders(tmp_path, CONFIG)
    assert len((tmp_path / "token").read_text()) > 20


@pytest.mark.parametrize(("data", "words"), [
    (b"", "truncated"), (b"{", "truncated"), (sealed().replace(b"60.0", b"61.0"), "damaged or altered"),
    (sealed(replace(CONTENT, rig=replace(CONTENT.rig, target=None))), "rig.target")])
def test_an_unsound_file_is_not_kept_and_the_answer_says_why(orders, tmp_path, data, words):
    error = refusal(orders.keep, bearer(orders, tmp_path), data)
    assert error.status == 400 and words in str(error) and str(tmp_path) not in str(error)
    assert [one.name for one in (tmp_path / "in").iterdir()] == ["token"]


@pytest.mark.parametrize("body", [b"", b"[]", b'{"sha256": 1}', b'{"sha256": "a", "b": 1}', b'{"sha256": "../token"}',
                                  b"[" * 5000])
def test_an_acceptance_of_what_is_not_there_is_refused(orders, tmp_path, body):
    orders.keep(bearer(orders, tmp_path), sealed())
    assert refusal(orders.accept, bearer(orders, tmp_path), body).status in (400, 404)
    assert not (tmp_path / "in" / "accept").exists()


@pytest.mark.parametrize(("button", "walk"), [("miss-low", 0.01), ("miss-high", -0.01), ("two-low", 0.0),
                                              ("two-high", 0.0), ("two", 0.0), ("three", 0.0)])
def test_a_button_marks_the_newest_shot_and_only_a_miss_corrects(button, walk):
    fired = step(good_inputs(), good_memory(), BY_BELIEF, None, AIMS)
    shot = step(good_inputs(), good_memory(), CONFIG, None).shot
    memory = replace(fired.memory, awaiting=True, last_shot=shot)
    inputs = replace(good_inputs(), buttons=(ButtonEvent(NOW_NS, 1, button),))
    answered = step(inputs, memory, BY_BELIEF, None, AIMS)
    assert [(one.trial, one.outcome) for one in answered.outcomes] == [(shot.trial, button)]
    assert answered.memory.walk == pytest.approx((walk, 0.0, 0.0)) and not answered.memory.awaiting


def drive(rate_m_s, noise_m=0.0, period_s=0.05, late_s=0.08):
    """(distance believed, true distance) of ticks while driving at a constant speed, seen late and with noise."""
    rng, memory, rows = np.random.default_rng(1), good_memory(), []
    for number in range(400):
        t_ns = NOW_NS + number * seconds(0.005)
        seen = None
        if number % round(period_s / 0.005) == 0:
            taken_ns = t_ns - seconds(late_s)
            true_m = 5.0 + rate_m_s * (taken_ns - NOW_NS) * 1e-9
            seen_m = true_m + CONFIG.camera.behind_exit_m + noise_m * rng.normal()
            seen = Sighting(taken_ns, True, None, seen_m, 0.03, 0.0)
        inputs = replace(good_inputs(200.0, 45.0), t_ns=t_ns, sighting=seen)
        memory = remember(inputs, memory, BY_BELIEF)
        rows.append((estimate(inputs, memory, BY_BELIEF).distance_m, 5.0 + rate_m_s * (t_ns - NOW_NS) * 1e-9))
    return np.array(rows)[300:].T


@pytest.mark.parametrize("rate_m_s", [0.0, -2.0, 3.0])
def test_the_age_of_a_sighting_is_made_up_for_at_a_constant_speed(rate_m_s):
    believed_m, true_m = drive(rate_m_s)
    assert np.abs(believed_m - true_m).max() < 0.002      # unfiltered and uncorrected: up to 0.13 s late, 0.39 m


def test_standing_still_averages_and_a_jump_starts_anew():
    believed_m, true_m = drive(0.0, noise_m=0.05)
    assert np.sqrt(np.mean((believed_m - true_m)**2)) < 0.05
    memory = good_memory()
    for number, distance_m in enumerate((5.0, 5.0, 3.0)):
        seen = Sighting(NOW_NS + number * seconds(0.05), True, None, distance_m, 0.03, 0.0)
        memory = remember(replace(good_inputs(200.0, 45.0), t_ns=seen.t_ns, sighting=seen), memory, BY_BELIEF)
    assert memory.track.distance_m == pytest.approx(3.0 - CONFIG.camera.behind_exit_m) and memory.track.rate_m_s == 0.0


def test_the_page_shows_lead_correction_and_offer():
    tick, _ = ready(walk=(0.02, 0.0, 0.0))
    tick = replace(tick, inputs=replace(tick.inputs, aim_offer=OFFER))
    view = describe(Glance(1, tick), tick, BY_BELIEF, "s")
    shown = {line.name: line.value for line in view.blocks[0].lines}
    assert shown["turn"].endswith("to the left of the target") and shown["corrected"].startswith("+2.0%")
    assert (view.offer.note, view.offer.sha256, view.offer.is_open) == (OFFER.note, OFFER.sha256, False)
    taken = replace(tick, memory=replace(tick.memory, aim_sha256=OFFER.sha256))
    assert describe(Glance(1, taken), taken, BY_BELIEF, "s").offer is None
    assert FIRE_NOT_REQUESTED.name not in {reason.code for reason in tick.verdict.reasons}


def test_a_file_that_was_made_when_the_format_was_new_is_still_read():
    aim = load_aim_for(Path(__file__).parent / "aim.json", CONFIG)
    assert aim.at(2.7) == FILE.at(2.7) and aim.content.note == "wind"


@given(st.floats(1.0, 12.0), st.floats(0.5, 2.5), st.floats(20.0, 74.0))
def test_the_vacuum_speed_hits_the_target(distance_m, rise_m, elevation_deg):
    speed = vacuum_speed_m_s(distance_m, rise_m, elevation_deg, 9.81)
    angle = math.radians(elevation_deg)
    if speed is None:
        assert distance_m * math.tan(angle) <= rise_m
        return
    flight = distance_m / (speed * math.cos(angle))
    assert math.isclose(speed * math.sin(angle) * flight - 9.81 * flight**2 / 2, rise_m, abs_tol=1e-6)


def test_the_plan_fills_hood_range_and_speeds_evenly_and_repeats_what_it_should():
    shares, trims = np.array([plan(trial, CONFIG.collect) for trial in range(300)]).T
    for third in range(3):
        assert 90 <= np.sum((shares >= third / 3) & (shares < (third + 1) / 3)) <= 110
    assert np.max(np.abs(trims)) <= CONFIG.collect.spread
    assert abs(np.mean(trims)) < 0.01


def shot(distance_m, trial, hood_deg=45.0):
    return Shot(trial, 0, "c", distance_m, 0.02, hood_deg, 0.5, 300.0, 12.0, None, None, None)


def test_marks_walk_the_speed_but_for_what_the_trim_explains():
    collect = CONFIG.collect
    small = next(trial for trial in range(100) if abs(plan(trial, collect)[1]) < 0.1 * collect.spread)
    walk = (0.0, 0.0, 0.0)
    for _ in range(5):
        walk = step_walk(walk, -1, shot(8.0, small), CONFIG)
    assert walked(walk, 8.0, 45.0) > walked(walk, 5.0, 45.0) > 0.0
    assert step_walk(walk, 0, shot(8.0, small), CONFIG) == walk
    collect = CONFIG.collect
    fast = next(trial for trial in range(100) if plan(trial, collect)[1] > 0.5 * collect.spread)
    assert step_walk((0.0, 0.0, 0.0), 1, shot(5.0, fast), CONFIG) == (0.0, 0.0, 0.0)
    assert step_walk((0.0, 0.0, 0.0), -1, shot(5.0, fast), CONFIG)[0] > 0.0


ROWS = (Prescribed(DISTANCE_M, 0.5, HOOD_DEG), Prescribed(7.0, 0.625, 33.0))


def written(path, text):
    path.write_text(text, encoding="utf-8")
    return path


def test_columns_may_stand_in_any_order_and_a_dataset_is_a_plan(tmp_path):
    file = written(tmp_path / "p.csv", "hood_deg,name,distance_m,motor_ratio\n50,a,5,0.5\n33,b,7.0,0.625\n")
    assert load_plan(file, CONFIG) == ROWS
    written(tmp_path / "shots.csv", "shot_id,distance_m,hood_deg,motor_ratio,outcome\ns1,7.0,33.0,0.625,two\n")
    assert load_plan(tmp_path, CONFIG) == ROWS[1:]


@settings(deadline=None)
@given(rows=st.lists(st.tuples(st.floats(0.1, 30.0), st.floats(0.01, 1.0), st.floats(15.0, 75.0)), min_size=1))
def test_what_is_written_is_read_to_the_bit(tmp_path_factory, rows):
    text = "distance_m,motor_ratio,hood_deg\n" + "".join(f"{d!r},{r!r},{h!r}\n" for d, r, h in rows)
    file = written(tmp_path_factory.mktemp("plan") / "p.csv", text)
    assert [(row.distance_m, row.motor_ratio, row.hood_deg) for row in load_plan(file, CONFIG)] == rows


@pytest.mark.parametrize(("text", "message"), [
    ("distance_m,motor_ratio\n5,0.5\n", r"p\.csv:1: columns hood_deg are missing; a plan has them"),
    ("", r"p\.csv:1: columns distance_m, motor_ratio, hood_deg are missing"),
    ("distance_m,motor_ratio,hood_deg\n", "no rows"),
    ("distance_m,motor_ratio,hood_deg\n5,0.5,45\n5,1.01,45\n", r"p\.csv:3: motor_ratio: 1\.01 is out of the .*0 to 1"),
    ("distance_m,motor_ratio,hood_deg\n5,0.5,14\n", r"p\.csv:2: hood_deg: 14 is out of the .*15 to 75"),
    ("distance_m,motor_ratio,hood_deg\n5,0,45\n", "motor_ratio: 0 is out"),
    ("distance_m,motor_ratio,hood_deg\n5,nan,45\n", "motor_ratio: 'nan' is not a number"),
    ("distance_m,motor_ratio,hood_deg\ninf,0.5,45\n", "distance_m: inf is out"),
    ("distance_m,motor_ratio,hood_deg\n5,,45\n", "motor_ratio: '' is not a number"),
    ("distance_m,motor_ratio,hood_deg\n5,0.5\n", "hood_deg: '' is not a number"),
    ("distance_m,motor_ratio,hood_deg\n" + "5,2,45\n" * 9, "and 4 more")])
def test_a_row_that_cannot_be_is_named(tmp_path, text, message):
    with pytest.raises(InputError, match=message):
        load_plan(written(tmp_path / "p.csv", text), CONFIG)


@pytest.mark.parametrize("verb", [["emulate", "--out", "s"], ["run", "--config", str(SHIPPED)]])
def test_the_verbs_refuse_it_with_exit_code_2_and_leave_nothing(verb, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    written(tmp_path / "p.csv", "distance_m,motor_ratio,hood_deg\n5,0.5,80\n")
    assert main([*verb, "--plan", "p.csv"]) == 2
    assert "p.csv:2: hood_deg: 80" in capsys.readouterr().err
    assert main([*verb, "--plan", "nowhere.csv"]) == 2
    assert "nowhere.csv" in capsys.readouterr().err
    assert [path.name for path in tmp_path.iterdir()] == ["p.csv"]


@pytest.mark.parametrize("words", [[], ["--trials", "5"], ["--repeats", "0"]])
def test_how_many_must_be_possible(words, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    written(tmp_path / "p.csv", "distance_m,motor_ratio,hood_deg\n5,0.5,45\n")
    plan = ["--plan", "p.csv"] if words else []
    assert main(["emulate", "--out", "s", *plan, *words, "--quiet"]) == 2
    assert "--trials" in (said := capsys.readouterr().err) or "--repeats" in said
    assert not (tmp_path / "s").exists()


PLANNED = with_plan(CONFIG, ROWS, repeats=2)


def aim_at(trial, config=PLANNED):
    memory = replace(good_memory(), trial=trial, aim=None)
    return aim(estimate(good_inputs(), memory, config), memory, config)


def test_each_row_is_shot_as_often_as_asked_and_marks_walk_nothing():
    assert (aim_at(0).motor_ratio, aim_at(0).hood_deg, aim_at(0).source) == (0.5, HOOD_DEG, "plan")
    assert aim_at(1) == aim_at(0)
    assert (aim_at(2).motor_ratio, aim_at(2).hood_deg) == (0.625, 33.0)
    assert aim_at(4).source == "idle"
    assert [config_id(trial, PLANNED.collect) for trial in range(4)] == ["c0000", "c0000", "c0001", "c0001"]
    shot = Shot(0, 0, "c", 8.0, 0.02, 45.0, 0.5, 300.0, 12.0, None, None, None)
    assert step_walk((0.1, 0.0, 0.0), -1, shot, PLANNED) == (0.1, 0.0, 0.0)
    assert step_walk((0.1, 0.0, 0.0), -1, shot, CONFIG) != (0.1, 0.0, 0.0)

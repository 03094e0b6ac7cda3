"""The aim file: read as it was sealed or refused; what it says is aimed at; every uncertainty is a HOLD."""

import errno
import math
from pathlib import Path

import msgspec
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from msgspec import UNSET
from msgspec.structs import replace
from scipy.interpolate import CubicHermiteSpline

from tests.robot.aim_files import BY_BELIEF, CONTENT, HOOD, LEAD, RATIO, SEGMENT, X, sealed, shifted, write
from tests.robot.good_tick import CONFIG, NOW_NS, good_inputs, good_memory, seconds
from truearc.errors import InputError
from truearc.hw.protocols import ButtonEvent
from truearc.robot.aim import REAIM_M
from truearc.robot.aim_file import AimFile, Curve, load_aim, load_aim_for
from truearc.robot.estimate import estimate, remember
from truearc.robot.operator_ui.aim_inbox import AimInbox, AimOrders, OfferingRig
from truearc.robot.operator_ui.view import Glance, describe, tell
from truearc.robot.operator_ui.what_if import QuestionError
from truearc.robot.reasons import AIM_FILE_MISSING, FIRE_NOT_REQUESTED, NO_SET_POINT
from truearc.robot.tick import step
from truearc.robot.types import AimOffer, Sighting

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
    (replace(CONTENT, note="two\nlines"), "note: not a line"),
])
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


@pytest.mark.parametrize("token", ["", "Bearer ", "Bearer x", "Basic abc", "Bearer \xe4"])
def test_who_lacks_the_token_gives_no_order(orders, tmp_path, token):
    for order, body in ((orders.keep, sealed()), (orders.accept, b'{"sha256":"a"}')):
        assert refusal(order, token, body).status == 401
    assert [one.name for one in (tmp_path / "in").iterdir()] == ["token"]


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

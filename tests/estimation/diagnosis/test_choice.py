"""Which candidates are worth a fit, and which results say that something is left out."""

from __future__ import annotations

from collections import Counter
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from concealed_axis import posed, run
from screened import screened

from backsight.estimation import smooth
from backsight.estimation.diagnosis.answer.verdict import Explanation, Strength
from backsight.estimation.diagnosis.candidates.candidate import Candidate, Signal
from backsight.estimation.diagnosis.candidates.edits import Insert, Rebuild, Since
from backsight.estimation.diagnosis.candidates.laws import AGAINST_GROUND, Motion, of_law
from backsight.estimation.diagnosis.candidates.places import bodies
from backsight.estimation.diagnosis.scores.chance import Chance
from backsight.estimation.diagnosis.scores.screen import Screen, Screened
from backsight.estimation.diagnosis.scores.shares import Sizes
from backsight.estimation.diagnosis.search.choice import (
    CLEAR,
    WRONG,
    amiss,
    as_good,
    beyond,
    chosen,
    clear,
    coloured,
    evened,
    explaining,
    held_unseen,
    idle,
    matters,
    plainest_first,
    plainness,
    simpler_there,
    simplest_beside,
    sound,
    spared,
    stood_for,
)
from backsight.estimation.diagnosis.search.refit import Fitted
from backsight.models.mechanics.translational import PositionDependentFriction


def screen(*found: Screened) -> Screen:
    return Screen(found=found, chance=Chance(looks=Counter({1: len(found)})), G=np.empty((0, 0)), plain=np.empty(0), columns=())


def test_friction_that_may_hold_an_unseen_body_is_fitted_whatever_its_score_and_once():
    seen, unseen = screened("table", "coulomb_friction", 90.0), screened("bit", "coulomb_friction", 0.1)
    other, stribeck = screened("bit", "spring", 0.1), screened("bit", "stribeck_friction", 70.0)
    found = screen(seen, stribeck, unseen, other)
    assert held_unseen(found, [seen], {"bit"}) == [stribeck, unseen]
    assert held_unseen(found, [seen, stribeck], {"bit"}) == [unseen]
    assert held_unseen(found, [seen], set()) == []


def test_what_gains_no_more_with_more_parameters_is_left_to_a_later_round():
    simple, larger = screened("table", "viscous_friction", 50.0), screened("table", "asymmetric_friction", 52.0, size=2)
    sizes = SimpleNamespace(names=["table", "elsewhere"])
    assert simpler_there(larger, [simple, larger], sizes)
    assert not simpler_there(replace(larger, gain=54.0), [simple, larger], sizes)
    assert not simpler_there(larger, [screened("elsewhere", "viscous_friction", 50.0), larger], sizes)


@pytest.mark.parametrize(("axis", "is_simpler"), [("body.f_x", False), ("body.tau_y", True)])
def test_what_acts_in_another_balance_of_a_body_is_not_simpler(axis, is_simpler):
    drag, moment = screened("body", "drag", 50.0), screened("body", "moment", 52.0, size=2)
    shares = {"drag": {"body.f_x": 0.1, "body.tau_y": 0.0, axis: 0.2}, "moment": {"body.f_x": 0.0, "body.tau_y": 0.2}}
    sizes = SimpleNamespace(names=["body.f_x", "body.tau_y"], shares=lambda look, _: shares[look.candidate.physics])
    assert simpler_there(moment, [drag, moment], sizes) is is_simpler


def test_of_what_cannot_be_told_apart_the_plainest_stands():
    s = screened("p", "x", 9.0)
    rich, plain, far = ("rich", s, 100.0, (3, 2)), ("plain", s, 98.0, (3, 1)), ("far", s, 96.0, (0, 1))
    assert as_good([rich, plain, far]) == ["plain", "rich"]
    assert as_good([rich, far]) == ["rich"]


def test_of_numbers_that_no_recording_can_tell_apart_the_one_that_the_study_gives_is_doubted_first():
    def doubted(name: str, stated: bool) -> Candidate:
        return Candidate(place="drive", family="parameter", physics="wrong_parameter", strengths=(name,), stated=stated)

    known, default = doubted("drive.J", stated=True), doubted("slide.m", stated=False)
    assert plainness(known, [0.0]) < plainness(default, [0.0])
    plainer = Candidate(place="drive", family="sensor", physics="sensor_gain", strengths=("gain.k",))
    assert (plainness(plainer, [0.0]) < plainness(default, [0.0])) == (plainer.rank < default.rank)  # the kind of explanation comes first


def test_of_a_sensor_what_comes_late_is_fitted_beside_what_reads_otherwise():
    late = screened("input:tau", "input_delay", 150.0)
    gain, delay, lag, off = (screened("sensor:phi", f"sensor_{word}", 50.0 - k) for k, word in enumerate(("gain", "delay", "lag", "bias")))
    sizes = SimpleNamespace(names=[], shares=lambda *_: {"joint": 0.2})
    assert chosen(screen(late, gain, delay, lag, off), sizes) == [late, gain, delay]


def of_family(s: Screened, family: str) -> Screened:
    return replace(s, look=replace(s.look, candidate=replace(s.candidate, family=family)))


@pytest.mark.parametrize(("absorbs", "is_fitted"), [({}, True), ({"friction.f_c": "own.f_c"}, False)])
def test_beside_asperities_where_there_is_no_friction_yet_that_which_yields_by_nothing_is_fitted(absorbs, is_fitted):
    """By the scores it gains less than half as much: there they bend far."""
    yielding, level = screened("joint", "presliding_friction", 130.0, size=2), screened("joint", "coulomb_friction", 60.0)
    yielding = replace(yielding, look=replace(yielding.look, candidate=replace(yielding.candidate, absorbs=absorbs)))
    slowing = screened("joint", "viscous_friction", 64.0)
    assert (simplest_beside(yielding, [yielding, slowing, level]) is level) is is_fitted


@pytest.mark.parametrize(("gain", "is_fitted"), [(50.0, True), (20.0, False)])
def test_where_something_is_late_what_may_be_late_on_the_other_side_is_fitted_beside_all_else(gain, is_fitted):
    """An encoder a tenth of the motion late: its score goes by a straight line, the input's delay gains more, and so does much else."""
    late = of_family(screened("input:tau", "input_delay", 178.0), "actuator")
    wrong = [screened(f"link_{k}", "wrong_parameter", 80.0 - k) for k in range(5)]
    delay, lag = (of_family(screened("sensor:phi", f"sensor_{word}", g), "sensor") for word, g in (("delay", gain), ("lag", gain - 10.0)))
    found = chosen(screen(late, *wrong, delay, lag), SimpleNamespace(names=[], shares=lambda *_: {"joint": 0.2}))
    assert [s for s in found if s.candidate.family == "sensor"] == [delay][:is_fitted]
    assert late in found
    assert len(found) > 5


def test_what_was_fitted_does_not_stand_before_the_others_a_second_time():
    """A mass without end gains most, and a wave, which has a phase besides, a sixth of that."""
    mass, lag = screened("rotor", "added_mass", 740.0), of_family(screened("input:i", "input_lag", 570.0), "actuator")
    wave, offset = screened("rotor", "cogging", 130.0, size=2), screened("input:i", "input_offset", 98.0)
    sizes = SimpleNamespace(names=["rotor"], shares=lambda *_: {"rotor": 0.2})
    found = screen(mass, lag, wave, offset)
    assert chosen(found, sizes) == [mass, lag]
    assert chosen(found, sizes, [mass, lag]) == [wave, offset]
    assert chosen(found, sizes, [mass, lag, wave]) == [offset]
    assert chosen(found, sizes, found.found) == []


def test_what_has_the_same_name_as_what_was_fitted_has_its_turn():
    """A force along the other axis."""
    along, across = (screened("load", "constant_force", nats) for nats in (90.0, 40.0))
    delay, late = (
        of_family(screened("sensor:phi", "sensor_delay", 50.0), "sensor"),
        of_family(screened("input:F", "input_delay", 60.0), "actuator"),
    )
    sizes = SimpleNamespace(names=["load"], shares=lambda *_: {"load": 0.2})
    assert chosen(screen(along, across), sizes, [along]) == [across]
    assert chosen(screen(late, delay), sizes, [delay]) == [late]


@pytest.mark.parametrize("at_body", [True, False])
def test_a_body_with_several_balances_has_the_best_of_each_fitted(at_body):
    """Four forces gain most. What turns the body, or another one, is fitted beside them, and not a fifth force that gains as much."""
    forces = [screened("body", f"force {k}", 100.0 - k) for k in range(4)]
    turning, fifth = screened("body" if at_body else "arm", "torque", 30.0), screened("body", "fifth force", 30.1)
    axes = {s.candidate.physics: "body.f_x" for s in (*forces, fifth)} | {"torque": "body.tau_y" if at_body else "arm"}
    shares = lambda look, _: {"body.f_x": 0.0, "body.tau_y": 0.0, "arm": 0.0} | {axes[look.candidate.physics]: 0.2}  # noqa: E731
    sizes = SimpleNamespace(names=["body.f_x", "body.tau_y", "arm"], shares=shares)
    found = chosen(screen(*forces, fifth, turning), sizes)
    assert found == [*forces, turning]


def test_residuals_that_are_not_white_widen_what_cannot_be_told_apart_and_count_against_what_leaves_them():
    clean, coloured_ones = (replace(screened("p", "x", 9.0), inflation=f) for f in (2.0, 4.0))
    best, other, poor = ("best", coloured_ones, 780.0, (2, 1)), ("other", clean, 772.0, (3, 2)), ("poor", clean, 700.0, (3, 1))
    assert as_good([best, other, poor])[0] == "other"  # 12 nats are none here; worth 386 against 195
    assert as_good([best, ("other", coloured_ones, 772.0, (3, 2)), poor])[0] == "best"
    assert as_good([best, ("unscored", None, 772.0, (0, 1)), poor])[0] == "unscored"


@pytest.mark.parametrize(("estimate", "out"), [(0.5, False), (-0.7, False), (-0.9, True), (4.5, True)])
def test_a_strength_that_no_part_can_have_explains_nothing(estimate, out):
    gain = Candidate(
        place="sensor:x", family="sensor", physics="sensor_gain", strengths=("g",), without={"g": 1.0}, start={"g": (1.0, 0.2, 5.0)}
    )
    s = replace(screened("p", "x", 9.0), estimate=np.array([estimate]))
    assert beyond(replace(s, look=replace(s.look, candidate=gain))) is out
    assert not beyond(s)  # nothing is said of its limits


@pytest.mark.parametrize(("estimate", "out"), [([0.2, -0.2], False), ([0.2, -0.3], True)])
def test_of_two_quadratures_the_amplitude_is_what_has_a_limit(estimate, out):
    s = screened("sensor:q", "eccentricity", 50.0, size=2)
    disk = replace(s.candidate, strengths=("disk.amplitude",), quadrature="disk.phase", start={"disk.amplitude": (0.0, -0.3, 0.3)})
    assert beyond(replace(s, look=replace(s.look, candidate=disk), estimate=np.array(estimate))) is out


@pytest.mark.parametrize(
    ("physics", "share", "is_something"),
    [("sensor_gain", -0.02, True), ("sensor_misalignment", 0.005, False), ("sensor_bias", 0.005, True)],
)
def test_a_share_of_a_reading_below_the_floor_is_nothing_that_matters(physics, share, is_something):
    s = replace(screened("sensor:x", physics, 20.0), estimate=np.array([share]))
    sizes = Sizes.__new__(Sizes)  # of sensors no force is asked
    assert matters(replace(s, look=replace(s.look, candidate=replace(s.candidate, family="sensor"))), sizes) is is_something


def wrong(change: float, inflation: float = 1.0) -> Screened:
    """A time constant of .06 that would be off by a share of that, with next to no force."""
    s = screened("rotor", "wrong_parameter", 20.0)
    c = replace(s.candidate, family="parameter", strengths=("rotor.tau",), start={"rotor.tau": (0.06, 0.0, 1.0)})
    return replace(s, look=replace(s.look, candidate=c), estimate=np.array([0.06 * change]), inflation=inflation)


@pytest.mark.parametrize(
    ("change", "inflation", "is_fitted"),
    [(-2.0 * WRONG, 1.0, True), (2.0 * WRONG, 1.0, True), (0.5 * WRONG, 1.0, False), (2.0 * WRONG, 100.0, False)],
)
def test_a_parameter_is_doubted_by_how_far_off_it_is_where_its_force_is_small(change, inflation, is_fitted):
    """But for what noise of that size makes of its gain."""
    s = wrong(change, inflation)
    sizes = SimpleNamespace(names=["rotor"], shares=lambda *_: {"rotor": 0.004})
    assert chosen(screen(s), sizes) == ([s] if is_fitted else [])
    assert amiss(s.candidate, s.estimate.tolist()) is (abs(change) > WRONG)


@pytest.mark.parametrize(("friction", "told"), [(0.0, False), (20.0, True)])
def test_prediction_errors_tell_what_is_left_out_and_nothing_where_nothing_is(friction, told):
    assert coloured(smooth(posed(run(2.0, 2e-3, f_c=friction), W={"carriage": 0.05}))) is told


@pytest.mark.parametrize(("minus", "physics"), [(19.5, "coulomb_friction"), (18.7, "coulomb_friction"), (14.0, "asymmetric_friction")])
def test_friction_is_called_asymmetric_where_its_directions_surely_differ_by_what_matters(minus, physics):
    named = {"f_plus": "law.f_plus", "f_minus": "law.f_minus"}
    c = Candidate(place="carriage", family="friction", physics="asymmetric_friction", strengths=tuple(named.values()), named=named)
    levels = {"f_plus": Strength(value=20.0, std=0.3, unit="N"), "f_minus": Strength(value=minus, std=0.4, unit="N")}
    e = Explanation(place="carriage", family="friction", physics="asymmetric_friction", parameters=levels)
    r = 0.5
    result = SimpleNamespace(covariance=lambda _: np.array([[0.09, r * 0.12], [r * 0.12, 0.16]]))
    found = evened(e, c, result, force=50.0)  # one percent of which are 0.5 N
    assert found.physics == physics
    if physics == "coulomb_friction":
        rng = np.random.default_rng(0)
        drawn = rng.multivariate_normal([20.0, minus], [[0.09, r * 0.12], [r * 0.12, 0.16]], size=200_000).mean(axis=1)
        assert found.parameters["f_c"].value == pytest.approx(drawn.mean(), abs=5e-3)
        assert found.parameters["f_c"].std == pytest.approx(drawn.std(), rel=0.01)


@pytest.mark.parametrize(("static", "is_one"), [(30.0, True), (4.0, False)])
def test_friction_that_is_least_at_rest_is_no_stribeck_friction(static, is_one):
    problem = posed(run(0.5))
    (spot,) = bodies(problem.model)
    law = next(law for law in AGAINST_GROUND if law.physics == "stribeck_friction")
    c = of_law(law, problem.model, spot, Motion(v_rms=0.1, low=-0.05, high=0.05))
    values = {"f_c": 10.0, "f_s": static, "v_s": 0.02}
    told = {c.named[w]: SimpleNamespace(name=c.named[w], value=v, std=v / 100, unit="N") for w, v in values.items()}
    assert sound(c, Fitted(candidate=c, result=SimpleNamespace(parameters=told))) is is_one


@pytest.mark.parametrize(
    ("b", "std", "force", "physics"),
    [
        (0.0, None, 1.0, "coulomb_friction"),
        (0.0, None, 0.0, "coulomb_friction"),
        (0.3, 0.1, 1.0, "logarithmic_friction"),
        (0.01, 0.04, 1.0, "logarithmic_friction"),  # 0.09 N m and more is not known to be nothing
        (0.01, 0.04, 100.0, "coulomb_friction"),
    ],
)
def test_a_logarithm_that_nothing_is_left_of_is_coulomb_friction(b, std, force, physics):
    parameters = {"b": Strength(value=b, std=std, unit="N.m"), "c": Strength(value=0.23, std=0.02, unit="N.m")}
    e = Explanation(place="joint", family="friction", physics="logarithmic_friction", parameters=parameters)
    found = evened(e, Candidate(place="joint", family="friction", physics="logarithmic_friction"), SimpleNamespace(), force=force)
    assert found.physics == physics
    assert found.parameters.get("tau_c", found.parameters.get("c")).value == 0.23


@pytest.mark.parametrize(("friction", "family", "told"), [(0.0, "sensor", True), (20.0, "sensor", False), (20.0, "friction", True)])
def test_a_sensor_explains_no_motion_while_its_errors_are_coloured(friction, family, told):
    """The friction of 20 N is in no model: what a sensor was found to do does not stand for it."""
    result = smooth(posed(run(2.0, 2e-3, f_c=friction), W={"carriage": 0.05}))
    c = Candidate(place="sensor:x", family=family, physics="sensor_delay", strengths=("carriage.m",))
    assert result.parameters["carriage.m"].std
    assert explaining(c, None, Fitted(candidate=c, result=result, gain=100.0)) is told


def test_evidence_counts_for_what_it_is_worth_beside_residuals_that_are_not_white():
    white = screened("carriage", "coulomb_friction", 50.0)

    def fit(gain: float, doubt: float = 0.0) -> Fitted:
        return Fitted(candidate=white.candidate, gain=gain * CLEAR, doubt=doubt * CLEAR)

    assert clear(white, fit(1.1))
    assert not clear(replace(white, inflation=4.0), fit(3.9))
    assert clear(replace(white, inflation=4.0), fit(4.1))
    # what has no score is judged by its fit alone
    assert clear(None, fit(1.1))
    assert not clear(None, fit(0.9))
    assert not clear(None, fit(3.9, doubt=2.0))
    assert clear(None, fit(4.1, doubt=2.0))


@pytest.mark.parametrize(("std", "of_coupling", "of_strength"), [(0.2, True, True), (0.4, True, False), (0.6, False, False)])
def test_of_a_coupling_evidence_tells_more_than_its_numbers(std, of_coupling, of_strength):
    told = {"string_2.k": SimpleNamespace(name="string_2.k", value=1.0, std=std, unit="N.m/rad")}
    for dear, is_one in ((True, of_coupling), (False, of_strength)):
        c = Candidate(place="string", family="transmission", physics="compliance", start={"string_2.k": (2.0, 0.1, 10.0)}, dear=dear)
        assert sound(c, Fitted(candidate=c, result=SimpleNamespace(parameters=told))) is is_one


def test_play_is_told_by_its_gap_and_a_level_that_waves_by_its_waves():
    """Not by the largest number that comes with it."""

    def told(**numbers: tuple[float, float]) -> SimpleNamespace:
        parameters = {n: SimpleNamespace(name=n, value=v, std=s, on_bound=False, unit=n) for n, (v, s) in numbers.items()}
        return SimpleNamespace(parameters=parameters)

    start, words = {"gap": (1e-3, 0.0, 1.0), "k": (1e6, 1.0, 1e9)}, {"gap": "gap", "k": "k"}
    edits = (Rebuild(edit=lambda model: model, said="play"),)
    play = Candidate(place="screw", family="transmission", physics="backlash", edits=edits, start=start, named=words, dear=True)
    for std, is_one in ((1e-4, True), (9e-4, False)):
        assert sound(play, Fitted(candidate=play, result=told(gap=(1e-3, std), k=(1e6, 1e5)))) is is_one
    insert = Insert(place="carriage.flange", component=PositionDependentFriction(amplitude=1.0), name="w")
    law = {"place": "carriage", "family": "friction", "physics": "position_dependent_friction", "ratio": "w.amplitude"}
    wave = Candidate(**law, edits=(insert,), strengths=("w.f_c",))
    for std, is_one in ((0.1, True), (0.4, False)):
        result = told(**{"w.f_c": (20.0, 0.1), "w.amplitude": (0.8, std)})
        assert sound(wave, Fitted(candidate=wave, result=result)) is is_one
    bent = {"sigma_0": (10.0, 0.1, np.inf), "f_c": (20.0, 0.1, np.inf)}
    preslides = Candidate(place="carriage", family="friction", physics="presliding_friction", edits=edits, start=bent)
    for std, is_one in ((2.0, True), (5.0, False)):
        assert sound(preslides, Fitted(candidate=preslides, result=told(sigma_0=(10.0, std), f_c=(20.0, 0.1)))) is is_one


@pytest.mark.parametrize(
    ("word", "value", "on_bound", "out"),
    [
        ("width", 0.002, True, True),
        ("width", 0.002, False, False),
        ("width", 9.0, True, False),
        ("limit", 9.0, True, True),
        ("limit", 0.002, True, False),
    ],
)
def test_a_fault_that_ended_where_it_does_next_to_nothing_is_idle(word, value, on_bound, out):
    path = f"fault.{word}"
    signal = Signal(of=("input:F",), changed=np.add, start={path: 1.0})
    c = Candidate(place="input:F", family="actuator", physics="x", start={path: (1.0, 0.002, 9.0)}, named={word: path}, signals=(signal,))
    result = SimpleNamespace(parameters={path: SimpleNamespace(name=path, value=value, on_bound=on_bound, std=None)})
    assert idle(c, result) is out


def test_where_a_plain_law_falls_short_of_its_score_the_law_that_it_stood_for_is_fitted(monkeypatch):
    monkeypatch.setattr("backsight.estimation.diagnosis.search.choice.matters", lambda *_: True)
    drag, stribeck = screened("axis", "quadratic_drag", 160.0), screened("axis", "stribeck_friction", 154.0, size=2)
    elsewhere, little = screened("table", "stribeck_friction", 155.0, size=2), screened("axis", "logarithmic_friction", 60.0, size=2)
    found = screen(drag, elsewhere, stribeck, little)

    def fit(gained: float) -> tuple:
        return drag.candidate, drag, SimpleNamespace(gain=gained, late=False)

    assert stood_for(found, None, [fit(150.0)]) == []
    assert stood_for(found, None, [fit(42.0)]) == [stribeck]
    assert stood_for(found, None, [fit(-np.inf)]) == [stribeck]
    both = [fit(42.0), (stribeck.candidate, stribeck, SimpleNamespace(gain=900.0, late=False))]
    assert stood_for(found, None, both) == []


def test_where_a_fit_falls_short_of_its_score_all_that_it_stood_for_are_fitted(monkeypatch):
    """An inductance that is wrong and an offset of the voltage may do the same to what is left over, and one of them cannot be."""
    monkeypatch.setattr("backsight.estimation.diagnosis.search.choice.matters", lambda *_: True)
    wrong, offset, lag = (
        screened("motor", "wrong_parameter", 160.0),
        screened("input:V", "input_offset", 159.0),
        screened("axis", "lag", 159.0),
    )
    alike = {id(wrong), id(offset)}
    monkeypatch.setattr(Screen, "alike", lambda _, a, b: 1.0 if {id(a), id(b)} <= alike else 0.0)
    found = screen(wrong, offset, lag)
    for gained, fitted in ((150.0, []), (-np.inf, [offset])):
        assert stood_for(found, None, [(wrong.candidate, wrong, SimpleNamespace(gain=gained, late=False))]) == fitted


def test_a_law_replaces_another_of_which_it_leaves_nothing():
    coulomb = Candidate(place="axis", family="friction", physics="coulomb_friction", strengths=("c.f_c",), named={"f_c": "c.f_c"})
    named = {"f_c": "s.f_c", "f_s": "s.f_s"}
    stribeck = Candidate(
        place="axis",
        family="friction",
        physics="stribeck_friction",
        strengths=("s.f_c", "s.f_s"),
        named=named,
        absorbs={"c.f_c": "s.f_c s.f_s"},
    )
    level = Candidate(place="axis", family="friction", physics="presliding_friction", named={"f_c": "p.f_c"}, absorbs={"s.f_c": "p.f_c"})
    assert stribeck.replaces(coulomb)
    assert not level.replaces(stribeck)
    assert not level.replaces(Candidate(place="axis", family="inertia", physics="added_mass"))


def test_the_plainest_law_that_may_hold_a_body_is_fitted_before_richer_ones():
    """No output shows the load; what slides where one does is scored as it is."""
    plain, drag, elsewhere = (
        screened("load", "coulomb_friction", 9.0),
        screened("load", "drag", 9.0),
        screened("motor", "stribeck_friction", 9.0),
    )
    peaked, later = screened("load", "stribeck_friction", 9.0, 2), screened("load", "coulomb_friction", 9.0)
    elsewhere, peaked = (with_candidate(s, larger=("f_s", "f_c")) for s in (elsewhere, peaked))
    later = with_candidate(later, edits=(Since(time=1.0, before=()),))
    assert plainest_first([peaked, plain, later, drag, elsewhere], {"load"}) == ([plain, drag, elsewhere], [peaked, later])


def with_candidate(s: Screened, **changes: object) -> Screened:
    return replace(s, look=replace(s.look, candidate=replace(s.look.candidate, **changes)))


@pytest.mark.parametrize(
    ("given", "found", "last"),
    [(0.3, 0.65, True), (0.65, 0.3, True), (0.3, 0.5, False), (0.5, 0.3, False), (-0.3, -0.1, True), (0.3, -0.3, True), (0.0, 5.0, False)],
)
def test_a_number_that_would_be_off_by_a_factor_of_two_is_named_last(given, found, last):
    """Of one that is said to be nothing nobody can say by how much it is off."""
    start = {"tyre.r": (given, -np.inf, np.inf)}
    wrong = Candidate(place="tyre", family="parameter", physics="wrong_parameter", strengths=("tyre.r",), start=start)
    friction = Candidate(place="tyre", family="friction", physics="coulomb_friction", strengths=("tyre.r",), start=start)
    told = plainness(wrong, [found - given])
    assert told[0] == last
    assert told[1:] == plainness(wrong, [0.0])[1:]
    assert (told > plainness(friction, [found - given])) is last


@pytest.mark.parametrize(("correlation", "gone"), [(0.0, 2), (-0.9999, 1)])
def test_of_two_that_stand_for_each_other_one_can_go(correlation, gone):
    """An offset of an input and a constant force: either is nothing beside the other, and both are not."""
    std, size = 10.0, 5.0
    told = {n: SimpleNamespace(name=n, value=size, std=std, on_bound=False, unit="N") for n in ("input.bias", "force.f")}
    C = std**2 * np.array([[1.0, correlation], [correlation, 1.0]])
    names = [*told]

    def covariance(asked: list) -> np.ndarray:
        at = [names.index(n) for n in asked]
        return C[np.ix_(at, at)]

    result = SimpleNamespace(parameters=told, criteria=SimpleNamespace(samples=1000), covariance=covariance)
    both = [Candidate(place="x", family="external", physics=n, strengths=(n,)) for n in names]
    count, nats = spared(both, result)
    assert count == gone
    assert nats == pytest.approx(gone * (0.5 * np.log(1000) - 0.5 * (size / std) ** 2))

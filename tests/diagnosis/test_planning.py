"""What to measure next: clips that SciPy makes, and the statistics of what the plan predicts."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from iris_sysid import (
    EFFECTS,
    MODELS,
    FitError,
    Quantity,
    SetUpChange,
    Trajectory,
    decide,
    diagnose,
    fit,
    plan,
    with_effects,
)
from iris_sysid.diagnosis.planning.changes import REPEAT, changes_for
from iris_sysid.diagnosis.planning.detection_limit import detection_limits
from iris_sysid.diagnosis.planning.plan import Plan, _Study
from iris_sysid.diagnosis.planning.predicted_clip import Design, predicted_clip, roles
from iris_sysid.diagnosis.planning.rivals import Question, Rival, rivals_of
from iris_sysid.report.plan_text import decision_text

PENDULUM = MODELS["pendulum"]
NOISE_RAD = 1e-3
DRAG = 0.15  # 1/rad
QUESTION = Question(PENDULUM, ("quadratic-drag", "coulomb-friction"))


def swing(
    release_rad: float, seconds: float = 5.0, seed: int = 0, drag: float = DRAG, shift: float = 0.0
) -> Trajectory:
    """A pendulum of 0.5 m with quadratic drag, seen with a wrong zero."""
    t_s = np.arange(round(60 * seconds)) / 60

    def rates(t, y):
        return y[1], -9.80665 / 0.5 * np.sin(y[0]) - 0.05 * y[1] - drag * abs(y[1]) * y[1]

    solved = solve_ivp(rates, (0, t_s[-1]), (release_rad, 0.0), "DOP853", t_s, rtol=1e-9, atol=1e-11)
    theta = shift + solved.y[:1].T + NOISE_RAD * np.random.default_rng(seed).standard_normal((t_s.size, 1))
    return Trajectory(
        t_s, (Quantity("theta", "rad"),), theta, np.full_like(theta, np.nan), np.ones(t_s.size, dtype=bool)
    )


@pytest.fixture(scope="module")
def small() -> Trajectory:
    return swing(0.15)


@pytest.fixture(scope="module")
def rivals(small: Trajectory) -> tuple[Rival, ...]:
    return rivals_of(QUESTION, [small])


@pytest.fixture(scope="module")
def planned(small: Trajectory) -> Plan:
    return plan(QUESTION, small)


def named(rivals: tuple[Rival, ...], name: str) -> Rival:
    return next(rival for rival in rivals if rival.name == name)


def test_small_swing_leaves_both_names_open(planned):
    assert min(planned.probabilities.values()) > 0.05


def test_plan_on_a_diagnosis_has_the_probabilities_of_that_diagnosis(small):
    found = diagnose(small, "pendulum", effects=["quadratic-drag", "coulomb-friction"])
    (named,) = (effect.name for effect in found.added)
    (other,) = {"quadratic-drag", "coulomb-friction"} - {named}
    for share in (0.8, 1e-9):
        stated = {named: share, other: 1.0 - share}
        diagnosis = replace(found, probabilities={named: stated}, indistinguishable={named: (other,)})
        assert plan(diagnosis, small).probabilities == pytest.approx(stated)


def test_error_without_variance_is_left_out_of_the_gain_and_warns_of_nothing(planned, rivals, small):
    proposal = replace(planned.repeat, stderr={"length": 0.0, "damping": planned.stderr["damping"] / 2})
    assert _Study(QUESTION, rivals, small)._remaining(proposal) == pytest.approx(0.5, rel=0.2)


def test_larger_swing_is_advised_and_repeat_is_not(planned):
    by_name = {proposal.change.name: proposal.power for proposal in planned.proposals}
    assert by_name["release75"] > 0.95
    assert planned.repeat.power < 0.5
    assert planned.best.power >= by_name["release75"]


def test_advised_clip_leaves_the_true_name(planned, small):
    change = next(each.change for each in planned.proposals if each.change.name == "release75")
    left = decide(QUESTION, small, swing(np.radians(75), seed=1), change)
    assert left.names == ("quadratic-drag",)
    assert left.probabilities["quadratic-drag"] > 0.99
    assert left.described


def test_clip_that_no_name_describes_is_not_said_to_decide(planned, small):
    change = next(each.change for each in planned.proposals if each.change.name == "release75")
    new = swing(np.radians(75), seed=1)
    pushed = new.with_(position=new.position + 0.1 * np.sin(3.0 * new.t_s)[:, None])
    decision = decide(QUESTION, small, pushed, change)
    assert not decision.described
    assert "the right one may not be among them" in decision_text(decision)


def test_cost_of_a_change_moves_it_down(small, planned):
    dear = plan(QUESTION, small, costs={planned.best.change.name: 100.0})
    assert dear.best.change.name != planned.best.change.name


def test_second_clip_shrinks_the_error_of_what_both_share(planned):
    assert 0.3 < planned.repeat.stderr["length"] / planned.stderr["length"] < 0.75  # 0.71 where nothing else is shared


def test_chi_square_of_drawn_clips_has_as_many_degrees_as_samples_less_new_values(rivals, small):
    rival = named(rivals, "quadratic-drag")
    clip = predicted_clip(rival, Design.of(REPEAT, rivals[0], PENDULUM, small))
    misfits = clip.misfit(clip.drawn(np.random.default_rng(0), 400))
    degrees = clip.centre.size - len(clip.roles.new)
    assert np.mean(misfits) == pytest.approx(degrees, abs=4 * np.sqrt(2 * degrees / 400))


def test_whitening_makes_autocorrelated_noise_white(rivals, small):
    design = Design.of(REPEAT, rivals[0], PENDULUM, small)
    rng, rho = np.random.default_rng(0), 0.6
    series = [rng.standard_normal()]
    for step in rng.standard_normal(20_000):
        series.append(rho * series[-1] + np.sqrt(1 - rho**2) * step)
    noise = np.array([0.2])
    whitened = Design(REPEAT, PENDULUM, design.t_s, noise, rho, None, None, "linear").whitened(
        0.2 * np.array(series)[:, None]
    )
    assert np.std(whitened) == pytest.approx(1.0, abs=0.03)
    assert np.corrcoef(whitened[1:], whitened[:-1])[0, 1] == pytest.approx(0.0, abs=0.03)


def test_heavier_ball_has_less_drag_and_another_damping(rivals):
    rival = named(rivals, "quadratic-drag")
    part = roles(rival, SetUpChange("ball", "", body={"mass": 4.0, "radius": 1.0}), PENDULUM, known_view=False)
    assert part.values["quadratic_drag"] == pytest.approx(rival.values["quadratic_drag"] / 4)
    assert part.factors["quadratic_drag"] == 0.25
    assert "damping" in part.new
    assert "length" in part.shared


def test_size_of_unknown_scaling_is_free_with_another_ball(rivals):
    part = roles(named(rivals, "coulomb-friction"), SetUpChange("ball", "", body={"mass": 4.0}), PENDULUM, False)
    assert "coulomb_friction" in part.new


def test_accident_does_not_happen_again():
    clip = swing(0.3, drag=0.0)
    kicked = clip.with_(position=clip.position + 0.02 * np.maximum(clip.t_s - 2.0, 0.0)[:, None])
    (rival,) = rivals_of(Question(PENDULUM, ("impact",)), [kicked])
    assert roles(rival, REPEAT, PENDULUM, False).effects == ()


def test_board_in_the_plane_removes_a_tilt():
    (rival,) = rivals_of(Question(PENDULUM, ("camera-tilt",)), [swing(0.9, drag=0.0)])
    board = next(
        change
        for change in changes_for(PENDULUM, {"theta_0": 0.9, "omega_0": 0.0}, [EFFECTS["camera-tilt"]])
        if change.name == "board"
    )
    assert roles(rival, board, PENDULUM, False).effects == ()


def on_a_spring(stiffness: float, force: float, zero: float, seed: int) -> Trajectory:
    """A body on a linear spring under a constant force per mass, in m/s^2, seen with a wrong zero, in m."""
    t_s = np.arange(480) / 60

    def rates(t, y):
        return y[1], force - stiffness * y[0] - 0.05 * y[1]

    z = solve_ivp(rates, (0, t_s[-1]), (0.2, 0.0), "DOP853", t_s, rtol=1e-9, atol=1e-11).y[:1].T
    z = z + zero + 1e-3 * np.random.default_rng(seed).standard_normal(z.shape)
    return Trajectory(t_s, (Quantity("z", "m"),), z, np.full_like(z, np.nan), np.ones(t_s.size, dtype=bool))


@pytest.mark.parametrize(("force", "zero", "name"), [(0.2, 0.0, "constant-force"), (0.0, 0.01, "zero-offset")])
def test_stiffer_springs_tell_a_force_from_a_wrong_zero_and_another_start_does_not(force, zero, name):
    today = on_a_spring(20.0, force, zero, seed=1)
    question = Question(MODELS["linear-oscillator"], ("constant-force", "zero-offset"))
    planned = plan(question, today)
    by_name = {proposal.change.name: proposal.power for proposal in planned.proposals}
    assert by_name["spring"] > 0.95
    assert by_name["start--1"] < 0.05
    change = planned.named("spring").change
    assert decide(question, today, on_a_spring(40.0, force, zero, seed=2), change).names == (name,)


def test_plumb_line_removes_a_wrong_zero_of_an_angle_and_nothing_else():
    question = Question(PENDULUM, ("zero-offset", "constant-force"))
    planned = plan(question, swing(0.15, drag=0.0, shift=0.01))
    by_name = {proposal.change.name: proposal.power for proposal in planned.proposals}
    assert by_name["plumb-line"] > 0.95
    assert by_name["repeat"] < 0.1


def test_driven_motion_is_driven_otherwise():
    driven = replace(PENDULUM, inputs=(Quantity("u", "1"),))
    changes = changes_for(driven, {"theta_0": 0.3, "omega_0": 0.0}, [])
    assert {change.driven for change in changes} == {1.0, 0.5, 2.0}
    rival = rivals_of(Question(PENDULUM, ()), [swing(0.3)])[0]
    clip = swing(0.3).with_(inputs=np.ones((300, 1)), input_quantities=(Quantity("u", "1"),))
    twice = next(change for change in changes if change.driven == 2.0)
    assert np.all(Design.of(twice, rival, PENDULUM, clip).inputs == 2.0)


def test_two_releases_are_no_pair():
    first, second = (SetUpChange(f"release{k}", "", start={"theta_0": k}) for k in (1.0, 0.5))
    assert first.joined(second) is None
    both = first.joined(SetUpChange("long", "", longer=3.0))
    assert both is not None
    assert (both.longer, both.start) == (3.0, {"theta_0": 1.0})


def test_nothing_to_decide_with_one_name(small):
    with pytest.raises(FitError, match="nothing to decide"):
        decide(Question(PENDULUM, ("quadratic-drag",)), small, small)


def test_unfittable_model_is_refused(small):
    with pytest.raises(FitError, match="observes"):
        plan(Question(MODELS["free-fall"], ("linear-drag",)), small)


def test_plan_without_names_is_about_precision(small):
    precise = plan(Question(PENDULUM, ()), small)
    assert np.isnan(precise.best.power)
    assert precise.best.stderr["length"] < 0.5 * precise.stderr["length"]


def test_detection_limit_is_the_size_at_which_the_estimate_is_that_far_from_zero():
    """Against a fit of SciPy's clip: 3.2 standard errors are significant at 4 % over 26 effects."""
    values = {"length": 0.5, "damping": 0.05, "omega_0": 0.0}
    spans = {"noise": NOISE_RAD, "rate_hz": 60.0, "starts": [0.8], "seconds": [5.0]}
    found = detection_limits("pendulum", "constant-force", values, **spans)
    fitted = fit(swing(0.8, drag=0.0), with_effects("pendulum", ["constant-force"]))
    assert found.sizes[0, 0] / fitted.estimates["constant_force"].stderr == pytest.approx(3.2, rel=0.15)


def test_effect_that_the_fitted_values_imitate_has_no_limit():
    values = {"length": 0.5, "damping": 0.05, "omega_0": 0.0}
    spans = {"noise": NOISE_RAD, "rate_hz": 60.0, "starts": [0.8], "seconds": [5.0]}
    assert np.isinf(detection_limits("pendulum", "time-scale", values, **spans).sizes).all()


@pytest.mark.parametrize("name", [name for name in MODELS if MODELS[name].example is not None])
def test_changes_of_every_model_start_from_its_own_states(name):
    model = MODELS[name]
    start = {state: model.example.values.get(state, 0.5) for state in model.initial_names}
    changes = changes_for(model, start, [])
    assert changes[0] is REPEAT
    assert all(change.start.keys() <= start.keys() for change in changes)
    assert len({change.name for change in changes}) == len(changes)


def test_long_clip_is_thinned_and_tells_as_much():
    """The error of a mean: sigma / sqrt(n), whatever the number of samples that stand for the clip."""
    (rival,) = rivals_of(Question(PENDULUM, ()), [swing(0.5, seconds=100.0, drag=0.0)])
    clip = swing(0.5, seconds=100.0, drag=0.0)
    design = Design.of(REPEAT, rival, PENDULUM, clip)
    assert design.t_s.size <= 4000
    assert design.noise[0] / np.sqrt(design.t_s.size) == pytest.approx(rival.fitted.rms[0] / np.sqrt(6000), rel=0.05)


def test_drag_that_does_not_go_with_the_mass_is_not_drag():
    """With a ball four times as heavy, drag is a quarter; friction may be anything."""
    today, heavy = swing(0.4), SetUpChange("heavy", "", body={"mass": 4.0, "radius": 1.0})
    quarter, same = (
        decide(QUESTION, today, swing(0.4, seed=2, drag=drag), heavy).probabilities["quadratic-drag"]
        for drag in (DRAG / 4, DRAG)
    )
    assert quarter > 0.9
    assert same < 0.1

"""Discovery: the right terms and no others on exact motions with noise, its name in the bank, refusal of bad input."""

from dataclasses import replace

import numpy as np
import pysindy
import pytest
from scipy.integrate import solve_ivp
from scipy.linalg import expm
from scipy.optimize import curve_fit

from fitters.ode import simulate
from fitters.sindy import discover
from fitters.sindy.library import library_of
from fitters.sindy.model import model_of
from fitters.sindy.model_matching import structures
from fitters.sindy.sparse_regression import Compressed, proposed, significant, term_price
from fitters.sindy.weak_form import Rows, grid_step, pieces_of, rows_of
from iris_sysid.errors import DataError, FitError
from iris_sysid.registry import MODELS
from iris_sysid.report.figures import fitted_curve
from iris_sysid.report.text import discovery_sentence
from iris_sysid.types import Estimate, Quantity, Segment, Trajectory
from tests import _real_data as real
from validation.discovery import MOTIONS, drawn

THETA, Z = Quantity("theta", "rad", r"\theta"), Quantity("z", "m", "z")
PENDULUM = {"length": 0.5, "damping": 0.05, "theta_0": 1.0, "omega_0": 0.0}


def seen(t_s, values, *quantities, noise=1e-3, seed=0, valid=None, **more):
    """A trajectory with white noise."""
    values = np.asarray(values, float).reshape(len(t_s), -1)
    values = values + noise * np.random.default_rng(seed).standard_normal(values.shape)
    valid = np.ones(len(t_s), bool) if valid is None else valid
    return Trajectory(
        t_s, quantities, np.where(valid[:, None], values, np.nan), np.full_like(values, np.nan), valid, **more
    )


def motion(name, values, duration_s, fps=60.0, **more):
    """A motion of a model of the bank."""
    model, t_s = MODELS[name], np.arange(int(duration_s * fps)) / fps
    return seen(t_s, simulate(model, t_s, values).observed, *model.observed, **more)


def selected(discovery):
    return {term.parameter for term in discovery.selected}


# --------------------------------------------------------------------------- structure and name


def test_pendulum_is_found_named_and_measured():
    discovery = discover(motion("pendulum", PENDULUM, 8.0))
    assert selected(discovery) == {"theta_sin", "theta_rate"}
    assert discovery.matched.model == "pendulum"
    length, damping = discovery.matched.parameters["length"], discovery.matched.parameters["damping"]
    assert abs(length.value - 0.5) < min(4 * length.stderr, 0.005)
    assert abs(damping.value - 0.05) < 4 * damping.stderr
    assert discovery_sentence(discovery).startswith("This is the pendulum with length = 0.")
    assert discovery.equations[0].latex.startswith(r"\ddot {\theta} = - 19.6")
    assert all(term.inclusion > 0.9 for term in discovery.selected)


def test_gravity_that_is_given_scales_the_length_and_its_error():
    given = {"gravity": Estimate(9.0, 0.09, "m/s^2", "direct")}
    matched = discover(motion("pendulum", PENDULUM, 8.0), known=given, resampled=5).matched
    assert matched.parameters["length"].value == pytest.approx(0.5 * 9.0 / 9.80665, rel=2e-3)
    assert matched.parameters["length"].stderr == pytest.approx(0.01 * matched.parameters["length"].value, rel=0.05)


def test_free_fall_needs_a_constant_and_nothing_else():
    discovery = discover(motion("free-fall", {"gravity": 9.8, "z_0": 2.0, "vz_0": 0.2}, 0.6))
    assert selected(discovery) == {"z_constant"}
    assert discovery.matched.parameters["gravity"].value == pytest.approx(9.8, abs=0.1)


def test_level_that_drains_follows_its_square_root():
    discovery = discover(motion("torricelli", {"outflow": 0.02, "h_0": 0.3}, 20.0, fps=30))
    assert selected(discovery) == {"h_root"}
    assert discovery.matched.parameters["outflow"].value == pytest.approx(0.02, rel=0.01)


def test_rest_position_off_the_origin_is_no_other_model():
    t_s = np.arange(480) / 60
    model = MODELS["linear-oscillator"]
    z = simulate(model, t_s, {"stiffness": 20.0, "damping": 0.2, "z_0": 0.2, "vz_0": 0.0}).observed + 0.05
    matched = discover(seen(t_s, z, Z, noise=3e-4)).matched
    assert matched.model == "linear-oscillator"
    assert matched.parameters["origin_z"].value == pytest.approx(0.05, abs=2e-3)
    assert matched.parameters["stiffness"].value == pytest.approx(20.0, rel=2e-3)


def test_equation_that_the_bank_lacks_is_reported_to_differ_from_the_nearest():
    library = library_of((Z,))
    t_s = np.arange(600) / 60
    values = dict.fromkeys(library.names, 0.0) | {"z_linear": -20.0, "z_drag": -0.8, "z_0": 0.4, "d_z_0": 0.0}
    discovery = discover(seen(t_s, simulate(model_of(library), t_s, values).observed, Z, noise=4e-4))
    assert selected(discovery) == {"z_linear", "z_drag"}
    assert discovery.matched is None
    assert discovery.nearest.model == "linear-oscillator"
    assert discovery.nearest.extra == ("|z'| z' in z''",)
    assert "Not in the bank: the nearest is linear-oscillator" in discovery_sentence(discovery)


def test_damping_that_grows_with_the_swing_is_found_on_a_limit_cycle():
    """The oscillator of van der Pol, integrated by SciPy: a swing that is fed where it is small."""
    t_s = np.arange(1000) / 50
    slopes = lambda t, state: [state[1], 0.8 * (1.0 - state[0] ** 2) * state[1] - state[0]]  # noqa: E731
    x = solve_ivp(slopes, (0.0, 20.0), [1.5, 0.0], "DOP853", t_s, rtol=1e-10, atol=1e-12).y[0]
    discovery = discover(seen(t_s, x, Quantity("x", "m"), noise=5e-3), resampled=5)
    assert selected(discovery) == {"x_linear", "x_rate", "x_square_rate"}
    found = {term.parameter: term.coefficient for term in discovery.selected}
    for name, value in (("x_linear", -1.0), ("x_rate", 0.8), ("x_square_rate", -0.8)):
        assert abs(found[name].value - value) < 4 * found[name].stderr < 0.05
    assert found["x_square_rate"].unit == "1/m^2/s"


def test_known_input_enters_the_equation():
    push = Quantity("u", "V")
    library = library_of((Z,), (push,))
    t_s = np.arange(600) / 60
    u = np.sign(np.sin(1.3 * t_s))[:, None]
    values = dict.fromkeys(library.names, 0.0)
    values |= {"z_linear": -15.0, "z_rate": -0.6, "z_input_u": 2.0, "z_0": 0.1, "d_z_0": 0.0}
    z = simulate(model_of(library), t_s, values, inputs=u).observed
    discovery = discover(seen(t_s, z, Z, noise=3e-4, input_quantities=(push,), inputs=u))
    assert selected(discovery) == {"z_linear", "z_rate", "z_input_u"}
    push_found = next(term for term in discovery.selected if term.term == "u")
    assert push_found.coefficient.value == pytest.approx(2.0, rel=0.01)
    assert push_found.coefficient.unit == "m/s^2/V"


def test_spring_that_a_known_force_pushes_is_the_model_of_the_bank():
    discovery = discover(driven_spring(), resampled=5)
    assert discovery.matched.model == "driven-oscillator"
    for name, true in (("mass", 0.5), ("damping", 0.15), ("stiffness", 2.0)):
        assert discovery.matched.parameters[name].value == pytest.approx(true, rel=0.01)


def driven_spring():
    """A mass of 0.5 kg on a spring of 2 N/m, pushed by a force that is held for half a second, exact between jumps."""
    t_s = np.arange(1200) / 40
    force = np.repeat(np.random.default_rng(1).uniform(-1.0, 1.0, 60), 20)[:, None]
    states = [np.array([0.2, 0.0, 0.0])]
    for push in force[:-1, 0]:
        states[-1][2] = push
        states.append(expm(np.array([[0.0, 1.0, 0.0], [-4.0, -0.3, 2.0], [0.0, 0.0, 0.0]]) / 40) @ states[-1])
    driven = {"input_quantities": (Quantity("u", "N", "u"),), "inputs": force, "hold": "zero-order"}
    return seen(t_s, np.array(states)[:, 0], Z, **driven)


def test_hares_and_lynxes_meet_in_products():
    """Lotka (1925) and Volterra (1926), integrated by SciPy: two numbers without a unit, of first order."""
    t_s, names = np.arange(400) / 10, (Quantity("hare", "", "h"), Quantity("lynx", "", "l"))
    slopes = lambda t, y: [0.6 * y[0] - 0.03 * y[0] * y[1], 0.02 * y[0] * y[1] - 0.8 * y[1]]  # noqa: E731
    numbers = solve_ivp(slopes, (0.0, 40.0), [30.0, 10.0], "DOP853", t_s, rtol=1e-10, atol=1e-10).y.T
    discovery = discover(seen(t_s, numbers, *names, noise=0.2), resampled=5)
    assert selected(discovery) == {"hare_linear", "hare_times_lynx", "lynx_linear", "lynx_times_hare"}
    assert {term.coefficient.unit for term in discovery.selected} == {"1/s"}
    meeting = next(term for term in discovery.selected if term.parameter == "hare_times_lynx")
    assert meeting.coefficient.value == pytest.approx(-0.03, rel=0.01)


def test_hot_body_that_radiates_cools_with_the_fourth_power():
    """Stefan (1879), integrated by SciPy: a coefficient of 1e-11 in SI units is found like any other."""
    t_s = np.arange(0.0, 1800.0, 5.0)
    cooling = solve_ivp(lambda t, y: -1.2e-11 * (y**4 - 293.0**4), (0.0, 1800.0), [900.0], "DOP853", t_s, rtol=1e-10)
    discovery = discover(seen(t_s, cooling.y[0], Quantity("T", "K", "T"), noise=0.5), resampled=20)
    assert selected(discovery) == {"T_constant", "T_fourth"}
    fourth = next(term for term in discovery.selected if term.parameter == "T_fourth")
    assert fourth.coefficient.value == pytest.approx(-1.2e-11, rel=0.005)
    assert fourth.inclusion > 0.9


@pytest.mark.parametrize(
    ("unit", "model"), [("K", "exponential-decay"), ("rad/s", "spin-down"), ("V", "exponential-decay")]
)
def test_cooling_is_no_wheel_that_runs_down(unit, model):
    """The same equation of first order, with a constant: what is measured tells which model of the bank it may be."""
    t_s = np.arange(0.0, 1800.0, 10.0)
    discovery = discover(
        seen(t_s, 22.0 + 60.0 * np.exp(-t_s / 600.0), Quantity("y", unit, "y"), noise=0.05), resampled=5
    )
    assert (discovery.matched.model if discovery.matched else "") == model


def test_position_that_a_sensor_reads_in_volts_has_an_equation_of_second_order():
    drive, reading = Quantity("u", "V"), Quantity("y", "V")
    t_s = np.arange(600) / 60
    u = np.sign(np.sin(1.3 * t_s))[:, None]
    model = MODELS["driven-oscillator"]
    values = {"mass": 0.5, "damping": 0.6, "stiffness": 20.0, "z_0": 0.1, "vz_0": 0.0}
    y = simulate(model, t_s, values, inputs=u, hold="zero-order").observed
    clip = seen(t_s, y, reading, noise=3e-4, input_quantities=(drive,), inputs=u, hold="zero-order")
    discovery = discover(clip, resampled=5)
    assert [equation.lhs for equation in discovery.equations] == ["y''"]
    found = {term.term: term.coefficient for term in discovery.selected}
    assert {name: one.value for name, one in found.items()} == pytest.approx({"y": -40, "y'": -1.2, "u": 2}, rel=0.02)
    assert found["u"].unit == "V/s^2/V"


def test_oscillator_is_found_in_the_recording_of_an_air_track():
    clip = real.schmidt_lipson_linear()
    matched = discover(clip, resampled=20).matched
    assert matched.model == "linear-oscillator"

    def damped_cosine(t_s, amplitude, phase, omega, damping):
        return amplitude * np.exp(-damping * t_s / 2) * np.cos(omega * t_s + phase)

    (*_, omega, damping), _ = curve_fit(damped_cosine, clip.t_s, clip.position[:, 0], [0.1, 3.0, 2.5, 0.01])
    assert matched.parameters["stiffness"].value == pytest.approx(omega**2 + damping**2 / 4, rel=1e-4)
    assert matched.parameters["damping"].value == pytest.approx(damping, rel=0.01)


def test_two_terms_that_imitate_one_with_a_third_are_exchanged_for_it():
    # without that, 1, z1, z1' and z1 - z3 stand for z1' and both differences in this motion
    chain = next(motion for motion in MOTIONS if motion.model == "contact-chain")
    discovery = discover(drawn(chain, 15)[0], resampled=20)
    assert selected(discovery) == set(chain.terms)
    assert discovery.matched.model == "contact-chain"


# --------------------------------------------------------------------------- several clips, gaps, events


def test_clips_of_unequal_length_share_one_equation():
    clips = [
        motion("pendulum", PENDULUM, 6.0, seed=1),
        motion("pendulum", PENDULUM | {"theta_0": 0.5, "omega_0": 1.0}, 3.0, fps=30, seed=2),
    ]
    joint, alone = (discover(data, resampled=10) for data in (clips, clips[1]))
    assert selected(joint) == {"theta_sin", "theta_rate"}
    assert len(joint.fits) == 2
    length, less = joint.matched.parameters["length"], alone.matched.parameters["length"]
    assert abs(length.value - 0.5) < 4 * length.stderr
    assert length.stderr < less.stderr


def test_gap_is_not_bridged_by_any_window():
    clip = motion("pendulum", PENDULUM, 8.0, valid=~((np.arange(480) > 200) & (np.arange(480) < 260)))
    pieces = pieces_of(clip, library_of(clip.quantities))
    assert [(piece.t_s[0], piece.t_s[-1]) for piece in pieces] == [(0.0, 200 / 60), (260 / 60, 479 / 60)]
    assert selected(discover(clip, resampled=5)) == {"theta_sin", "theta_rate"}


def test_first_samples_that_are_outliers_move_nothing_in_time():
    clip = motion("pendulum", PENDULUM, 8.0)
    wild = clip.position.copy()
    wild[:2] += [[0.05], [-0.05]]
    discovery = discover(clip.with_(position=wild), resampled=5)
    assert not discovery.fits[0].used[0]
    assert discovery.fits[0].used.sum() > 470
    assert selected(discovery) == {"theta_sin", "theta_rate"}
    t_s, curve = fitted_curve(discovery.fits[0])
    assert np.interp(1.0, t_s, curve[:, 0]) == pytest.approx(float(clip.position[60, 0]), abs=5e-3)


def test_impact_between_two_motions_is_never_inside_a_window():
    clip = motion("pendulum", PENDULUM, 4.0)
    turned = clip.position.copy()
    turned[120:] = turned[120:] * -0.5
    parts = (Segment("motion", 0, 120), Segment("contact", 120, 124), Segment("motion", 124, 240))
    cut = clip.with_(position=turned, segments=parts)
    pieces = pieces_of(cut, library_of(clip.quantities))
    assert [(round(piece.t_s[0] * 60), round(piece.t_s[-1] * 60)) for piece in pieces] == [(0, 119), (124, 239)]


# --------------------------------------------------------------------------- parts


def test_rows_of_a_motion_without_noise_hold_for_its_equation():
    clip = motion("pendulum", PENDULUM, 60.0, noise=0.0)
    library = library_of(clip.quantities)
    (rows,) = rows_of(pieces_of(clip, library), library)
    truth = np.zeros(len(library.terms))
    truth[library.names.index("theta_sin")], truth[library.names.index("theta_rate")] = -9.80665 / 0.5, -0.05
    assert np.std(rows.left - rows.right @ truth) < 1e-4 * np.std(rows.left)


def test_choice_agrees_with_pysindy_where_terms_are_unlike():
    rng = np.random.default_rng(3)
    columns = rng.standard_normal((200, 6))
    target = columns[:, [1, 4]] @ [2.0, -3.0] + rng.standard_normal(200)
    problem = Compressed.of(columns, target)
    assert significant(problem, term_price(problem)) == (1, 4)
    assert list(proposed(Rows(target, columns))[2]) == [1, 4]
    theirs = pysindy.STLSQ(threshold=1.0, alpha=0.0).fit(columns, target[:, None]).coef_[0]
    assert problem.solved((1, 4))[0] == pytest.approx(theirs[[1, 4]], rel=1e-9)


def test_compressed_rows_leave_the_same_sums_of_squares():
    rng = np.random.default_rng(5)
    columns, target = rng.standard_normal((50, 5)), rng.standard_normal(50)
    problem = Compressed.of(columns, target)

    def left(kept):
        solved = np.linalg.lstsq(columns[:, kept], target, rcond=None)[0]
        return np.sum((target - columns[:, kept] @ solved) ** 2)

    residual, gains = problem.gains((0, 3))
    assert residual == pytest.approx(left([0, 3]))
    assert residual - gains[2] == pytest.approx(left([0, 3, 2]))
    assert problem.without(3).residual((1,)) == pytest.approx(left([1, 3, 4]))


def test_grid_that_samples_lie_on_is_seen_and_noise_lies_on_none():
    values = 0.1 * np.cos(np.arange(300) / 20)
    assert grid_step(np.round(values, 3)) == pytest.approx(1e-3)
    assert grid_step(values) == 0.0
    assert grid_step(np.full(20, 0.3)) == 0.0


def test_term_that_does_less_than_the_rounding_of_the_samples_is_not_seen():
    t_s, model = np.arange(900) / 30, MODELS["linear-oscillator"]
    z = simulate(model, t_s, {"stiffness": 6.2, "damping": 0.014, "z_0": 0.1, "vz_0": 0.0}).observed
    bent = z / (1 - 0.04 * z) - 4e-4 * z / 0.1 * (z / 0.1) ** 2  # a camera that looks askance through a lens
    fine, whole_mm = seen(t_s, bent, Z, noise=3e-4), seen(t_s, np.round(bent, 3), Z, noise=0.0)
    assert selected(discover(fine, resampled=5)) != {"z_linear", "z_rate"}
    assert selected(discover(whole_mm, resampled=5)) == {"z_linear", "z_rate"}


@pytest.mark.parametrize(
    ("name", "always", "sometimes"),
    [
        ("pendulum", {"sin(theta)"}, {"theta'"}),
        ("linear-oscillator", {"z"}, {"z'"}),
        ("torricelli", {"sqrt(h)"}, set()),
        ("apparent-radius", {"1"}, set()),
        ("exponential-decay", {"intensity"}, {"1"}),
    ],
)
def test_structure_of_a_bank_model_comes_from_its_right_hand_side(name, always, sometimes):
    library = library_of(MODELS[name].observed)
    structure = next(candidate for candidate in structures(library) if candidate.model.name == name)
    texts = {(term.equation, term.code, term.other): term.text for term in library.terms}
    assert {texts[key] for key in structure.always} == always
    assert {texts[key] for key in structure.sometimes - structure.always} == sometimes


def test_programmed_equation_moves_like_the_bank_s():
    library, t_s = library_of((THETA,)), np.arange(100) / 30
    coefficients = dict.fromkeys(library.names, 0.0) | {"theta_sin": -9.80665 / 0.5, "theta_rate": -0.05}
    ours = simulate(model_of(library), t_s, coefficients | {"theta_0": 1.0, "d_theta_0": 0.0}).observed
    assert ours == pytest.approx(simulate(MODELS["pendulum"], t_s, PENDULUM).observed, abs=1e-8)


@pytest.mark.parametrize("change", [{"inclusion": 0.1}, {"coefficient": Estimate(0.1, 0.1, "1/s", ci95=(-0.1, 0.3))}])
def test_term_that_the_data_hardly_call_for_is_doubted(change):
    found = discover(motion("pendulum", PENDULUM, 8.0), resampled=5)
    assert found.verdict.good
    weak = [replace(term, **change) if term.parameter == "theta_rate" else term for term in found.terms]
    verdict = replace(found, terms=tuple(weak)).verdict
    assert verdict.word == "doubtful"
    assert "theta'" in verdict.text


def test_same_seed_gives_the_same_inclusion():
    clip = motion("pendulum", PENDULUM, 4.0, noise=5e-3)
    first, second = (discover(clip, resampled=20, seed=4) for _ in range(2))
    assert [term.inclusion for term in first.terms] == [term.inclusion for term in second.terms]


# --------------------------------------------------------------------------- what a model lacks


def with_drag():
    library, t_s = library_of((THETA,)), np.arange(900) / 60
    values = dict.fromkeys(library.names, 0.0)
    values |= {"theta_sin": -20.0, "theta_rate": -0.05, "theta_drag": -0.05, "theta_0": 1.2, "d_theta_0": 0.0}
    return seen(t_s, simulate(model_of(library), t_s, values).observed, THETA)


def test_residual_of_a_pendulum_with_quadratic_drag_calls_for_that_term():
    discovery = discover(with_drag(), residual_of="pendulum", resampled=20)
    assert (discovery.nearest.model, discovery.nearest.extra) == ("pendulum", ("|theta'| theta' in theta''",))
    drag = next(term for term in discovery.selected if term.parameter == "theta_drag")
    assert drag.coefficient.value == pytest.approx(-0.05, rel=0.1)
    assert drag.effect == "quadratic-drag"
    assert drag.inclusion > 0.9


def test_nearest_model_alone_has_all_its_terms():
    discovery = discover(with_drag(), resampled=5)
    assert discovery.matched is None
    assert discovery.nearest.parameters["damping"].value > 0.05  # it takes the place of the drag that is left out
    assert discovery.nearest.note.startswith("its residual is ")


def test_nothing_is_proposed_beyond_the_true_model():
    discovery = discover(motion("pendulum", PENDULUM, 8.0), residual_of="pendulum", resampled=5)
    assert selected(discovery) == {"theta_sin", "theta_rate"}
    assert discovery.matched.model == "pendulum"


def test_residual_of_a_model_of_another_quantity_is_refused():
    with pytest.raises(FitError, match="'free-fall' is not a model of theta that the library can express; there are"):
        discover(motion("pendulum", PENDULUM, 4.0), residual_of="free-fall")


# --------------------------------------------------------------------------- bad input


def plain(n, values=None, *quantities):
    t_s = np.arange(n) / 30
    return seen(t_s, np.sin(t_s) if values is None else values, *(quantities or (THETA,)), noise=0.0)


def test_too_few_samples_are_counted():
    with pytest.raises(DataError, match="9 of 9 samples are valid and in motion, at least 16 are needed"):
        discover(plain(9))


def test_all_gaps_are_refused():
    clip = plain(50)
    empty = clip.with_(valid=np.zeros(50, bool))
    with pytest.raises(DataError, match="0 of 50 samples are valid and in motion"):
        discover(empty)


def test_constant_series_has_no_equation():
    with pytest.raises(DataError, match=r"theta is 0\.3 in all 60 samples: what does not move has no equation to find"):
        discover(plain(60, np.full(60, 0.3)))


def test_unknown_quantity_lists_those_there_are():
    with pytest.raises(DataError, match=r"the trajectory has no quantity 'phi'; it has theta"):
        discover(plain(60), quantities=("phi",))


def test_clips_of_different_quantities_are_refused():
    with pytest.raises(DataError, match="clip 2 has z_m but clip 1 theta_rad"):
        discover([plain(60), plain(60, None, Z)])


def test_no_clip_is_refused():
    with pytest.raises(DataError, match="there is no trajectory"):
        discover([])


def test_level_beside_a_position_is_refused():
    both = np.column_stack([np.linspace(1, 2, 60), np.linspace(0, 1, 60)])
    with pytest.raises(DataError, match=r"h \(m\), z \(m\): positions and angles have equations of second order"):
        discover(plain(60, both, Quantity("h", "m"), Z))


def test_input_without_any_value_is_refused():
    clip = plain(60).with_(input_quantities=(Quantity("u", "V"),), inputs=np.full((60, 1), np.nan))
    with pytest.raises(DataError, match="the input u has no known value"):
        discover(clip)

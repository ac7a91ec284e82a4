"""Names where no effect of the library explains the data to the noise: motions with an effect that it does not have."""

from types import SimpleNamespace

import numpy as np
import pytest

from iris_sysid.diagnosis.component_support import ComponentSupport
from iris_sysid.diagnosis.contributions import Contributions
from iris_sysid.diagnosis.diagnose import diagnose
from iris_sysid.diagnosis.effect_search import EffectSearch
from iris_sysid.diagnosis.held_out_blocks import BlockErrors
from iris_sysid.diagnosis.open_world import OpenWorld, _weak_finding, with_components
from iris_sysid.diagnosis.refit import COMPLETE
from iris_sysid.registry import EFFECTS
from iris_sysid.types import Array, Component, Components, Finding
from tests.diagnosis.test_hold_out import NOISE, SWING, T_S, VALUES, table
from validation.independent.motions import integrate

NAMES = ("quadratic-drag", "linear-drag", "coulomb-friction", "cubic-stiffness", "constant-force")
SOAK_UP = ("impact", "periodic-forcing", "parameter-drift")
LIBRARY = [EFFECTS[name] for name in (*NAMES, *SOAK_UP)]
DRAG = 0.3


def wandering(theta: Array) -> Array:
    """The zero wanders at random within about a third of a second: no effect of the library does."""
    steps = np.random.default_rng(5).standard_normal(T_S.size)
    smooth = np.convolve(steps, np.exp(-0.5 * (np.arange(-60, 61) / 15) ** 2), "same")
    return theta + 4e-3 * (smooth / np.std(smooth))[:, None]


def motion(force) -> Array:
    return integrate(SWING, VALUES, T_S, force)[:, :1]


@pytest.fixture(scope="module")
def found():
    return diagnose(table(wandering(motion(lambda t, x, v, base: -DRAG * np.abs(v) * v))), "pendulum", effects=LIBRARY)


def test_world_is_open_for_this_motion(found):
    assert found.residual_ratio > COMPLETE


def test_drag_beside_what_the_library_lacks_is_named_or_in_the_class(found):
    groups = [finding.effects for finding in found.findings if finding.word in ("named", "group")]
    assert any("quadratic-drag" in names for names in groups)


def test_size_of_the_drag_is_within_its_error(found):
    size = found.sizes["quadratic_drag"]
    assert abs(size.value - DRAG) < 3.5 * size.stderr


def test_what_can_imitate_anything_is_no_added_effect(found):
    assert not {effect.name for effect in found.added} & set(SOAK_UP)
    named = {name for finding in found.findings if finding.word == "named" for name in finding.effects}
    assert not named & set(SOAK_UP)


def test_blocks_left_out_are_predicted_better(found):
    assert found.after.heldout < 0.6 * found.before.heldout


def test_what_is_left_lies_where_it_was_put_and_is_no_part_of_the_equation(found):
    largest = found.remaining.parts[0]
    assert "zero-wander" in (largest.kind, *largest.similar)
    assert found.remaining.noise_share < 0.5


def test_unknown_force_alone_gets_no_soak_up_name():
    def push(t, x, v, base):
        return 0.4 * np.sin(2.0 * t + 1.5 * np.sin(0.9 * t)) * np.exp(-(((t - 3.0) / 2.0) ** 2)) * np.ones(1)

    found = diagnose(table(motion(push)), "pendulum", effects=[EFFECTS[name] for name in SOAK_UP])
    assert found.residual_ratio > COMPLETE
    assert found.added == ()
    assert found.findings[0].word == "located"
    assert "force-of-time" in (found.components.parts[0].kind, *found.components.parts[0].similar)
    assert not found.verdict.complete


def test_clean_motion_leaves_nothing_to_be_said():
    found = diagnose(table(motion(None)), "pendulum", effects=LIBRARY)
    assert (found.added, found.nuisances, found.findings) == ((), (), ())
    assert found.after.heldout == pytest.approx(NOISE, rel=0.12)


def test_force_divided_by_what_grows_is_one_drift_that_settles():
    found = diagnose(table(motion(lambda t, x, v, base: base / (1.0 + 0.02 * t) - base)), "pendulum", effects=LIBRARY)
    assert [effect.name for effect in found.added] == ["parameter-drift"]
    size = found.sizes["parameter_drift"]
    assert abs(size.value + 0.02) < 3.5 * size.stderr


def test_search_ends_at_one_effect_that_explains_the_data(monkeypatch):
    monkeypatch.setattr(EffectSearch, "_with_formulas", lambda *_: pytest.fail("sets of effects are tried"))
    found = diagnose(table(motion(lambda t, x, v, base: -DRAG * np.abs(v) * v)), "pendulum", effects=LIBRARY)
    assert [effect.name for effect in found.added] == ["quadratic-drag"]
    size = found.sizes["quadratic_drag"]
    assert abs(size.value - DRAG) < 3.5 * size.stderr


def _parts(rms: float, *parts: Component) -> Components:
    noise = 1.0 - sum(part.share for part in parts)
    return Components(parts, noise, rms, noise**0.5 * rms, 1.0, "rad", 0.0)


WANDER = Component("zero-wander", 0.95, (0.9, 0.98), 0.019, 1.0)
FITS_ONLY = Finding("located", "periodic-force", ("periodic-forcing",), 0.98, "the interval of its size holds zero")
DRAG_NAMED = Finding("named", "force-of-velocity", ("quadratic-drag",), 0.9)


def test_parts_of_the_residual_are_told_first_where_no_effect_is_named():
    every = with_components([FITS_ONLY], _parts(0.02, WANDER), _parts(0.003))
    assert [(each.word, each.component, each.effects) for each in every] == [
        ("located", "zero-wander", ()),
        ("located", "periodic-force", ("periodic-forcing",)),
    ]


def test_part_is_told_once_where_an_effect_of_its_kind_fits():
    camera = Finding("located", "zero-wander", ("camera-drift",), 0.9)
    assert with_components([camera], _parts(0.02, WANDER), _parts(0.003)) == (camera,)


def test_beside_a_named_effect_only_what_is_left_is_told():
    every = with_components([DRAG_NAMED], _parts(0.02, WANDER), _parts(0.01, WANDER))
    assert [(each.component, each.share) for each in every] == [
        ("force-of-velocity", 0.9),
        ("zero-wander", pytest.approx(0.95 / 4)),
    ]


@pytest.mark.parametrize(("explained", "word"), [(0.5, "located"), (0.9, "named")])
def test_effect_in_weak_form_is_named_where_the_effects_explain_most_of_the_force(explained, word):
    effect = EFFECTS["input-saturation"]
    assert _weak_finding(effect, 0.5, {effect.name: 1.0}, explained).word == word


@pytest.mark.parametrize(
    ("most", "squares", "chosen"),
    [(1, (1.0, 2.0), 1), (2, (1.0, 2.0), 0), (2, (2.0, 1.0), 1)],  # effects that can be, and what is left
)
def test_what_fits_in_short_windows_alone_leaves_what_was_found_before_it(most, squares, chosen):
    each = zip((SOAK_UP[:2], SOAK_UP[:1]), squares, strict=True)
    sets = [SimpleNamespace(effects=[EFFECTS[name] for name in names], squares=left) for names, left in each]
    world = OpenWorld.__new__(OpenWorld)
    weak = SimpleNamespace(grown=lambda base, most: sets, candidate=lambda found: found)
    world._cache = SimpleNamespace(base=None, weak=weak, with_added=lambda base, candidate: candidate)
    world.shares = SimpleNamespace(allows=lambda model: len(model.effects) <= most, testable=True)
    world._is_followed, world._of_weak = lambda found, model: True, lambda found, model: found
    world._is_misread = lambda model: False
    assert world.in_weak_form() is sets[chosen]


@pytest.mark.parametrize(("left", "misread"), [(1.0, True), (3.0, False)])  # sums of squares; 2 with what windows show
def test_reading_error_that_explains_more_than_short_windows_show_sends_the_search_on(left, misread):
    reading, imitating = EFFECTS["sensor-lag"], EFFECTS["zero-wander"]
    by_name = {each.name: each for each in (imitating, reading, EFFECTS["coulomb-friction"])}
    screening = SimpleNamespace(names=list(by_name), single=lambda name: name)
    added = []
    world = OpenWorld.__new__(OpenWorld)
    formulas = [name for name, effect in by_name.items() if not effect.absorbs]
    world._search = SimpleNamespace(testable=lambda base, absorbs: [] if absorbs else formulas)
    world._cache = SimpleNamespace(
        base=None,
        library=SimpleNamespace(by_name=by_name),
        screening=lambda base: screening,
        with_added=lambda base, name: added.append(name) or SimpleNamespace(squares=left),
    )
    world.shares = SimpleNamespace(allows=lambda model: True)
    assert world._is_misread(SimpleNamespace(explains=False, squares=2.0)) is misread
    assert added == ["sensor-lag"]
    assert world._is_misread(SimpleNamespace(explains=True, squares=2.0)) is False


def _predicting(error: float, *names: str, values: int = 2, left: float | None = None) -> SimpleNamespace:
    """A model with effects of these names that predicts each of eight blocks with this squared error.

    It has some free ``values``; its sum of squares is that of the errors where none is ``left``.
    """
    squares = error * (1.0 + 0.01 * np.arange(8))
    return SimpleNamespace(
        effects=[EFFECTS[name] for name in names],
        errors=BlockErrors(squares, np.ones(8), 1.0),
        squares=float(squares.sum()) if left is None else left,
        fits=[SimpleNamespace(free=range(values))],
    )


@pytest.mark.parametrize(
    ("single", "chosen"), [(100.0, ["linear-drag", "quadratic-drag"]), (1.1, ["quadratic-drag"])]
)  # both are nothing beside what there is without any effect
def test_two_effects_that_together_predict_far_better_come_before_one(single, chosen):
    shares = SimpleNamespace(estimate=lambda model: model.errors)
    search = EffectSearch(SimpleNamespace(base=_predicting(1e6)), shares, ComponentSupport(None, False))
    found = search._simplest([_predicting(single, "quadratic-drag"), _predicting(1.0, "linear-drag", "quadratic-drag")])
    assert [effect.name for effect in found.effects] == chosen


@pytest.mark.parametrize(
    ("more", "left", "chosen"),
    [(1, 100.0, "coulomb-friction"), (1, 70.0, "velocity-weakening-friction"), (0, 95.0, "coulomb-friction")],
)
def test_what_explains_as_much_with_no_more_values_comes_before_a_better_first_order_prediction(more, left, chosen):
    shares = SimpleNamespace(estimate=lambda model: model.errors)
    search = EffectSearch(SimpleNamespace(base=_predicting(1e6)), shares, ComponentSupport(None, False))
    plain = _predicting(200.0, "coulomb-friction", values=3, left=100.0)
    other = _predicting(30.0, "velocity-weakening-friction", values=3 + more, left=left)
    assert search._simplest([other, plain]).effects[0].name == chosen


def test_one_component_is_evidence_of_one_effect_that_can_imitate_anything():
    line = Component("periodic-force", 0.87, (0.8, 0.95), 0.02, 1.0, similar=("zero-wander",))
    model = _predicting(1.0, "zero-wander", "periodic-forcing")

    def named(*parts):
        world = OpenWorld.__new__(OpenWorld)
        world._support = ComponentSupport(_parts(0.02, *parts), False)
        world.shares = SimpleNamespace(alone=lambda model, effect: 0.9 + 0.05 * (effect.name == "zero-wander"))
        return world._with_own_evidence(model, model.effects)

    assert named(line) == {"periodic-forcing"}
    own = Component("zero-wander", 0.5, (0.4, 0.6), 0.02, 1.0)
    assert named(Component("periodic-force", 0.4, (0.3, 0.5), 0.02, 1.0), own) == {"periodic-forcing", "zero-wander"}


@pytest.mark.parametrize(
    ("name", "component", "share", "agrees"),
    [
        ("periodic-forcing", "force-of-velocity", 0.9, False),  # a law of the state is no evidence of a sine
        ("periodic-forcing", "clock", 0.9, True),
        ("zero-wander", "force-of-time", 0.9, True),
        ("quadratic-drag", "clock", 0.9, False),
        ("periodic-forcing", "periodic-force", 0.1, False),
    ],
)
def test_component_is_evidence_of_what_imitates_anything_only_if_it_depends_on_the_time(name, component, share, agrees):
    kinds = ("periodic-force", "zero-wander") if name != "quadratic-drag" else ("own-force-drift",)
    part = Component(component, share, (share, share), 0.02, 1.0, similar=kinds)
    rest = Component("pulse", 0.95 - share, (0.0, 0.95 - share), 0.01, 1.0)
    support = ComponentSupport(_parts(0.02, part, rest), False)
    assert support.agrees(EFFECTS[name]) == agrees
    assert bool(support.evidence(EFFECTS[name])) == agrees


def test_law_of_the_state_is_evidence_of_a_formula_that_can_take_its_place():
    part = Component("reading-of-position", 0.9, (0.8, 0.95), 0.02, 1.0, similar=("force-of-position",))
    assert ComponentSupport(_parts(0.02, part), False).agrees(EFFECTS["cubic-stiffness"])


@pytest.mark.parametrize(("component", "taken"), [("force-of-velocity", []), ("periodic-force", ["periodic-forcing"])])
def test_law_gives_way_only_to_what_the_components_allow(component, taken):
    part = Component(component, 0.9, (0.8, 0.95), 0.02, 1.0, similar=("periodic-force",))
    screening = SimpleNamespace(names=["periodic-forcing", "quadratic-drag"], single=lambda name: name)
    cache = SimpleNamespace(
        base=None,
        library=SimpleNamespace(by_name=EFFECTS),
        screening=lambda context: screening,
        testable=lambda context: {"periodic-forcing", "quadratic-drag"},
        with_added=lambda context, candidate: candidate,
    )
    search = EffectSearch(cache, None, ComponentSupport(_parts(0.02, part), False))
    assert search._support.is_largest(EFFECTS["quadratic-drag"]) == (component == "force-of-velocity")
    context = SimpleNamespace(usable=True)
    assert search._absorbing(context, instead_of=[EFFECTS["quadratic-drag"]]) == taken
    assert search._absorbing(context) == ["periodic-forcing"]
    assert search._absorbing(SimpleNamespace(usable=False)) == []


def test_what_imitates_anything_is_not_the_main_effect_beside_a_formula_that_explains_nearly_all():
    turns = _parts(0.02, Component("periodic-force", 0.4, (0.3, 0.5), 0.02, 1.0))

    def dominant(shares):
        world = OpenWorld.__new__(OpenWorld)
        world._support = ComponentSupport(turns, False)
        world.shares = SimpleNamespace(alone=lambda model, effect: shares[effect.name])
        found = world._dominant(_predicting(1.0, *shares))
        return None if found is None else found.name

    assert dominant({"coulomb-friction": 0.6, "periodic-forcing": 0.96}) == "periodic-forcing"
    assert dominant({"coulomb-friction": 0.93, "periodic-forcing": 0.96}) is None


def test_two_that_imitate_anything_are_not_evidence_of_one_on_a_motion_that_never_turns():
    world = OpenWorld.__new__(OpenWorld)
    world._support = SimpleNamespace(known=True, never_turns=True)
    world._beats_curves = lambda model, effect: True
    world.shares = SimpleNamespace(alone=lambda model, effect: {"periodic-forcing": 0.9}.get(effect.name, 0.1))
    assert world._dominant(_predicting(1.0, "periodic-forcing")).name == "periodic-forcing"
    assert world._dominant(_predicting(1.0, "periodic-forcing", "impact")) is None


@pytest.mark.parametrize(("removed", "word"), [(0.1, "located"), (0.6, "named")])
def test_effect_beside_a_larger_one_that_can_imitate_anything_is_needed_without_it(removed, word):
    world = OpenWorld.__new__(OpenWorld)
    alone = {"impact": 0.7, "even-reading": 0.1}
    world._cache = SimpleNamespace(without=lambda model, effect: SimpleNamespace(usable=True))
    world.shares = SimpleNamespace(
        alone=lambda model, effect: alone[effect.name],
        contexts=lambda model, effect: [model, "formulas"],
        removed_in=lambda model, effect: removed if model == "formulas" else 0.5,
    )
    findings = [
        Finding("located", "pulse", ("impact",), 0.7),
        Finding("named", "reading-of-position", ("even-reading",), 0.3),
    ]
    model = SimpleNamespace(effects=[EFFECTS["impact"], EFFECTS["even-reading"]])
    assert [each.word for each in world.surviving(model, findings)] == ["located", word]


@pytest.mark.parametrize(("error", "taken"), [(0.5, True), (2.0, False)])
def test_formulas_are_tried_beside_what_imitates_anything_and_is_named(monkeypatch, error, taken):
    found = _predicting(1.0, "dropped-frame", "zero-drift")
    grown = _predicting(error, "dropped-frame", "quadratic-drag")
    started = []

    def with_effects(effects, starts):
        started.append([effect.name for effect in effects])
        return SimpleNamespace(usable=True)

    shares = SimpleNamespace(estimate=lambda model: model.errors)
    cache = SimpleNamespace(base=None, with_effects=with_effects)
    search = EffectSearch(cache, shares, ComponentSupport(None, False))
    monkeypatch.setattr("iris_sysid.diagnosis.effect_search.starts_of", lambda *_: ())
    monkeypatch.setattr(search, "_with_formulas", lambda current: grown)
    assert search.beside(found, {"dropped-frame"}) is (grown if taken else found)
    assert started == [["dropped-frame"]]  # what only fits is left out


@pytest.mark.parametrize(("certain", "share"), [([], 2 / 92), (["dropped-frame"], 1.0)])
def test_share_of_an_effect_is_in_what_certain_ones_that_imitate_anything_leave(certain, share):
    left = {"": 100.0, "dropped-frame": 10.0, "dropped-frame quadratic-drag": 8.0}

    def model(effects):
        squares = left[" ".join(sorted(effect.name for effect in effects))]
        estimates = {parameter.name: SimpleNamespace(value=1.0) for each in effects for parameter in each.parameters}
        fits = (SimpleNamespace(estimates=estimates),)
        return SimpleNamespace(effects=tuple(effects), squares=squares, usable=True, fits=fits)

    shares = Contributions.__new__(Contributions)
    shares._cache = SimpleNamespace(
        base=model([]),
        without=lambda whole, effect: model([each for each in whole.effects if each is not effect]),
        with_effects=lambda effects, starts: model(effects),
    )
    shares.trust(certain)
    both = model([EFFECTS["dropped-frame"], EFFECTS["quadratic-drag"]])
    assert shares._share_in(both, EFFECTS["quadratic-drag"]) == pytest.approx(share)


def test_what_imitates_anything_by_its_size_alone_is_one_curve():
    flexible = {name for name, effect in EFFECTS.items() if effect.is_flexible}
    assert {"impact", "periodic-forcing", "zero-wander", "dropped-frame"} <= flexible
    assert not {"parameter-drift", "zero-drift", "quadratic-drag", "velocity-weakening-friction"} & flexible


@pytest.mark.parametrize(("name", "counted"), [("parameter-drift", 2), ("cubic-stiffness", 2), ("impact", 1)])
def test_one_curve_counts_without_what_can_imitate_it_as_well(monkeypatch, name, counted):
    shares = Contributions.__new__(Contributions)
    shares._certain = frozenset()
    shares._cache = SimpleNamespace(
        with_effects=lambda effects, starts: SimpleNamespace(usable=True, effects=tuple(effects))
    )
    monkeypatch.setattr("iris_sysid.diagnosis.contributions.starts_of", lambda *_: ())
    effect = EFFECTS[name]
    model = SimpleNamespace(effects=(effect, EFFECTS["periodic-forcing"]))
    contexts = shares.contexts(model, effect)
    assert len(contexts) == counted
    assert contexts[-1].effects == ((effect,) if counted == 2 else model.effects)


@pytest.mark.parametrize(("named", "beside"), [("dropped-frame", True), ("parameter-drift", True), ("impact", False)])
def test_formulas_are_tried_only_beside_what_has_one_form(monkeypatch, named, beside):
    world = OpenWorld.__new__(OpenWorld)
    found = SimpleNamespace(effects=(EFFECTS[named], EFFECTS["zero-wander"]), explains=False)
    world.shares = SimpleNamespace(testable=True)
    world._search = SimpleNamespace(run=lambda: found, beside=lambda model, names: sorted(names))
    monkeypatch.setattr(world, "_named_absorbing", lambda model: {named, "zero-wander"})
    assert world.searched() == ([named] if beside else found)


@pytest.mark.parametrize(
    ("shares", "word", "said"),
    [
        ((np.nan, 0.1), "located", "small part"),
        ((0.1, np.nan), "located", "small part"),
        ((np.nan, np.nan), "located", "cannot be fitted without it"),
        ((np.nan, 0.4), "named", ""),
    ],
)
def test_no_name_comes_from_a_model_that_cannot_be_fitted_without_the_effect(monkeypatch, shares, word, said):
    effect = EFFECTS["quadratic-drag"]
    model = SimpleNamespace(effects=(effect, EFFECTS["impact"]), fits=())
    world = OpenWorld.__new__(OpenWorld)
    world._support = SimpleNamespace(never_turns=False)
    world._cache = SimpleNamespace(without=lambda *_: None)
    world.shares = Contributions.__new__(Contributions)
    world.shares._blocks = [[0]]
    answers = {
        "contexts": lambda *_: ["whole", "formulas"],
        "removed_in": lambda context, _: shares[context == "formulas"],
        "share_of": lambda *_: 0.5,
        "is_resolved": lambda *_: True,
    }
    for name, answer in answers.items():
        monkeypatch.setattr(Contributions, name, lambda _, *given, answer=answer: answer(*given))
    found = world._finding(model, effect, (effect.name,), ())
    assert found.word == word
    assert said in found.reason

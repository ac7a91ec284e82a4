"""PEtab problems: a model goes out, passes PEtab's own validator and comes back the same; one of others is fitted."""

import shlex
import warnings

import numpy as np
import pytest

from iris_sysid import (
    DataError,
    OutputError,
    Quantity,
    Trajectory,
    fit,
    model_from_equation,
    read_petab,
    simulate,
    write_petab,
)

libsbml = pytest.importorskip("libsbml", reason="PEtab problems need the extra petab")

SWING = "theta'' = -g/L*sin(theta) - c*theta' - d*sign(theta')*max(abs(theta), 0.1)"
TANKS = "h1' = (q - k1*h1)/area; h2' = k1*h1 - k2*sqrt(max(h2, 0)) + 0.02*t"  # the level h1 is hidden


def measured(equation, observed, unit, values, known_noise, t_s):
    model = model_from_equation(equation, units={observed: unit}, observed=[observed])
    truth = simulate(model, t_s, values).observed
    noise = 2e-3 * np.random.default_rng(0).standard_normal(truth.shape)
    sigma = np.full_like(truth, 2e-3 if known_noise else np.nan)
    return Trajectory(t_s, (Quantity(observed, unit),), truth + noise, sigma, np.ones(t_s.size, bool))


def swing():
    values = {"g": 9.81, "L": 0.5, "c": 0.2, "d": 0.3, "theta_0": 1.1, "theta_rate_0": 0.2}
    return measured(SWING, "theta", "rad", values, False, np.arange(200) / 40)


def tanks():
    values = {"q": 0.3, "k1": 0.4, "area": 2.0, "k2": 0.5, "h1_0": 1.5, "h2_0": 0.4}
    return measured(TANKS, "h2", "m", values, True, np.arange(120) / 8)


CASES = {
    "swing": (SWING, swing, {"g": 9.81, "d": 0.3}, {"L": 0.6}, {"L": (0.1, 3.0)}),
    "tanks": (TANKS, tanks, {"q": 0.3, "area": 2.0}, {"k1": 0.5, "k2": 0.4, "h1_0": 1.2, "h2_0": 0.4}, {}),
}


@pytest.fixture(params=CASES)
def exported(request, tmp_path):
    equation, data, fixed, start, bounds = CASES[request.param]
    clip = data()
    return clip, CASES[request.param], write_petab(clip, equation, tmp_path, bounds=bounds, fixed=fixed, start=start)


def test_a_problem_that_was_written_passes_the_validator(exported):
    petab = pytest.importorskip("petab.v1")
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # petab reads its tables in a way that pandas gives up
        assert not petab.lint_problem(petab.Problem.from_yaml(exported[2]))


def test_a_problem_that_comes_back_gives_the_same_fit(exported):
    clip, (equation, _, fixed, start, bounds), path = exported
    observed = [quantity.name for quantity in clip.quantities]
    units = {quantity.name: quantity.unit for quantity in clip.quantities}
    first = fit(
        clip, model_from_equation(equation, units=units, observed=observed, bounds=bounds), fixed=fixed, start=start
    )
    problem = read_petab(path)
    (held,) = problem.fixed.values()
    again = fit(*problem.clips.values(), problem.model(), fixed=held, start=problem.start)
    assert (held, problem.start, problem.bounds) == (fixed, start, bounds)
    assert set(again.free) == set(first.free)
    for name in first.free:
        assert again.estimates[name].value == pytest.approx(first.estimates[name].value, rel=1e-6)
        assert again.estimates[name].stderr == pytest.approx(first.estimates[name].stderr, rel=1e-5)


def test_gaps_are_not_measurements(tmp_path):
    clip = tanks()
    valid = np.arange(clip.n) % 17 != 5
    problem = read_petab(write_petab(clip.with_(valid=valid), TANKS, tmp_path))
    again = problem.clips["measured"]
    np.testing.assert_array_equal(again.position, clip.position[valid])
    np.testing.assert_array_equal(again.sigma, clip.sigma[valid])
    assert again.quantities[0].unit == "m"


def test_times_of_an_equation_count_from_the_first_sample(tmp_path):
    t_s = 3.0 + np.arange(20) / 10
    z = np.sin(t_s)[:, None]
    clip = Trajectory(t_s, (Quantity("z", "m"),), z, np.full_like(z, np.nan), np.ones(20, bool))
    problem = read_petab(write_petab(clip, "z' = a*cos(t)", tmp_path))
    assert problem.equation == "z' = a*cos(t + 3)"
    assert problem.clips["measured"].t_s[0] == 0.0


# --------------------------------------------------------------------------- problems of others

REACTIONS = """<?xml version="1.0" encoding="UTF-8"?>
<sbml xmlns="http://www.sbml.org/sbml/level3/version1/core" level="3" version="1"><model id="conversion">
<listOfFunctionDefinitions><functionDefinition id="linear"><math xmlns="http://www.w3.org/1998/Math/MathML"><lambda>
<bvar><ci>x</ci></bvar><bvar><ci>rate</ci></bvar><apply><times/><ci>rate</ci><ci>x</ci></apply></lambda></math>
</functionDefinition></listOfFunctionDefinitions>
<listOfCompartments><compartment id="cell" size="2" constant="true"/></listOfCompartments>
<listOfSpecies>
<species id="A" compartment="cell" initialAmount="2" hasOnlySubstanceUnits="false" boundaryCondition="false"
 constant="false"/>
<species id="B" compartment="cell" initialConcentration="0" hasOnlySubstanceUnits="false" boundaryCondition="false"
 constant="false"/></listOfSpecies>
<listOfParameters><parameter id="u1" value="1" constant="true"/><parameter id="back" constant="false"/>
<parameter id="_k2" value="1" constant="true"/></listOfParameters>
<listOfRules><assignmentRule variable="back"><math xmlns="http://www.w3.org/1998/Math/MathML"><apply><times/>
<ci>_k2</ci><ci>B</ci></apply></math></assignmentRule></listOfRules>
<listOfReactions>
<reaction id="forth" reversible="false" fast="false">
<listOfReactants><speciesReference species="A" stoichiometry="1" constant="true"/></listOfReactants>
<listOfProducts><speciesReference species="B" stoichiometry="1" constant="true"/></listOfProducts>
<kineticLaw><math xmlns="http://www.w3.org/1998/Math/MathML"><apply><times/><ci>cell</ci><apply><ci>linear</ci>
<ci>A</ci><ci>u1</ci></apply></apply></math></kineticLaw></reaction>
<reaction id="return" reversible="false" fast="false">
<listOfReactants><speciesReference species="B" stoichiometry="1" constant="true"/></listOfReactants>
<listOfProducts><speciesReference species="A" stoichiometry="1" constant="true"/></listOfProducts>
<kineticLaw><math xmlns="http://www.w3.org/1998/Math/MathML"><apply><times/><ci>size</ci><ci>back</ci></apply></math>
<listOfLocalParameters><localParameter id="size" value="2"/></listOfLocalParameters></kineticLaw></reaction>
</listOfReactions></model></sbml>"""
YAML = """format_version: 1
parameter_file: parameters.tsv
problems:
  - sbml_files: [model.xml]
    condition_files: [conditions.tsv]
    observable_files: [observables.tsv]
    measurement_files: [measurements.tsv]
"""
PARAMETERS = (
    "parameterId\tparameterScale\tlowerBound\tupperBound\tnominalValue\testimate\n"
    "u1\tlog10\t1e-5\t1e5\t1.0\t1\n_k2\tlog10\t1e-5\t1e5\t1.0\t1\nsd\tlin\t0.001\t1\t0.01\t0\n"
)
OBSERVABLES = "observableId\tobservableFormula\tnoiseFormula\nobs_b\tB\tsd\n"
K1, K2 = 0.8, 0.6


def measurements(conditions=("c0",), n=60):
    t_s = np.arange(n) / 10
    rows = ["observableId\tsimulationConditionId\tmeasurement\ttime"]
    for seed, name in enumerate(conditions):
        b = K1 / (K1 + K2) * (1 - np.exp(-(K1 + K2) * t_s)) + 0.01 * np.random.default_rng(seed).standard_normal(n)
        rows += [f"obs_b\t{name}\t{value}\t{time}" for value, time in zip(b, t_s, strict=True)]
    return "\n".join(rows) + "\n"


@pytest.fixture
def folder(tmp_path):
    """A problem in the style of the published ones: the conversion of A to B and back, by reactions."""
    files = {
        "problem.yaml": YAML,
        "model.xml": REACTIONS,
        "parameters.tsv": PARAMETERS,
        "conditions.tsv": "conditionId\tconditionName\nc0\t\n",
        "observables.tsv": OBSERVABLES,
        "measurements.tsv": measurements(),
    }
    for name, text in files.items():
        (tmp_path / name).write_text(text)
    return tmp_path


def test_reactions_become_balances_and_the_fit_finds_the_rates(folder):
    problem = read_petab(folder / "problem.yaml")
    assert problem.equation == "A' = (-2*u1_own*A + 2*k2*B)/2; B' = (2*u1_own*A - 2*k2*B)/2"
    assert problem.fixed["c0"] == {"A_0": 1.0, "B_0": 0.0}
    assert problem.bounds == {"u1_own": (1e-5, 1e5), "k2": (1e-5, 1e5)}
    found = fit(problem.clips["c0"], problem.model(), fixed=problem.fixed["c0"], start=problem.start)
    for name, truth in (("u1_own", K1), ("k2", K2)):
        assert abs(found.estimates[name].value - truth) < 3 * found.estimates[name].stderr
        assert found.estimates[name].stderr < 0.05


def test_each_condition_is_a_table_with_its_values(folder):
    (folder / "model.xml").write_text(REACTIONS.replace('initialAmount="2"', 'initialConcentration="1"'))
    (folder / "conditions.tsv").write_text("conditionId\tA\tcell\nc0\t\t\nc1\t3\t4\n")
    (folder / "measurements.tsv").write_text(measurements(("c1", "c0")))
    problem = read_petab(folder / "problem.yaml")
    assert "cell*u1_own*A" in problem.equation
    assert problem.fixed == {"c1": {"A_0": 3.0, "B_0": 0.0, "cell": 4.0}, "c0": {"A_0": 1.0, "B_0": 0.0, "cell": 2.0}}
    assert (problem.clips["c1"].sigma == 0.01).all()


@pytest.mark.parametrize(
    ("formula", "value"),
    [
        ("a - (b - x)", 2 - (3 - 5)),
        ("a/(b*x)/2", 2 / 15 / 2),
        ("-a^b", -8),
        ("(-a)^2 + a^-2", 4.25),
        ("(a^b)^2", 64),
        ("root(3, 8*x) + sqrt(x)", 40 ** (1 / 3) + 5**0.5),
        ("log10(x) + ln(a) + log(2, b)", np.log10(5) + np.log(2) + np.log2(3)),
        ("a - -b*(-x)", 2 - 15),
        ("exp(a)*sin(x)/cos(b)^2", np.exp(2) * np.sin(5) / np.cos(3) ** 2),
        ("exponentiale + pi*time", np.e + 7 * np.pi),
        ("(a + b)*x - 1e-7", 25 - 1e-7),
    ],
)
def test_a_formula_keeps_its_value(folder, formula, value):
    document = libsbml.SBMLDocument(3, 1)
    sbml = document.createModel()
    for name in ("a", "b", "x"):
        parameter = sbml.createParameter()
        parameter.setId(name)
        parameter.setValue(0.0)
        parameter.setConstant(name != "x")
    rule = sbml.createRateRule()
    rule.setVariable("x")
    rule.setMath(libsbml.parseL3Formula(formula))
    (folder / "model.xml").write_text(libsbml.writeSBMLToString(document))
    (folder / "parameters.tsv").write_text("parameterId\testimate\nb\t1\na\t1\nsd\t1\n")
    (folder / "observables.tsv").write_text(OBSERVABLES.replace("\tB", "\tx"))
    model = read_petab(folder / "problem.yaml").model()
    values = {"a": 2.0, "b": 3.0}
    params = tuple(values[parameter.name] for parameter in model.parameters)
    assert model.rhs(7.0, (5.0,), params)[0] == pytest.approx(value, rel=1e-12)


# --------------------------------------------------------------------------- what is refused


def doubling(count):
    """Functions, each of which calls the one before twice."""
    body = "<math xmlns='http://www.w3.org/1998/Math/MathML'><lambda>{}</lambda></math></functionDefinition>"
    call = "<apply><plus/><apply><ci>{0}</ci><ci>x</ci></apply><apply><ci>{0}</ci><ci>x</ci></apply></apply>"
    inside = ["<ci>x</ci>", *(call.format(f"f{k}") for k in range(count))]
    made = [
        f"<functionDefinition id='f{k}'>" + body.format(f"<bvar><ci>x</ci></bvar>{each}")
        for k, each in enumerate(inside)
    ]
    return "<listOfFunctionDefinitions>" + "".join(made)


CALL, TWICE = "<ci>linear</ci>\n<ci>A</ci><ci>u1</ci>", "<ci>f40</ci>\n<ci>A</ci>"
EVENT = "</listOfReactions><listOfEvents><event id='e' useValuesFromTriggerTime='true'/></listOfEvents>"
LAPLACE = "noiseFormula\tnoiseDistribution\nobs_b\tB\tsd\tlaplace"
CHANGES = [
    ("problem.yaml", "model.xml", "../model.xml", "'../model.xml' is not beside the problem"),
    ("problem.yaml", "[conditions.tsv]", '["http://a/b.tsv"]', "is not beside the problem"),
    ("problem.yaml", "[conditions.tsv]", "[/etc/passwd]", "'/etc/passwd' is not beside the problem"),
    ("problem.yaml", "format_version: 1", "format_version: 2.0.0", "not a PEtab problem of version 1"),
    ("problem.yaml", "problems:", "problems: {", "not a YAML file"),
    ("problem.yaml", "[model.xml]", "!!python/object/apply:os.system [ls]", "not a YAML file"),
    ("model.xml", "<sbml", "<!DOCTYPE a [<!ENTITY b 'c'>]><sbml", "declares entities"),
    ("model.xml", "</model>", "", "cannot be read as a model"),
    (
        "model.xml",
        "<ci>rate</ci><ci>x</ci></apply>",
        "<ci>rate</ci><ci>__import__</ci></apply>",
        "nothing called __import__",
    ),
    ("model.xml", "<ci>linear</ci>", "<ci>undefined</ci>", "defines no function undefined"),
    ("model.xml", "<ci>_k2</ci>", "<ci>back</ci>", "too long or too deep"),
    (
        "model.xml",
        "<apply><times/>\n<ci>_k2</ci>",
        "<apply><factorial/>\n<ci>_k2</ci>",
        "no such operation|cannot be read",
    ),
    (
        "model.xml",
        "</listOfReactions>",
        "</listOfReactions><listOfEvents><event id='e' useValuesFromTriggerTime='true'/></listOfEvents>",
        "has events|cannot be read",
    ),
    ("model.xml", 'value="2"/>', 'value="NaN"/>', "size of the SBML model has no finite value"),
    ("parameters.tsv", "estimate\n", "other\n", "parameters.tsv has no column estimate"),
    ("parameters.tsv", "0.01\t0", "much\t0", "the noise of obs_b is 'much', not a number"),
    ("parameters.tsv", "0.01\t0", "-1\t0", "must be above 0"),
    ("parameters.tsv", "sd\t", "u1\t", "stands twice"),
    ("parameters.tsv", "sd\t", "s d\t", "'s d' is not an id"),
    (
        "conditions.tsv",
        "conditionName\nc0\t",
        "cell\nc0\t3",
        "A starts from an amount in cell, whose size",
    ),
    ("conditions.tsv", "c0", "../c0", "'../c0' is not an id of a condition"),
    ("conditions.tsv", "conditionName\nc0\t", "A\nc0\tu1", "A in the table of conditions is 'u1', not a number"),
    ("observables.tsv", "\tB\t", "\t2*B\t", r"obs_b is the formula 2\*B, not a state"),
    ("observables.tsv", "\tsd", "\t0.1*B", r"the noise of obs_b is '0.1\*B', not a number"),
    (
        "observables.tsv",
        "noiseFormula\nobs_b\tB",
        "noiseFormula\tnoiseDistribution\nobs_b\tB\tsd\tlaplace",
        "'laplace' is not supported",
    ),
    ("measurements.tsv", "\t0.1\n", "\t0.0\n", "measured twice at 0 s: average replicates"),
    ("measurements.tsv", "\t0.1\n", "\tnan\n", "a time is 'nan'"),
    ("measurements.tsv", "obs_b\tc0", "obs_c\tc0", "observable 'obs_c', which is not in the table"),
    ("measurements.tsv", "obs_b\tc0", "obs_b\tc9", "condition 'c9', which is not in the table"),
]


@pytest.mark.parametrize(("file", "before", "after", "message"), CHANGES)
def test_what_a_fit_here_has_not_is_refused_in_one_line(folder, file, before, after, message):
    text = (folder / file).read_text()
    assert before in text
    (folder / file).write_text(text.replace(before, after))
    with pytest.raises(DataError, match=message) as refused:
        read_petab(folder / "problem.yaml")
    assert "\n" not in str(refused.value)


def test_functions_that_double_are_refused_at_once(folder):
    text = REACTIONS.replace("<listOfFunctionDefinitions>", doubling(40))
    (folder / "model.xml").write_text(text.replace(CALL, TWICE))
    with pytest.raises(DataError, match=r"too long|longer than"):
        read_petab(folder / "problem.yaml")


def test_formulas_nested_too_deeply_are_refused_before_they_are_read(folder):
    deep = "<apply><minus/>" * 200_000 + "<ci>_k2</ci>" + "</apply>" * 200_000
    (folder / "model.xml").write_text(REACTIONS.replace("<ci>_k2</ci>", deep))
    with pytest.raises(DataError, match="nests more than 500 elements"):
        read_petab(folder / "problem.yaml")


def test_what_a_problem_cannot_hold_is_refused(tmp_path):
    clip = swing()
    for equation, message in {
        "theta' = u": "cannot hold the table of the input u: write the input as a function of t",
        "θ' = -k*θ; theta' = θ": "ASCII letters only: give 'θ",
        "z' = -k*z": "the equation is about z, but the table has theta",
    }.items():
        with pytest.raises(DataError, match=message):
            write_petab(clip, equation, tmp_path)
    with pytest.raises(DataError, match="no parameter 'mass'; it has k, theta_0"):
        write_petab(clip, "theta' = -k*theta", tmp_path, start={"mass": 1.0})
    assert list(tmp_path.iterdir()) == []
    write_petab(clip, "theta' = -k*theta", tmp_path)
    with pytest.raises(OutputError, match="exists already"):
        write_petab(clip, "theta' = -k*theta", tmp_path)


def test_commands_export_and_import_and_print_the_fit(tmp_path, cli, monkeypatch):
    from iris_sysid import write_trajectory

    monkeypatch.chdir(tmp_path)
    write_trajectory(swing(), "swing.csv")
    equation = "theta'' = -g/L*sin(theta) - c*theta'"
    options = ["--set", "g=9.81+-0.01", "--start-at", "L=0.6", "--bound", "L=0.1:", "--bound", "theta_0=-3:3"]
    outcome = cli("petab", "swing.csv", "--equation", equation, *options, "-o", "out")
    assert outcome.status == 0, outcome
    assert outcome.out == "out/problem.yaml\n"
    assert "cannot hold the standard error of g" in outcome.err
    outcome = cli("petab", "out/problem.yaml", "-o", "in")
    command = shlex.split(outcome.out)
    assert command[:3] == ["iris-sysid", "fit", "in/measured.csv"]
    assert "L=0.1:" in command
    assert cli(*command[1:]).status == 0
    assert (tmp_path / "in" / "measured-fit.json").is_file()

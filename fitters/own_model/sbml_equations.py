"""Equations in text from an SBML model: rate rules, and reactions with their kinetic laws as balances of species.

The formulas are read as syntax trees of libsbml and written as our text, which :mod:`fitters.own_model.equation`
parses; nothing of the file is run. The text is bounded, and so is the work to make it.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from types import MappingProxyType, ModuleType
from typing import Any
from xml.parsers import expat

from fitters.own_model.expression import CONSTANTS, FUNCTIONS, INPUT_NAME, MAX_CHARACTERS, TIME
from fitters.own_model.petab_export import DEFINED, NODES, petab_package
from iris_sysid.errors import DataError

MAX_DEPTH, MAX_NODES = 60, 20_000
MAX_LEVELS = 500  # of elements in elements
SUM, PRODUCT, POWER, ATOM = 1, 2, 4, 9  # how strongly an operation binds
Written = tuple[str, int]  # a formula in text, and how strongly it binds
Writer = Callable[[list[Written]], Written]
NO_NAMES: Mapping[str, Written] = MappingProxyType({})


@dataclass(frozen=True, eq=False, slots=True)
class SbmlSystem:
    """The ``equations`` in text; by SBML id, ``states`` as they are called in these, and ``initial`` values.

    An initial value is a number, or the id of the parameter that gives it. ``parameters``: ids and own names of those
    that the equations use; ``values`` those that the model gives them.
    """

    equations: str
    states: Mapping[str, str]
    initial: Mapping[str, float | str]
    parameters: Mapping[str, str]
    values: Mapping[str, float]


def own_name(identifier: str) -> str:
    """The identifier as a name that equations in text can have: ``u1`` is an input there, ``t`` the time.

    Parameters
    ----------
    identifier
        Of SBML or PEtab.
    """
    name = re.sub("_+", "_", identifier).strip("_")
    taken = name in (TIME, *FUNCTIONS, *CONSTANTS) or INPUT_NAME.fullmatch(name)
    return f"{name}_own" if taken else name


def read_sbml(content: str, named: set[str], positions_kept: set[str]) -> SbmlSystem:
    """Read the text of an SBML model as equations.

    Parameters
    ----------
    content
        The XML.
    named
        Ids of parameters that keep their names; others are put into the equations as numbers.
    positions_kept
        Ids of states that stay states of first order although they are the rate of another one: they are observed.

    Raises
    ------
    DataError
        When the model is not SBML, is not an ordinary differential equation, or is too large.
    """
    if "<!DOCTYPE" in content or "<!ENTITY" in content:
        raise DataError("the SBML file declares entities, which are not read: write it without a DOCTYPE")
    _check_levels(content)
    libsbml = petab_package("libsbml")
    document = libsbml.readSBMLFromString(content)
    model = document.getModel()
    if model is None or document.getNumErrors(libsbml.LIBSBML_SEV_ERROR) or document.getNumErrors(3):
        raise DataError("the SBML file cannot be read as a model: check it with an SBML validator")
    if model.getNumEvents():
        raise DataError("the SBML model has events, which an equation in text cannot have: remove them")
    return _Reading(libsbml, model, named, positions_kept).system()


def _check_levels(content: str) -> None:
    """DataError where elements are nested too deeply: libsbml reads by recursion, and would end the process."""
    levels = [0]

    def opened(name: str, attributes: Mapping[str, str]) -> None:
        levels[0] += 1
        if levels[0] > MAX_LEVELS:
            raise DataError(f"the SBML file nests more than {MAX_LEVELS} elements: simplify its formulas")

    def closed(name: str) -> None:
        levels[0] -= 1

    parser = expat.ParserCreate()
    parser.StartElementHandler, parser.EndElementHandler = opened, closed
    try:
        parser.Parse(content.encode(), True)
    except expat.ExpatError as error:
        raise DataError(f"the SBML file cannot be read as a model: {error}") from error


@dataclass(eq=False, slots=True)
class _Reading:
    """One model while it is read; ``names`` of its states in the text, by id."""

    libsbml: ModuleType
    model: Any
    named: set[str]
    kept: set[str]
    names: dict[str, str] = field(default_factory=dict)
    used: dict[str, str] = field(default_factory=dict)
    nodes: int = 0
    writers: dict[int, Writer] = field(default_factory=dict)

    def system(self) -> SbmlSystem:
        self.writers = _writers(self.libsbml)
        rules = {rule.getVariable(): rule for rule in self.model.getListOfRules()}
        if any(rule.isAlgebraic() for rule in rules.values()):
            raise DataError("the SBML model has an algebraic rule: solve it, and write an assignment rule")
        ruled = {name: rule.getMath() for name, rule in rules.items() if rule.isRate()}
        moved = [species.getId() for species in self.model.getListOfSpecies() if self._reacts(species, rules)]
        states = [*ruled, *moved]
        if not states:
            raise DataError("the SBML model has neither rate rules nor reactions: there is nothing to fit")
        pairs = self._second_order(ruled)
        self.names = {state: own_name(state) for state in states}
        self.names |= {rate: f"{own_name(position)}'" for position, rate in pairs.items()}
        if len(set(self.names.values())) < len(states):
            raise DataError("two states of the SBML model would have one name in an equation: rename one")
        sides = {state: self.text(ruled[state]) for state in ruled if state not in pairs}
        sides |= {state: self._balance(state) for state in moved}
        equations = "; ".join(f"{self.names[state]}' = {side}" for state, (side, _) in sides.items())
        self._bounded((equations, SUM))
        values = {name: self._value(name) for name in self.used}
        return SbmlSystem(equations, self.names, {state: self._initial(state) for state in states}, self.used, values)

    def _reacts(self, species: Any, rules: Mapping[str, Any]) -> bool:
        if species.isSetConversionFactor() or self.model.isSetConversionFactor():
            raise DataError(f"{species.getId()} has a conversion factor, which is not read: write it into the laws")
        return not (species.getBoundaryCondition() or species.getConstant() or species.getId() in rules)

    def _second_order(self, ruled: Mapping[str, Any]) -> dict[str, str]:
        """Positions by id with the id of their velocity: the rate of one is the other, and that of no other state."""
        rates = {state: formula.getName() for state, formula in ruled.items() if self._is_name(formula)}
        pairs = {}
        for position, velocity in rates.items():
            once = list(rates.values()).count(velocity) == 1
            if once and velocity in ruled and velocity not in {*rates, *self.kept}:
                pairs[position] = velocity
        return pairs

    def _is_name(self, formula: Any) -> bool:
        return formula is not None and formula.getType() == self.libsbml.AST_NAME

    def _balance(self, species: str) -> Written:
        """The rate of a species: what reactions make less what they use up, for a concentration over the volume."""
        terms = []
        for reaction in self.model.getListOfReactions():
            signed = [*((-1, part) for part in reaction.getListOfReactants())]
            signed += [(1, part) for part in reaction.getListOfProducts()]
            count = sum(sign * self._stoichiometry(part) for sign, part in signed if part.getSpecies() == species)
            if count:
                law = reaction.getKineticLaw()
                if law is None:
                    raise DataError(f"the reaction {reaction.getId()[:40]} has no kinetic law: give it one")
                local = [*law.getListOfParameters(), *law.getListOfLocalParameters()]
                values = {one.getId(): self._number(one.getId(), one.getValue()) for one in local}
                term = self.text(law.getMath(), values)
                factor = [] if abs(count) == 1 else [self._number(species, abs(count))]
                term = _joined("*", PRODUCT, "1")([*factor, term])
                terms.append(term if count > 0 else _minus([term]))
        rate = self._bounded(_joined(" + ", SUM, "0")(terms))
        entry = self.model.getSpecies(species)
        if entry.getHasOnlySubstanceUnits():
            return rate
        volume = self.name(entry.getCompartment(), NO_NAMES, 0)
        return rate if volume[0] == "1" else self._bounded(_divided([rate, volume]))

    def _stoichiometry(self, part: Any) -> float:
        if part.isSetStoichiometryMath() or (part.isSetId() and self.model.getRule(part.getId()) is not None):
            raise DataError(f"a stoichiometry of {part.getSpecies()[:40]} is a formula: write the number")
        count = float(part.getStoichiometry())
        if not math.isfinite(count):
            raise DataError(f"a stoichiometry of {part.getSpecies()[:40]} is missing: write the number")
        return count

    def _initial(self, state: str) -> float | str:
        assignment = self.model.getInitialAssignment(state)
        if assignment is not None:
            formula = assignment.getMath()
            if formula is not None and formula.isName() and formula.getName() in self.named:
                return str(formula.getName())
            if formula is not None and formula.isNumber():
                return float(formula.getValue())
            raise DataError(f"the initial value of {state} is a formula: give it a parameter or a number")
        return self._value(state)

    def _value(self, name: str) -> float:
        """The number that a parameter, a compartment or a species has; NaN where it has none."""
        species, entry = self.model.getSpecies(name), self.model.getParameter(name)
        if species is None:
            entry = entry or self.model.getCompartment(name)
            if entry is None:
                raise DataError(f"the SBML model has nothing called {name[:40]} that a formula can use")
            return float(entry.getValue() if hasattr(entry, "getValue") else entry.getSize())
        amount, compartment = species.getHasOnlySubstanceUnits(), species.getCompartment()
        if amount != species.isSetInitialConcentration():
            return float(species.getInitialAmount() if amount else species.getInitialConcentration())
        if compartment in self.named:
            raise DataError(f"{name[:40]} starts from an amount in {compartment}, whose size is a parameter: fix it")
        size = self._value(compartment)
        return float(species.getInitialConcentration() * size if amount else species.getInitialAmount() / size)

    # ------------------------------------------------------------------------------------------------ formulas

    def text(self, node: Any, local: Mapping[str, Written] = NO_NAMES, depth: int = 0) -> Written:
        """A formula as text, and how strongly it binds."""
        self.nodes += 1
        if node is None or depth > MAX_DEPTH or self.nodes > MAX_NODES:
            raise DataError("a formula of the SBML model is missing, too long or too deep to be read: simplify it")
        if self._is_name(node):
            return self.name(node.getName(), local, depth)
        if node.isNumber():
            return self._number("a formula", node.getValue())
        parts = [self.text(node.getChild(k), local, depth + 1) for k in range(node.getNumChildren())]
        if node.getType() == self.libsbml.AST_FUNCTION:
            return self._call(node.getName(), parts, depth)
        writer = self.writers.get(node.getType())
        if writer is None:
            shown = self.libsbml.formulaToL3String(node) or "a formula"
            raise DataError(f"{shown[:60]}: an equation in text has no such operation")
        return self._bounded(writer(parts))

    def _call(self, name: str, parts: list[Written], depth: int) -> Written:
        """What a function that the model defines makes of its arguments."""
        function = self.model.getFunctionDefinition(name)
        if function is None or function.getNumArguments() != len(parts):
            raise DataError(f"the SBML model defines no function {name[:40]} of {len(parts)} arguments")
        if name in DEFINED and self._same(function.getMath(), DEFINED[name]):
            return self._bounded(_function(name)(parts))
        arguments = [function.getArgument(k).getName() for k in range(len(parts))]
        return self.text(function.getBody(), dict(zip(arguments, parts, strict=True)), depth + 1)

    def _same(self, one: Any, formula: str) -> bool:
        written = self.libsbml.formulaToL3String
        return bool(written(one) == written(self.libsbml.parseL3Formula(formula)))

    def name(self, name: str, local: Mapping[str, Written], depth: int) -> Written:
        """What a name stands for: an argument, a state, a rule, a parameter by its own name, or a number."""
        if name in local:
            return local[name]
        if name in self.names:
            return self.names[name], ATOM
        rule = self.model.getAssignmentRule(name)
        if rule is not None:
            return self.text(rule.getMath(), NO_NAMES, depth + 1)
        if name in self.named:
            self.used[name] = own_name(name)
            return self.used[name], ATOM
        assignment = self.model.getInitialAssignment(name)
        if assignment is not None:
            return self.text(assignment.getMath(), NO_NAMES, depth + 1)
        return self._number(name, self._value(name))

    def _number(self, what: str, value: float) -> Written:
        if not math.isfinite(value):
            raise DataError(f"{what[:40]} of the SBML model has no finite value: give it one")
        return repr(float(value)).removesuffix(".0"), ATOM if value >= 0 else SUM

    def _bounded(self, written: Written) -> Written:
        if len(written[0]) > MAX_CHARACTERS:
            raise DataError(
                f"the equations of the SBML model are longer than {MAX_CHARACTERS} characters: use a smaller one"
            )
        return written


def _inside(part: Written, least: int) -> str:
    return part[0] if part[1] >= least else f"({part[0]})"


def _joined(sign: str, binds: int, empty: str) -> Writer:
    def write(parts: list[Written]) -> Written:
        if len(parts) < 2:
            return parts[0] if parts else (empty, ATOM)
        return sign.join(_inside(part, binds) for part in parts).replace(" + -", " - "), binds

    return write


def _function(name: str) -> Writer:
    return lambda parts: (f"{name}({', '.join(text for text, _ in parts)})", ATOM)


def _minus(parts: list[Written]) -> Written:
    left = f"{_inside(parts[0], SUM)} - " if len(parts) == 2 else "-"
    return left + _inside(parts[-1], PRODUCT), SUM


def _divided(parts: list[Written]) -> Written:
    return f"{_inside(parts[0], PRODUCT)}/{_inside(parts[1], POWER)}", PRODUCT


def _power(parts: list[Written]) -> Written:
    return f"{_inside(parts[0], ATOM)}^{_inside(parts[1], ATOM)}", POWER


def _root(parts: list[Written]) -> Written:
    degree, inside = parts
    if degree[0] == "2":
        return f"sqrt({inside[0]})", ATOM
    return _power([inside, (f"1/{_inside(degree, ATOM)}", PRODUCT)])


def _writers(libsbml: ModuleType) -> dict[int, Writer]:
    """How each kind of node of a syntax tree is written."""
    written = {name: _function(head) for head, name in NODES.items() if head in FUNCTIONS} | {
        "AST_PLUS": _joined(" + ", SUM, "0"),
        "AST_TIMES": _joined("*", PRODUCT, "1"),
        "AST_MINUS": _minus,
        "AST_DIVIDE": _divided,
        "AST_POWER": _power,
        "AST_FUNCTION_POWER": _power,
        "AST_FUNCTION_ROOT": _root,
        "AST_FUNCTION_LOG": lambda parts: (f"log({parts[1][0]})/log({parts[0][0]})", PRODUCT),
        "AST_FUNCTION_MAX": _function("max"),
        "AST_FUNCTION_MIN": _function("min"),
        "AST_NAME_TIME": lambda parts: (TIME, ATOM),
        "AST_CONSTANT_PI": lambda parts: ("pi", ATOM),
        "AST_CONSTANT_E": lambda parts: ("exp(1)", ATOM),
    }
    return {getattr(libsbml, name): writer for name, writer in written.items()}

"""Docstrings. What the packages export says parameters, shapes, units, errors raised and an example that runs as a doctest; every public name says what it is
and every formula its source.

numpydoc's own validation knows neither shapes nor units nor which errors a body raises, and brings Sphinx along."""

from __future__ import annotations

import ast
import importlib
import inspect
import pkgutil
import re
import textwrap
from collections.abc import Iterator
from functools import cached_property
from types import ModuleType
from typing import Any, NamedTuple

import pydantic
import pytest
from all_cases import each

from basset.kernels import Floats
from saltation.bed import rebound
from saltation.effects import base, drag

FACES = ("basset", "saltation")  # what they export, and the plan that every rule hands out


def modules() -> Iterator[ModuleType]:
    """All modules whose name has no underscore, but the commands and what compiled code is made of."""
    for face in FACES:
        package = importlib.import_module(face)
        yield package
        for found in pkgutil.walk_packages(package.__path__, f"{face}."):
            parts = found.name.split(".")
            if not any(part.startswith("_") for part in parts) and parts[-1] not in ("cli", "api"):
                yield importlib.import_module(found.name)


MODULES = list(modules())
SECTIONS = ("Parameters", "Attributes", "Returns", "Yields", "Raises", "Notes", "References", "Examples")
NUMBER = re.compile(r"\b(float|complex|ArrayLike|Floats|Array|NDArray|ndarray|DataFrame|Dataset|Triple)\b")
ARRAY = re.compile(r"\b(ArrayLike|Floats|Array|NDArray|ndarray)\b")
LISTED = r"\([^()]*(?:,|\.\.\.|…)[^()]*\)"  # such as (n+1, ...) or (terms,)
SHAPE = re.compile(LISTED + r"|\bshapes?\b|\bscalar\b|\bnumber\b")
LETTERS = r"(?<![\w'’])(?:m|s|d|V|mm|ms|kg|rad)(?![a-zA-Z_'’])"  # no genitive; d² is one
UNIT = re.compile(LETTERS + r"|[u/]\*|°|\b(?:[Uu]nits?|[Dd]imensionless|relative to|(?:milli)?seconds?|degrees?|radians?|per cent|pixels|bytes)\b")
FORMULA = re.compile("[∫√∑Σπ∂]|[²³*·)]\\^\\(|= .*\\^")
SOURCE = re.compile(r"\((?:18|19|20)\d\d|\b(?:18|19|20)\d\d\b\)?|[Tt]hesis|[Tt]his library|Abramowitz")


PROPERTIES = (property, cached_property)
PROTOCOLS = (base.Force, base.Torque, drag.Law, rebound.Rebound)


class Name(NamedTuple):
    """A public function, class or method, with the classes it may inherit its documentation from."""

    path: str
    thing: Any
    owner: type | None
    module: ModuleType

    @property
    def docs(self) -> list[str]:
        """Its docstring and, for a method, those that it overrides or whose protocol it follows."""
        if self.owner is None:
            return [inspect.cleandoc(self.thing.__doc__ or "")]
        name = self.path.rpartition(".")[2]
        found = [vars(kind)[name] for kind in (*self.owner.__mro__, *PROTOCOLS) if name in vars(kind)]
        return [inspect.cleandoc(one.__doc__ or "") for one in found]

    @property
    def sections(self) -> dict[str, str]:
        """Sections by name; what an override does not say is as in the method it overrides."""
        merged: dict[str, str] = {}
        for doc in reversed(self.docs):
            merged |= split(doc)
        return merged


def split(doc: str) -> dict[str, str]:
    """The sections of a numpydoc docstring; what comes before the first one under the empty name."""
    pieces = re.split(rf"^({'|'.join(SECTIONS)})\n-{{3,}}\n", doc, flags=re.MULTILINE)
    return {"": pieces[0], **dict(zip(pieces[1::2], pieces[2::2], strict=True))}


def entries(section: str) -> dict[str, str]:
    """What a section of parameters says of each name; several names may share an entry."""
    found: dict[str, str] = {}
    for block in re.split(r"^(?=\S)", section, flags=re.MULTILINE):
        names = re.match(r"[*\w, …]+", block)
        for name in re.findall(r"\w+", names[0]) if names else ():
            found.setdefault(name, block)
    return found


def public(module: ModuleType) -> Iterator[Name]:
    """Functions and classes of `__all__`, or those that the module defines under a name without underscore, and their methods."""
    listed = getattr(module, "__all__", None)
    names = listed if listed is not None else [name for name in vars(module) if not name.startswith("_")]
    for name in names:
        found = getattr(module, name)
        thing = inspect.unwrap(found) if callable(found) else found
        if not (inspect.isclass(thing) or inspect.isfunction(thing)) or (listed is None and thing.__module__ != module.__name__):
            continue
        home = importlib.import_module(thing.__module__)
        yield Name(f"{thing.__module__}.{name}", thing, None, home)
        for kind in thing.__mro__ if inspect.isclass(thing) else ():
            if kind.__module__.partition(".")[0] in ("basset", "saltation"):
                yield from members(kind)


def members(kind: type) -> Iterator[Name]:
    """Public methods and properties that a class defines itself, and what it does when called."""
    for member, value in list(vars(kind).items()):
        thing = getattr(value, "__func__", value)
        if (not member.startswith("_") or member == "__call__") and (inspect.isfunction(thing) or isinstance(thing, PROPERTIES)):
            yield Name(f"{kind.__module__}.{kind.__qualname__}.{member}", thing, kind, importlib.import_module(kind.__module__))


NAMES = list({name.path: name for module in MODULES for name in public(module)}.values())
EXPORTED = [name for face in FACES for name in public(importlib.import_module(face))]
EXPORTED += [name for name in public(importlib.import_module("basset.streaming")) if "Plan" in name.path.split(".")]
FACE = list({name.path: name for name in EXPORTED}.values())
CALLABLES = [name for name in FACE if not isinstance(name.thing, PROPERTIES)]


def getter(thing: Any) -> Any:
    """The function behind a property; anything else as it is."""
    return thing.fget if isinstance(thing, property) else thing.func if isinstance(thing, cached_property) else thing


def has_unit(text: str) -> bool:
    """Whether a unit is named outside of a shape."""
    return UNIT.search(re.sub(LISTED, "", text)) is not None


def arguments(name: Name) -> dict[str, str]:
    """Parameter -> annotation, as written; the fields of a class that says so itself (tables of a scene describe each field)."""
    if name.thing in PROTOCOLS or (inspect.isclass(name.thing) and issubclass(name.thing, (pydantic.BaseModel, BaseException))):
        return {}
    try:
        found = inspect.signature(name.thing).parameters.values()
    except ValueError:
        return {}
    return {each.name: str(each.annotation) for each in found if each.name not in ("self", "cls") and not each.name.startswith("_")}


def raised(name: Name) -> set[str]:
    """Names of the errors in the `raise` statements of a body, and those of the checks it calls."""
    bodies = [name.thing]
    if inspect.isclass(name.thing):
        bodies = [vars(name.thing)[each] for each in ("__init__", "__post_init__", "__new__") if inspect.isfunction(vars(name.thing).get(each))]
        bodies = [body for body in bodies if body.__code__.co_filename == name.module.__file__]
    found = set()
    for body in bodies:
        for node in ast.walk(ast.parse(textwrap.dedent(inspect.getsource(getter(body))))):
            if isinstance(node, ast.Raise) and node.exc is not None:
                found.add(ast.unparse(node.exc.func if isinstance(node.exc, ast.Call) else node.exc).rpartition(".")[2])
            elif isinstance(node, ast.Call) and re.fullmatch(r"_validate\.(?!shown|suggestion)\w+", ast.unparse(node.func)):
                found |= {"ValueError", "TypeError"}
    never_seen = {"NotImplementedError", "AssertionError"}  # of a method that every subclass has, and of a broken invariant
    return {error for error in found if error[0].isupper()} - never_seen


def test_the_names_of_the_packages_are_among_them():
    paths = {id(name.thing) for name in FACE}
    wanted = [getattr(package, name) for package in map(importlib.import_module, FACES) for name in package.__all__ if name != "SCHEMES"]
    assert all(id(thing) in paths for thing in wanted)
    assert len(FACE) > 80 and len(NAMES) > 300


@each("name", NAMES)
def test_says_what_it_is(name):
    assert name.docs[0].strip()
    assert not name.docs[0].startswith(f"{name.thing.__name__}(" if not isinstance(name.thing, PROPERTIES) else "(property)")  # a dataclass's own


@each("name", CALLABLES)
def test_every_parameter_is_documented_with_its_shape_and_unit(name):
    sections = name.sections
    given = arguments(name)
    told = (entries(sections.get("Attributes", "")) if inspect.isclass(name.thing) else {}) | entries(sections.get("Parameters", ""))
    assert [each for each in given if each not in told] == []
    if not inspect.isclass(name.thing):
        assert [each for each in entries(sections.get("Parameters", "")) if each not in given] == []
    assert [each for each, kind in given.items() if NUMBER.search(kind) and not has_unit(told[each])] == []
    assert [each for each, kind in given.items() if ARRAY.search(kind) and not SHAPE.search(told[each])] == []


@each("name", [name for name in CALLABLES if not inspect.isclass(name.thing)])
def test_what_comes_back_is_documented_with_its_shape_and_unit(name):
    kind = str(inspect.signature(name.thing).return_annotation)
    if kind == "None":
        return
    sections = name.sections
    told = sections.get("Returns", sections.get("Yields", ""))
    assert told.strip()
    assert not NUMBER.search(kind) or has_unit(told)
    assert not ARRAY.search(f"{kind} {told.splitlines()[0]}") or SHAPE.search(told)


@each("name", [name for name in FACE if isinstance(name.thing, PROPERTIES)])
def test_a_property_has_its_unit(name):
    kind = str(inspect.signature(getter(name.thing)).return_annotation)
    assert not NUMBER.search(kind) or has_unit("\n".join(name.docs))


@each("name", FACE)
def test_errors_are_documented(name):
    told = name.sections.get("Raises", "")
    assert sorted(error for error in raised(name) if error not in told) == []


@each("name", CALLABLES)
def test_has_an_example(name):
    if name.owner is None:
        assert ">>>" in name.docs[0]
        return
    member = name.path.rpartition(".")[2]
    use = r">>>.*\w\(" if member == "__call__" else rf"\.{member}\("
    classes = [inspect.cleandoc(kind.__doc__ or "") for kind in name.owner.__mro__[:-1]]
    assert any(">>>" in doc for doc in name.docs) or any(
        re.search(use, example) for doc in classes for example in re.findall(r"^(?:>>>|\.\.\.) .*$", doc, re.M)
    )


@each("name", NAMES)
def test_a_formula_has_a_source(name):
    if FORMULA.search(name.docs[0]):
        around = [*name.docs, inspect.getdoc(name.owner) or "" if name.owner else "", name.module.__doc__ or ""]
        assert any(SOURCE.search(text) for text in around)


@each("name", [name for name in NAMES if inspect.isclass(name.thing) and issubclass(name.thing, pydantic.BaseModel)])
def test_every_field_of_a_scene_is_described_with_its_unit(name):
    own = [each for each in vars(name.thing).get("__annotations__", {}) if each in name.thing.model_fields]
    told = {each: name.thing.model_fields[each].description or "" for each in own}
    assert [each for each in own if not told[each]] == []
    kinds = {each: str(vars(name.thing)["__annotations__"][each]) for each in own}
    assert [each for each in own if NUMBER.search(kinds[each]) and not has_unit(told[each])] == []


class TestTheRulesBite:
    """A docstring that lacks one thing fails the one test that asks for it."""

    GOOD = """√t of many times.

    Parameters
    ----------
    t : array_like (n,), seconds

    Returns
    -------
    ndarray (n,), s^(1/2)

    Raises
    ------
    ValueError
        For a negative time.

    References
    ----------
    This library.

    Examples
    --------
    >>> 1 + 1
    2
    """

    @staticmethod
    def root(t: Floats) -> Floats:
        if t.min() < 0.0:
            raise ValueError
        return t**0.5

    def named(self, doc: str) -> Name:
        self.root.__doc__ = doc
        return Name("here.root", self.root, None, importlib.import_module("math"))

    CHECKS = (
        test_says_what_it_is,
        test_every_parameter_is_documented_with_its_shape_and_unit,
        test_what_comes_back_is_documented_with_its_shape_and_unit,
        test_errors_are_documented,
        test_has_an_example,
        test_a_formula_has_a_source,
    )

    @pytest.mark.parametrize(
        ("word", "other", "fails"),
        [
            ("", "", None),
            ("t :", "x :", test_every_parameter_is_documented_with_its_shape_and_unit),
            ("(n,), seconds", "seconds", test_every_parameter_is_documented_with_its_shape_and_unit),
            ("(n,), seconds", "(n,)", test_every_parameter_is_documented_with_its_shape_and_unit),
            ("(n,), s^(1/2)", "(n,)", test_what_comes_back_is_documented_with_its_shape_and_unit),
            ("ndarray (n,), s^(1/2)", "ndarray, s^(1/2)", test_what_comes_back_is_documented_with_its_shape_and_unit),
            ("ValueError", "Error", test_errors_are_documented),
            (">>>", "$", test_has_an_example),
            ("This library.", "Well known.", test_a_formula_has_a_source),
            (GOOD, "", test_says_what_it_is),
        ],
        ids=lambda value: getattr(value, "__name__", str(value)[:20]),
    )
    def test_one_by_one(self, word, other, fails):
        assert word in self.GOOD
        name = self.named(self.GOOD.replace(word, other, 1))
        for check in self.CHECKS:
            if check is fails or (fails is test_says_what_it_is and check is not test_a_formula_has_a_source):
                with pytest.raises(AssertionError):
                    check.__wrapped__(name)
            else:
                check.__wrapped__(name)

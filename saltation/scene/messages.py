"""A mistake in a scene as one sentence."""

from __future__ import annotations

from typing import Any

from pydantic import ValidationError

from basset import _validate


def sentence(error: ValidationError, scene: Any) -> str:
    """The first mistake of a scene, `scene` being its class, in one sentence: which field, what came, what would be right."""
    found = error.errors()[0]
    place, kind, given, context = [str(part) for part in found["loc"]], found["type"], found["input"], found.get("ctx", {})
    if kind == "extra_forbidden":
        return f"{'.'.join(place)} is not a field of a scene{_validate.suggestion(place[-1], _fields(scene, place[:-1]))}"
    if kind == "value_error":
        return _own_words(scene, place, str(context["error"]))
    field, text = _field(scene, place)
    path = ".".join(field)
    if kind == "missing":
        return f"{path} is missing ({text})"
    right, hint = RIGHT.get(kind, ""), ""
    if kind == "literal_error":
        right = f"one of {context['expected']}"
        options = [word.strip(" '") for word in context["expected"].replace(" or ", ",").split(",")]
        hint = _validate.suggestion(given, options) if isinstance(given, str) and given not in options else ""
    right = right.format(**context) or KINDS.get(kind.split("_")[0], found["msg"])
    note = f" ({text})" if text and not hint and not text.startswith(right) else ""
    return f"{path} must be {right}, got {_validate.shown(given)}{hint}{note}"


RIGHT = {  # what would be right, by pydantic's kind of mistake
    "greater_than": "greater than {gt:g}",
    "greater_than_equal": "{ge:g} or greater",
    "less_than": "less than {lt:g}",
    "less_than_equal": "{le:g} or less",
    "finite_number": "a finite number",
    "too_short": "three numbers",
    "too_long": "three numbers",
}
KINDS = {
    "float": "a number",
    "int": "a whole number",
    "bool": "true or false",
    "string": "a word in quotes",
    "list": "a list",
    "model": "a table",
    "dict": "a table",
}


def _own_words(scene: Any, place: list[str], text: str) -> str:
    """A validator's message, its field named once."""
    path = ".".join(_field(scene, place)[0])
    if not path:
        return text
    return f"{path} {text}" if text.startswith(("must", "needs")) else f"{path}.{text}"


def _fields(table: Any, place: list[str]) -> list[str]:
    """The fields of the table at `place`."""
    for part in place:
        table = _table(table.model_fields[part].annotation)
    return list(table.model_fields)


def _field(table: Any, place: list[str]) -> tuple[list[str], str]:
    """The part of `place` that names a field, without its alternatives and elements, and that field's description."""
    text = ""
    for depth, part in enumerate(place):
        if part not in getattr(table, "model_fields", ()):
            return place[:depth], text
        field = table.model_fields[part]
        table, text = _table(field.annotation), field.description or ""
    return place, text


def _table(annotation: Any) -> Any:
    """The table behind an annotation such as `Bed | None`."""
    return next((kind for kind in getattr(annotation, "__args__", ()) if kind is not type(None)), annotation)

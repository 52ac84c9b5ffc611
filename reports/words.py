"""Numbers as people write them, and templates that ask for them: `{head[steps]:n}` is a whole number in groups, see `FORMS`."""

from __future__ import annotations

import math
import string
from collections.abc import Callable, Iterable, Sequence
from typing import Any

Record = dict[str, Any]

NEAR = 1.3  # times within this factor are not told apart: timings on shared machines scatter


def short(value: float, digits: int = 0) -> str:
    """A small number in powers of ten, without the exponent's leading zero."""
    if not math.isfinite(value):
        return "–"
    mantissa, exponent = f"{value:.{digits}e}".split("e")
    return f"{mantissa}e{int(exponent)}"


def grouped(number: float) -> str:
    """A whole number in groups of three."""
    return f"{number:,.0f}".replace(",", " ")


def factor(ratio: float) -> str:
    """A ratio with two digits."""
    return f"{ratio:.2g}" if ratio < 100 else grouped(float(f"{ratio:.2g}"))


def percent(share: float) -> str:
    """A share with two digits."""
    return f"{100.0 * share:.2g} %"


def signed(value: float, digits: int = 0) -> str:
    """A number with its sign, as printers set it."""
    return f"{value:+.{digits}f}".replace("-", "−")


def seconds(value: float | None) -> str:
    """A time: three digits, whole nanoseconds."""
    if value is None:
        return "–"
    for size, unit in ((1.0, "s"), (1e-3, "ms"), (1e-6, "µs")):
        if value >= size:
            return f"{value / size:.3g} {unit}"
    return f"{1e9 * value:.0f} ns"


def storage(value: float) -> str:
    """A number of bytes."""
    for size, unit in ((1e9, "GB"), (1e6, "MB"), (1e3, "kB")):
        if value >= size:
            return f"{value / size:.3g} {unit}"
    return f"{value:.0f} B"


def span(values: Iterable[float], form: str = "{:.0f}") -> str:
    """The smallest and the largest, once if they look the same."""
    found = list(values)
    return " to ".join(dict.fromkeys((form.format(min(found)), form.format(max(found))))).replace("-", "−")


def listed(words: Sequence[str], none: str = "nothing") -> str:
    """Some words in a sentence."""
    return none if not words else words[0] if len(words) == 1 else f"{', '.join(words[:-1])} and {words[-1]}"


FORMS: dict[str, Callable[[Any], str]] = {"n": grouped, "x": factor, "%": percent, "s": seconds, "B": storage, "e": short, "e1": lambda value: short(value, 1)}


class Words(string.Formatter):
    """`str.format` that knows FORMS, and takes what a computed number says about itself in templates."""

    def format_field(self, value: Any, format_spec: str) -> Any:
        """One field."""
        return FORMS[format_spec](value) if format_spec in FORMS else super().format_field(value, format_spec)


def of(records: Iterable[Record], **wanted: Any) -> list[Record]:
    """Records with these values, in the order measured."""
    return [record for record in records if all(record[key] == value for key, value in wanted.items())]


def select(records: Iterable[Record], **wanted: Any) -> list[Record]:
    """The same, by number of steps."""
    return sorted(of(records, **wanted), key=lambda record: record["n"])


def reaches(records: Sequence[Record], tolerance: float, error: str = "error_max") -> Record | None:
    """The first timed record (one scheme, by n) from which on no error exceeds the tolerance."""
    timed = [record for record in records if record["seconds"] is not None and record[error] is not None]
    first = None
    for record in reversed(timed):
        if record[error] > tolerance:
            break
        first = record
    return first

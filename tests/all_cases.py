"""Many cases in one test: as tests of their own, ten thousand small ones cost more than what they test."""

from __future__ import annotations

import functools
import inspect
from collections.abc import Callable, Iterable
from typing import Any

SHOWN = 5  # failures, with the cases they belong to


def each(names: str, values: Iterable[Any]) -> Callable[[Any], Any]:
    """Like `pytest.mark.parametrize`, within one test: all cases are run, those that fail are named."""
    wanted, cases = [name.strip() for name in names.split(",")], list(values)
    assert cases

    def decorate(test: Callable[..., None]) -> Callable[..., None]:
        @functools.wraps(test)
        def run(*arguments: Any, **given: Any) -> None:
            failed = []
            for case in cases:
                here = dict(zip(wanted, case if len(wanted) > 1 else (case,), strict=True))
                try:
                    test(*arguments, **given, **here)
                except Exception as error:
                    error.add_note(f"with {here}")
                    failed.append(error)
            if failed:
                raise failed[0] if len(failed) == 1 else ExceptionGroup(f"{len(failed)} of {len(cases)} cases", failed[:SHOWN])

        signature = inspect.signature(test)
        run.__signature__ = signature.replace(parameters=[each for each in signature.parameters.values() if each.name not in wanted])  # type: ignore[attr-defined]
        return run

    return decorate

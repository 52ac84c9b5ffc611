"""The page reports/saltation.md: where mean jumps lie, and what each law, effect and choice does to them. A file for some of its sections each."""

from __future__ import annotations

from reports.saltation import blind_test, effects, envelope, impacts, jumps, ranks, thesis
from reports.site.page import Page, fill, footer
from reports.words import Record

SUITES = ("blind", "saltation")


def build(data: dict[str, Record]) -> str:
    """The page reports/saltation.md."""
    found = data["saltation"]
    own = blind_test.fields(data["blind"])
    for section in (thesis, impacts, envelope, effects, jumps, ranks):
        own |= section.fields(found)
    return fill("saltation.md", found=found, **own, footer=footer({name: data[name] for name in SUITES}))


PAGE = Page("saltation", build, SUITES)

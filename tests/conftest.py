"""Random tests draw the same examples on every machine; `make sweep` draws fifty times as many, anew each time.

A test that needs more or fewer takes a share: `@settings(max_examples=10 * settings().max_examples)`.
"""

import gc
import os
import sys

import pytest
from hypothesis import settings

# a hundred processes are started here: where bytecode is not kept, each of them compiles the sources of pandas, SciPy and numba anew
os.environ.pop("PYTHONDONTWRITEBYTECODE", None)
sys.dont_write_bytecode = False

# small matrices: threads of BLAS wait for each other on cores that other tests keep busy, a quarter of the time of a fit
for name in ("OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "OMP_NUM_THREADS"):
    os.environ.setdefault(name, "1")

settings.register_profile("repeatable", max_examples=20, deadline=None, derandomize=True)
settings.register_profile("sweep", max_examples=1000, deadline=None)
settings.load_profile("repeatable")


@pytest.fixture
def coarse(monkeypatch):
    """Bitmaps of few dots, for pages that are built to be read here."""
    from matplotlib.figure import Figure

    save = Figure.savefig
    monkeypatch.setattr(Figure, "savefig", lambda figure, *names, **options: save(figure, *names, **options | ({"dpi": 20} if "dpi" in options else {})))


def pytest_collection_modifyitems(items):
    """The simulator's tests first: they are the longest, and what they compile is not what the others compile."""
    items.sort(key=lambda item: "saltation" not in item.nodeid)


def pytest_collection_finish():
    """Ten thousand tests stay to the end: the collector of garbage need not look through them again and again."""
    gc.collect()
    gc.freeze()

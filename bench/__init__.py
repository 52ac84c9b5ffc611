"""Measurements: what accuracy costs in time. `python -m bench [suite …]` writes JSON; `reports` reads it.

Everything is measured on one core: a second thread of the linear algebra library gains little on vectors that fit into
the cache, and on a machine that is not idle it makes a dot product wait for milliseconds.
"""

import os

for _name in ("OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "OMP_NUM_THREADS"):
    os.environ.setdefault(_name, "1")

"""Measurements: what accuracy costs in time. `python -m bench [suite …]` writes JSON; `reports` reads it."""

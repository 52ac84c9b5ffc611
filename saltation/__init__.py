"""Saltation: sand grains hopping over a river bed, with the history force of `basset`."""

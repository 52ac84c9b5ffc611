"""Spheres in a given flow: the equation of Maxey & Riley with its history force, flows on a grid."""

from basset.particles.flow import Flow
from basset.particles.motion import maxey_riley

__all__ = ["Flow", "maxey_riley"]

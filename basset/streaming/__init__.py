"""The history as a stream: one sample at a time, in constant memory where the rule allows it."""

from basset.streaming.plan import LONG_WINDOW, Plan
from basset.streaming.slip import VaryingPlan, VaryingState
from basset.streaming.state import LONGEST, State

__all__ = ["LONGEST", "LONG_WINDOW", "Plan", "State", "VaryingPlan", "VaryingState"]

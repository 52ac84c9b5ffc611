"""`CloudResult`, the earlier name of the result of many grains, for one release more."""

from saltation.results.result import Result as CloudResult

__all__ = ["CloudResult"]

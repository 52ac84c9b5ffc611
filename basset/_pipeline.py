"""A shorter compiler pipeline: without the passes that our functions do not need.

Imported by `basset._compile` once numba is there.
"""

from __future__ import annotations

from typing import Any

from numba.core.compiler import CompilerBase, DefaultPassBuilder

# passes for closures, `with`, comprehensions, array expressions, literal_unroll and inlining before typing: our functions have none
WITHOUT = (
    "WithLifting",
    "InlineClosureLikes",
    "InlineInlinables",
    "FindLiterallyCalls",
    "LiteralUnroll",
    "LiteralPropagationSubPipelinePass",
    "InlineOverloads",
    "NopythonRewrites",
)


class Plain(CompilerBase):
    """numba's pipeline without the passes above, each of which visits all of a function."""

    def define_pipelines(self) -> list[Any]:
        """One pipeline."""
        found = DefaultPassBuilder.define_nopython_pipeline(self.state)  # type: ignore[no-untyped-call]  # numba has no types
        found.passes = [made for made in found.passes if made[0].__name__ not in WITHOUT]
        found.finalize()
        return [found]

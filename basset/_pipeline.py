"""How the compiler takes our functions: without the passes that find nothing in them.

Imported by `basset._compile` once numba is there.
"""

from __future__ import annotations

from typing import Any

from numba.core.compiler import CompilerBase, DefaultPassBuilder

# what looks for closures, `with`, comprehensions, expressions of arrays, literal_unroll and what is inlined before it is typed: there are none
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

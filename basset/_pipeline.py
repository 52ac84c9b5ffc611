"""How the compiler takes our functions: without the passes that find nothing in them and without what they note for nobody.

Imported by `basset._compile` once numba is there.
"""

from __future__ import annotations

import importlib
from typing import Any

from numba.core.compiler import CompilerBase, DefaultPassBuilder

from basset._compile import UNDER_WAY

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


postproc, targetconfig, transforms = (importlib.import_module(f"numba.core.{name}") for name in ("postproc", "targetconfig", "transforms"))
process, differ = postproc.PostProcessor.run, targetconfig.TargetConfig.__eq__


def run(self: Any, emit_dels: bool = False, extend_lifetimes: bool = False) -> None:
    """numba's, without the variables alive at each block's entry after every pass: generators and object mode alone ask for them."""
    function = self.func_ir
    if function.is_generator or not (UNDER_WAY and UNDER_WAY[0][1]):
        process(self, emit_dels=emit_dels, extend_lifetimes=extend_lifetimes)
        return
    function.blocks = transforms.canonicalize_cfg(function.blocks)
    function.variable_lifetime, function.generator_info = postproc.VariableLifetime(function.blocks), None
    if emit_dels:
        self._insert_var_dels(extend_lifetimes=extend_lifetimes)


def equal(self: Any, other: Any) -> Any:
    """numba's: options that were set alike are alike, without a look at each; asked at every call that is typed."""
    return (type(self) is type(other) and self._values == other._values) or differ(self, other)


def coarse(self: Any) -> int:
    """As coarse as numba's, which hashes the names of all options."""
    return hash(type(self))


postproc.PostProcessor.run, targetconfig.TargetConfig.__eq__, targetconfig.TargetConfig.__hash__ = run, equal, coarse

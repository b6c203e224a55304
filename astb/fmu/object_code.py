"""What numba compiles as object code that a C compiler can link, without a symbol of Python in it."""

import platform
from collections.abc import Callable
from pathlib import Path
from typing import Any, Final

#: What every processor of the architecture can do.
_BASELINE: Final = {"x86_64": "x86-64", "aarch64": "generic"}


def write_object(
    function: Callable[..., Any], types: tuple[Any, ...], symbol: str, to: Path, *, native: bool
) -> None:
    """Compile ``function`` for arguments of these ``types`` as ``symbol``.

    It runs on any processor of this architecture or, ``native``, on those like this one. Its calling convention is
    numba's: a place for the result, one for the exception, then the arguments, each array as owner, parent, number and
    size of elements, address, shape, strides.
    """
    import llvmlite.binding as llvm
    import numba

    # Without numba's runtime and without wrappers for Python nothing is left that would need an interpreter.
    options: Any = {"_nrt": False, "no_cpython_wrapper": True, "no_cfunc_wrapper": True}
    compiled: Any = numba.njit(fastmath=False, error_model="numpy", **options)(function)
    compiled.compile(types)
    made = compiled.overloads[types]
    module = llvm.parse_assembly(made.library.get_llvm_str())
    for variable in module.global_variables:
        if not variable.is_declaration:
            variable.linkage = "internal"
    entry = module.get_function(made.fndesc.llvm_func_name)
    entry.name, entry.visibility = symbol, "hidden"
    for one in module.functions:
        if not one.is_declaration and one.name != symbol:
            one.linkage = "internal"
    target = llvm.Target.from_triple(llvm.get_process_triple())
    cpu = llvm.get_host_cpu_name() if native else _BASELINE.get(platform.machine(), "generic")
    features = llvm.get_host_cpu_features().flatten() if native else ""
    emitter = target.create_target_machine(
        cpu=cpu, features=features, opt=3, reloc="pic", codemodel="default"
    )
    to.write_bytes(emitter.emit_object(module))

"""C functions with addresses known only at run time, such as those of a loaded library.

Compiled code calls them without the interpreter. With ``NUMBA_DISABLE_JIT=1`` ctypes calls them.
"""

import ctypes
from collections.abc import Callable
from typing import Any, Final

from llvmlite import ir
from numba import config, types
from numba.extending import intrinsic

#: Types of arguments: of ctypes, of numba, and of the C function.
INT: Final = ctypes.c_int, types.int64, ir.IntType(32)
WORD: Final = ctypes.c_ssize_t, types.int64, ir.IntType(64)
NUMBER: Final = ctypes.c_double, types.float64, ir.DoubleType()


def at_address(*arguments: Any) -> Any:
    """Return ``f(address, values)``, which calls the C function at ``address`` with a tuple of values and returns its
    int.

    ``arguments`` are the types of the values.
    """
    if config.DISABLE_JIT:  # type: ignore[attr-defined]
        form = ctypes.CFUNCTYPE(ctypes.c_int, *(one[0] for one in arguments))

        def called(address: int, given: Any) -> int:
            return int(form(int(address))(*given))

        return called
    return intrinsic(_by_address(arguments))


def _by_address(arguments: Any) -> Callable[..., Any]:
    together: Any = types.Tuple
    signature = types.int64(types.int64, together([one[1] for one in arguments]))
    form = ir.FunctionType(ir.IntType(32), [one[2] for one in arguments])

    def typed(_: Any, address: Any, given: Any) -> Any:
        del address, given

        def generated(__: Any, builder: Any, ___: Any, values: Any) -> Any:
            function = builder.inttoptr(values[0], form.as_pointer())
            parts = [builder.extract_value(values[1], place) for place in range(len(arguments))]
            narrow = [
                builder.trunc(part, to) if isinstance(to, ir.IntType) and to.width < 64 else part
                for part, (_, _, to) in zip(parts, arguments, strict=True)
            ]
            return builder.sext(builder.call(function, narrow), ir.IntType(64))

        return signature, generated

    return typed

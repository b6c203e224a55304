"""A small expression over the points of a signal: numbers, names, + - * /, parentheses, min, max and abs.

It is evaluated as a tree and never executed as Python code, because a wiring file is data.
"""

from __future__ import annotations

import ast
import math
import operator
from collections.abc import Callable, Sequence
from typing import Final

from bench_protocol.suggestion import did_you_mean
from drivers.errors import WiringError

#: Returns the value of an expression for the values of its names, in their order.
Combine = Callable[[Sequence[float]], float]

_BINARY: Final[dict[type[ast.operator], Callable[[float, float], float]]] = {
    ast.Add: operator.add,
    ast.Sub: operator.sub,
    ast.Mult: operator.mul,
    ast.Div: operator.truediv,
}
_UNARY: Final[dict[type[ast.unaryop], Callable[[float], float]]] = {
    ast.UAdd: operator.pos,
    ast.USub: operator.neg,
}
_CALLS: Final[dict[str, Callable[..., float]]] = {"min": min, "max": max, "abs": abs}
_RIGHT: Final = "use numbers, names, + - * /, parentheses, min, max and abs"
#: Longest text of an expression: a very long one would exhaust the stack.
_LENGTH_MAX: Final = 500


def expression(where: str, text: str, names: Sequence[str]) -> Combine:
    """Return the function of the values of ``names`` that ``text`` describes; a division by 0 gives NaN.

    Raises WiringError, which begins with ``where``, for an unknown name and for anything but arithmetic.
    """
    if len(text) > _LENGTH_MAX:
        raise WiringError(
            f"{where} has {len(text)} characters; at most {_LENGTH_MAX} are allowed, so use a function"
        )
    try:
        tree = ast.parse(text.strip(), mode="eval")
    except (SyntaxError, ValueError):
        raise WiringError(f"{where} = {text!r} is not an expression; {_RIGHT}") from None
    value = _Reader(f"{where} = {text!r}", tuple(names)).read(tree.body)

    def combine(values: Sequence[float]) -> float:
        try:
            return value(values)
        except (ZeroDivisionError, OverflowError):
            return math.nan

    return combine


class _Reader:
    """Converts the nodes of a tree to functions of the values."""

    def __init__(self, where: str, names: tuple[str, ...]) -> None:
        self._where, self._names = where, names

    def read(self, node: ast.expr) -> Combine:
        """Return ``node`` as a function of the values."""
        match node:
            case ast.Constant(value=int() | float() as number) if not isinstance(number, bool):
                constant = float(number)
                return lambda values: constant
            case ast.Name(id=name):
                if name not in self._names:
                    raise WiringError(
                        f"{self._where}: unknown name {name!r}; {did_you_mean(name, self._names)}"
                    )
                place = self._names.index(name)
                return lambda values: values[place]
            case ast.BinOp(left=left, op=op, right=right) if type(op) in _BINARY:
                apply, a, b = _BINARY[type(op)], self.read(left), self.read(right)
                return lambda values: apply(a(values), b(values))
            case ast.UnaryOp(op=sign, operand=operand) if type(sign) in _UNARY:
                turn, inner = _UNARY[type(sign)], self.read(operand)
                return lambda values: turn(inner(values))
            case ast.Call(func=ast.Name(id=name), args=[_, *_] as given, keywords=[]) if name in _CALLS:
                if (name == "abs" and len(given) != 1) or (name != "abs" and len(given) < 2):
                    raise WiringError(
                        f"{self._where}: abs needs one value, min and max need two or more; {name} has "
                        f"{len(given)}"
                    )
                call, parts = _CALLS[name], [self.read(one) for one in given]
                return lambda values: call(*[part(values) for part in parts])
        raise WiringError(f"{self._where}: {ast.unparse(node)!r} is not allowed here; {_RIGHT}")

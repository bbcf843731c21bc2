"""Formulas that users write: one expression of numbers, names and functions, read against a list of what is allowed.

The cost of a study and the predictions of a mission that are formulas have this grammar. Nothing of Python is executed:
the text is parsed, every node must be of a kind named here, and the tree is walked with numpy. It takes floats, complex
numbers and arrays, so that `partials` gets exact derivatives by the complex step; where the real part leaves the domain
of a function (the root of a negative number) the value is nan, for complex arguments too.
"""

import ast
import re
import warnings
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from difflib import get_close_matches
from typing import Any

import numpy as np

from nebosvod.errors import InputError, printable

MAX_LETTERS, MAX_NODES, MAX_DEPTH = 1000, 250, 40
STEP = 1e-30  # of the complex step: its square is lost beside any double
CONSTANTS: Mapping[str, float] = {"pi": float(np.pi)}
HINT = "a formula has numbers, names, + - * / ^, brackets and functions such as sqrt(x)"
Value = Any  # float, complex, or an array of either


def _inside(function: Callable[[Value], Value], wrong: Callable[[Value], Value]) -> Callable[[Value], Value]:
    """A function that is nan where the real part of its argument is outside its domain."""

    def found(x: Value) -> Value:
        return np.where(wrong(np.real(x)), np.nan, function(x))

    return found


def _absolute(x: Value) -> Value:
    return np.where(np.real(x) < 0.0, -np.asarray(x), x)


def _root_of_squares(*parts: Value) -> Value:
    """Analytic, unlike numpy's hypot, which knows no complex numbers; scaled, so that squares do not overflow."""
    largest: Value = np.max([np.abs(part) for part in np.broadcast_arrays(*parts)], axis=0)
    size = np.where(largest > 0.0, largest, 1.0)
    return size * np.sqrt(sum((np.asarray(part) / size) ** 2 for part in parts))


def _arc_tangent_2(y: Value, x: Value) -> Value:
    """Angle of (x, y): of the smaller ratio, which has the derivatives of both."""
    steep = np.abs(np.real(y)) > np.abs(np.real(x))
    bottom: Value = np.where(steep, y, x)
    top: Value = np.where(steep, x, y)
    slope = np.arctan(top / np.where(bottom == 0.0, 1.0, bottom))
    value = np.arctan2(np.real(y), np.real(x))
    moved = np.where(steep, -slope, slope)
    return value + 1j * np.imag(moved) if np.iscomplexobj(moved) else value


def _least(*parts: Value) -> Value:
    found = parts[0]
    for part in parts[1:]:
        found = np.where(np.real(part) < np.real(found), part, found)
    return found


def _largest(*parts: Value) -> Value:
    return -_least(*(-np.asarray(part) for part in parts))


def _power(x: Value, n: Value) -> Value:
    real, exponent = np.real(x), np.real(n)
    root = (real < 0.0) & (exponent != np.round(exponent))
    return np.where(root, np.nan, np.power(np.asarray(x) * 1.0, n))


def _outside_one(x: Value) -> Value:
    return np.abs(x) > 1.0


# by name: the function, fewest and most arguments
FUNCTIONS: Mapping[str, tuple[Callable[..., Value], int, int]] = {
    "sqrt": (_inside(np.sqrt, lambda x: x < 0.0), 1, 1),
    "exp": (np.exp, 1, 1),
    "log": (_inside(np.log, lambda x: x < 0.0), 1, 1),
    "log10": (_inside(lambda x: np.log(x) / np.log(10.0), lambda x: x < 0.0), 1, 1),
    "sin": (np.sin, 1, 1),
    "cos": (np.cos, 1, 1),
    "tan": (np.tan, 1, 1),
    "asin": (_inside(np.arcsin, _outside_one), 1, 1),
    "acos": (_inside(np.arccos, _outside_one), 1, 1),
    "atan": (np.arctan, 1, 1),
    "atan2": (_arc_tangent_2, 2, 2),
    "hypot": (_root_of_squares, 2, 9),
    "abs": (_absolute, 1, 1),
    "min": (_least, 2, 9),
    "max": (_largest, 2, 9),
}
OPERATORS: Mapping[type, Callable[[Value, Value], Value]] = {
    ast.Add: np.add,
    ast.Sub: np.subtract,
    ast.Mult: np.multiply,
    ast.Div: np.true_divide,
    ast.Pow: _power,
}


@dataclass(frozen=True, slots=True, eq=False)
class Expression:
    """A formula that was read.

    Attributes
    ----------
    text : as it was written.
    names : of the values it needs, in the order of the text, each once.
    """

    text: str
    names: tuple[str, ...]
    _tree: ast.expr
    _known: Mapping[str, str]

    def __call__(self, values: Mapping[str, Value]) -> Value:
        """Its value for the values of its names: floats, complex numbers, or arrays that numpy broadcasts."""
        with np.errstate(all="ignore"):
            found = np.asarray(self._value(self._tree, values))
        return found if found.ndim else found[()]

    def partials(self, values: Mapping[str, float]) -> dict[str, float]:
        """Derivatives by each of `names` at some real values, by the complex step.

        References
        ----------
        Squire, Trapp 1998, SIAM Review 40, 110, eq. 3.
        """
        found = {}
        for name in self.names:
            scale = abs(values[name]) or 1.0
            moved = self({**values, name: complex(values[name], STEP * scale)})
            found[name] = float(np.imag(moved) / (STEP * scale)) if np.isfinite(np.real(moved)) else float("nan")
        return found

    def _value(self, node: ast.expr, values: Mapping[str, Value]) -> Value:
        if isinstance(node, ast.Constant):
            return float(node.value)  # type: ignore[arg-type]
        if isinstance(node, ast.Name | ast.Attribute):
            word = _word(node)
            return values[self._known[word]] if word in self._known else CONSTANTS[word]
        if isinstance(node, ast.UnaryOp):
            operand = np.asarray(self._value(node.operand, values))
            return -operand if isinstance(node.op, ast.USub) else operand
        if isinstance(node, ast.BinOp):
            return OPERATORS[type(node.op)](self._value(node.left, values), self._value(node.right, values))
        if isinstance(node, ast.Call):
            return FUNCTIONS[_word(node.func)][0](*(self._value(one, values) for one in node.args))
        raise TypeError(f"a formula with a {type(node).__name__}")  # `read_expression` has let none through


def as_word(name: str) -> str:
    """A name as it stands in a formula: `target plane` is `target_plane`."""
    return re.sub(r"[^\w.]", "_", name)


def read_expression(text: Any, known: Sequence[str]) -> Expression:
    """Read a formula.

    Parameters
    ----------
    text : such as `3 * noise^-0.5 + 0.1 * sqrt(position)`; a name with blanks stands with `_` in their place, or alone.
    known : the names that it may have.

    Raises
    ------
    InputError
        If it is none, too long, or has a name that is not known; says where in the text, and what is allowed.
    """
    if isinstance(text, int | float) and not isinstance(text, bool):
        text = repr(text)
    if not isinstance(text, str):
        raise InputError(f"needs a formula as text (got {printable(str(text))[:60]}); {HINT}")
    words = {as_word(name): name for name in reversed(known)}
    if text.strip() in known:  # a name alone may have blanks
        text = as_word(text.strip())
    if len(text) > MAX_LETTERS:
        raise InputError(f"is too long for a formula (got {len(text)} letters; allowed {MAX_LETTERS})")
    tree = _parsed(text)
    nodes = [node for node in ast.walk(tree) if isinstance(node, ast.expr)]
    if len(nodes) > MAX_NODES or _depth(tree) > MAX_DEPTH:
        raise InputError(f"is too large for a formula (got {len(nodes)} terms; allowed {MAX_NODES}, {MAX_DEPTH} deep)")
    used: dict[str, int] = {}
    _check(tree, words, used, text)
    names = sorted(used, key=lambda word: used[word])
    return Expression(text, tuple(dict.fromkeys(words[word] for word in names)), tree, words)


def _parsed(text: str) -> ast.expr:
    """The tree of Python's parser; `^` is the power, which binds as `**` does."""
    if "\n" in text.strip() or "\r" in text.strip():
        raise InputError("needs a formula on one line")
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            return ast.parse(text.strip().replace("^", "**"), mode="eval").body
    except SyntaxError as error:
        where = _letter(text, error.offset - 1) if error.offset else 1
        raise InputError(f'is no formula: at letter {where} of "{_shown(text)}"; {HINT}') from None
    except (RecursionError, MemoryError, ValueError):
        raise InputError(f'is no formula (got "{_shown(text)}"); {HINT}') from None


def _depth(tree: ast.AST) -> int:
    """How deep a tree is, without recursion."""
    deepest, waiting = 0, [(tree, 1)]
    while waiting:
        node, depth = waiting.pop()
        deepest = max(deepest, depth)
        waiting += [(child, depth + 1) for child in ast.iter_child_nodes(node) if isinstance(child, ast.expr)]
    return deepest


def _check(node: ast.expr, words: Mapping[str, str], used: dict[str, int], text: str) -> None:
    """Refuse every node that is not of the grammar; gather the names."""
    parts: list[ast.expr] = []
    if isinstance(node, ast.Constant):
        number = node.value
        if isinstance(number, bool) or not isinstance(number, int | float) or not abs(number) < 1e300:
            raise _refused(node, text, "is no number that a formula may have")
    elif isinstance(node, ast.Name | ast.Attribute) and _word(node):
        word = _word(node)
        if word in words:
            used.setdefault(word, node.col_offset)
        elif word not in CONSTANTS:
            raise _refused(node, text, *_unknown(word, sorted([*words, *CONSTANTS]), "name"))
    elif isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.UAdd | ast.USub):
        parts = [node.operand]
    elif isinstance(node, ast.BinOp) and type(node.op) in OPERATORS:
        parts = [node.left, node.right]
    elif isinstance(node, ast.Call) and isinstance(node.func, ast.Name) and not node.keywords:
        word = node.func.id
        if word not in FUNCTIONS:
            raise _refused(node, text, *_unknown(word, list(FUNCTIONS), "function"))
        _, fewest, most = FUNCTIONS[word]
        if not fewest <= len(node.args) <= most:
            allowed = str(fewest) if fewest == most else f"{fewest} to {most}"
            raise _refused(node, text, f"{word} takes {allowed} values (got {len(node.args)})")
        parts = node.args
    else:
        raise _refused(node, text, "is not allowed")
    for part in parts:
        _check(part, words, used, text)


def _word(node: ast.expr) -> str:
    """A name, or several joined by points; empty for anything else."""
    if isinstance(node, ast.Name):
        return node.id
    if isinstance(node, ast.Attribute):
        before = _word(node.value)
        return f"{before}.{node.attr}" if before else ""
    return ""


def _unknown(word: str, known: Sequence[str], kind: str) -> tuple[str, str]:
    near = get_close_matches(word, known, 1)
    hint = f'did you mean "{near[0]}"?' if near else f"allowed: {', '.join(known[:30])}"
    return f'"{_shown(word)}" is no {kind} here', f"allowed: {', '.join(known[:30])}; {hint}" if near else hint


def _refused(node: ast.expr, text: str, what: str, hint: str = HINT) -> InputError:
    source = ast.get_source_segment(text.strip().replace("^", "**"), node) or text
    shown = "" if what.startswith('"') else f'"{_shown(source.replace("**", "^"))}" '
    before = text.strip().replace("^", "**").encode("utf-8")[: node.col_offset].decode("utf-8", "replace")
    return InputError(f"letter {_letter(text, len(before))}: {shown}{what}; {hint}")


def _letter(text: str, place: int) -> int:
    """Number of a letter of what was written, from its place where every `^` was made two letters."""
    start, at = len(text) - len(text.lstrip()), 0
    for number, letter in enumerate(text.strip()):
        if at >= place:
            return start + number + 1
        at += 2 if letter == "^" else 1
    return start + len(text.strip()) + 1


def _shown(text: str) -> str:
    text = printable(text.strip())
    return text if len(text) <= 60 else f"{text[:57]}..."

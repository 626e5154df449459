"""How the packages are written: rules that the linter lacks. A figure here may only go down."""

from __future__ import annotations

import ast
from collections import Counter
from collections.abc import Iterator
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
COMPREHENSIONS = (ast.ListComp, ast.SetComp, ast.DictComp, ast.GeneratorExp)
COLUMNS = 100
MANY_ARGUMENTS = 7
MANY_FIELDS = 5
LONG_FUNCTION = 62

MOST = {
    "several values assigned in one statement": 13,
    "a comprehension or a choice within another": 66,
    "seven positional arguments": 12,
    "NaN by x != x": 1,
    "more than 100 columns": 120,
    "a function of more than 62 lines": 0,
    "a record of more than five fields by position": 8,
    "kept from the formatter": 4,
}
"""What is still there."""


def trees() -> Iterator[tuple[str, ast.Module]]:
    """Every module of the packages: its text and what it says."""
    for package in ("companion", "models", "replay"):
        for path in sorted((ROOT / package).rglob("*.py")):
            text = path.read_text(encoding="utf-8")
            yield text, ast.parse(text)


def of_node(node: ast.AST) -> Iterator[str]:
    """Rules that a node breaks."""
    if isinstance(node, ast.Assign) and packed(node):
        yield "several values assigned in one statement"
    if isinstance(node, COMPREHENSIONS):
        inner = [one for one in ast.walk(node) if one is not node]
        within = any(isinstance(one, (*COMPREHENSIONS, ast.IfExp)) for one in inner)
        if within or len(node.generators) > 1:
            yield "a comprehension or a choice within another"
    if isinstance(node, ast.IfExp):
        inner = [one for one in ast.walk(node) if one is not node]
        if any(isinstance(one, ast.IfExp) for one in inner):
            yield "a comprehension or a choice within another"
    if isinstance(node, ast.Call) and len(node.args) >= MANY_ARGUMENTS:
        yield "seven positional arguments"
    if isinstance(node, ast.Compare) and with_itself(node):
        yield "NaN by x != x"
    function = isinstance(node, (ast.FunctionDef, ast.AsyncFunctionDef))
    if function and lines_of(node) > LONG_FUNCTION:
        yield "a function of more than 62 lines"
    if isinstance(node, ast.ClassDef) and by_position(node):
        yield "a record of more than five fields by position"


def lines_of(node: ast.AST) -> int:
    """Lines of a function without its docstring, which is as long as what is public must say."""
    assert isinstance(node, (ast.FunctionDef, ast.AsyncFunctionDef))
    assert node.end_lineno is not None
    lines = node.end_lineno - node.lineno + 1
    first = node.body[0]
    if ast.get_docstring(node) is not None:
        assert first.end_lineno is not None
        lines -= first.end_lineno - first.lineno + 1
    return lines


def packed(node: ast.Assign) -> bool:
    """Whether several names get a value each."""
    return isinstance(node.targets[0], ast.Tuple) and isinstance(node.value, ast.Tuple)


def with_itself(node: ast.Compare) -> bool:
    """Whether something is compared with itself."""
    equal = isinstance(node.ops[0], (ast.NotEq, ast.Eq))
    return equal and ast.dump(node.left) == ast.dump(node.comparators[0])


def by_position(node: ast.ClassDef) -> bool:
    """Whether a class is a dataclass of many fields that may be given by position."""
    fields = [one for one in node.body if isinstance(one, ast.AnnAssign)]
    for decorator in node.decorator_list:
        call = decorator if isinstance(decorator, ast.Call) else None
        name = decorator if call is None else call.func
        if isinstance(name, ast.Name) and name.id == "dataclass":
            named = call is not None and any(k.arg == "kw_only" for k in call.keywords)
            return len(fields) > MANY_FIELDS and not named
    return False


def broken() -> Counter[str]:
    """How often every rule is broken."""
    out: Counter[str] = Counter()
    for text, tree in trees():
        docstrings: set[int] = set()
        for node in ast.walk(tree):
            out.update(of_node(node))
            if isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant):
                assert node.end_lineno is not None
                docstrings |= set(range(node.lineno, node.end_lineno + 1))
        for number, line in enumerate(text.splitlines(), 1):
            if len(line) > COLUMNS and number not in docstrings:
                out["more than 100 columns"] += 1
            out["kept from the formatter"] += "# fmt: skip" in line
    return out


@pytest.fixture(scope="module")
def counted() -> Counter[str]:
    return broken()


@pytest.mark.parametrize("rule", MOST)
def test_no_rule_is_broken_more_often_than_it_was(counted: Counter[str], rule: str) -> None:
    assert counted[rule] <= MOST[rule]


def test_the_rules_see_what_they_are_for() -> None:
    together = ast.parse("a, b = 1, 2").body[0]
    assert list(of_node(together)) == ["several values assigned in one statement"]
    swapped = ast.parse("a, b = pair").body[0]
    assert list(of_node(swapped)) == []

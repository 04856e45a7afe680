"""Size of the code in tokens, and what makes its lines dense: `python tools/count_lines.py
[--by-folder] [--list] [FOLDER ...]`.

A token is one of Python's tokenizer, without comments, docstrings, line ends and indents. `--list`
names each dense place.
"""

import ast
import io
import sys
import tokenize
from collections import Counter
from collections.abc import Iterator
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
PRODUCT = ("addon", "headless", "benchmark")
MAX_COLUMNS = 100
MAX_POSITIONAL = 6
MAX_FUNCTION_LINES = 40
_UNCOUNTED = {
    tokenize.COMMENT,
    tokenize.NL,
    tokenize.NEWLINE,
    tokenize.INDENT,
    tokenize.DEDENT,
    tokenize.ENDMARKER,
}
_COMPREHENSIONS = ast.ListComp | ast.SetComp | ast.DictComp | ast.GeneratorExp
_FUNCTIONS = ast.FunctionDef | ast.AsyncFunctionDef
Place = tuple[str, int]


def docstrings(tree: ast.Module) -> Iterator[ast.Constant]:
    for node in ast.walk(tree):
        if isinstance(node, ast.Module | ast.ClassDef | _FUNCTIONS) and node.body:
            first = node.body[0]
            if isinstance(first, ast.Expr) and isinstance(first.value, ast.Constant):
                yield first.value


def tokens(source: str, tree: ast.Module) -> int:
    outside = {(text.lineno, text.col_offset) for text in docstrings(tree)}
    found = tokenize.generate_tokens(io.StringIO(source).readline)
    return sum(t.type not in _UNCOUNTED and t.start not in outside for t in found)


def dense_places(source: str, tree: ast.Module) -> Iterator[Place]:
    """(kind, line) of each place that packs several thoughts into one."""
    for number, line in enumerate(source.splitlines(), 1):
        if len(line) > MAX_COLUMNS:
            yield f"line over {MAX_COLUMNS} columns", number
    for node in ast.walk(tree):
        for kind in _kinds(node):
            yield kind, getattr(node, "lineno", 0)


def _kinds(node: ast.AST) -> Iterator[str]:
    if isinstance(node, ast.Assign) and isinstance(node.value, ast.Tuple):
        if isinstance(node.targets[0], ast.Tuple):
            yield "tuple assignment"
    elif isinstance(node, ast.IfExp):
        yield "conditional expression"
        if any(isinstance(part, ast.IfExp) for part in _below(node)):
            yield "nested conditional expression"
    elif isinstance(node, _COMPREHENSIONS):
        if len(node.generators) > 1:
            yield "comprehension with two `for`"
        if any(isinstance(part, ast.IfExp) for part in _below(node)):
            yield "comprehension with a conditional"
        if (node.end_lineno or node.lineno) - node.lineno > 1:
            yield "comprehension over more than two lines"
    elif isinstance(node, ast.Call) and _positional(node) > MAX_POSITIONAL:
        yield f"call with more than {MAX_POSITIONAL} positional arguments"
    elif isinstance(node, ast.Dict):
        if any(_is_sentence(key) for key in node.keys):
            yield "sentence as a dictionary key"
    elif isinstance(node, _FUNCTIONS):
        yield from _kinds_of_function(node)


def _kinds_of_function(node: ast.FunctionDef | ast.AsyncFunctionDef) -> Iterator[str]:
    yield "function"
    arguments = [*node.args.posonlyargs, *node.args.args, *node.args.kwonlyargs]
    named = [a for a in arguments if a.arg not in ("self", "cls")]
    if node.returns is None or any(a.annotation is None for a in named):
        yield "function not fully annotated"
    if (node.end_lineno or node.lineno) - node.lineno >= MAX_FUNCTION_LINES:
        yield f"function over {MAX_FUNCTION_LINES} lines"


def _below(node: ast.AST) -> Iterator[ast.AST]:
    for child in ast.iter_child_nodes(node):
        yield from ast.walk(child)


def _positional(call: ast.Call) -> int:
    """Positional arguments; an unpacked one counts once, as what it holds is not seen here."""
    return len(call.args)


def _is_sentence(key: ast.expr | None) -> bool:
    return isinstance(key, ast.Constant) and isinstance(key.value, str) and " " in key.value


def files(folders: tuple[str, ...]) -> Iterator[Path]:
    for folder in folders:
        yield from sorted((ROOT / folder).rglob("*.py"))


def main(arguments: list[str]) -> None:
    folders = tuple(a for a in arguments if not a.startswith("--")) or PRODUCT
    size: Counter[str] = Counter()
    dense: Counter[str] = Counter()
    for path in files(folders):
        source = path.read_text("utf-8")
        tree = ast.parse(source)
        name = str(path.relative_to(ROOT))
        size[str(Path(name).parent)] += tokens(source, tree)
        for kind, line in dense_places(source, tree):
            dense[kind] += 1
            if "--list" in arguments and kind != "function":
                print(f"{name}:{line}: {kind}")
    if "--by-folder" in arguments:
        for folder, count in sorted(size.items()):
            print(f"{folder:36} {count:8,} tokens")
    total = sum(size.values())
    print(f"{' '.join(folders):36} {total:8,} tokens")
    for kind, count in sorted(dense.items()):
        print(f"  {kind:44} {count:6}   {1e4 * count / max(total, 1):6.1f} per 10,000 tokens")


if __name__ == "__main__":
    main(sys.argv[1:])

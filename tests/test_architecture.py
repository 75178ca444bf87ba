"""The shape of the project: who may import whom."""

import ast
from functools import cache
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
FILES = sorted([*ROOT.glob("model/**/*.py"), *ROOT.glob("planner/**/*.py")])


def _name(path: Path) -> str:
    parts = path.relative_to(ROOT).with_suffix("").parts
    return ".".join(parts[:-1] if parts[-1] == "__init__" else parts)


@cache
def _imports(path: Path, inside_functions: bool) -> set[str]:
    tree = ast.parse(path.read_text())
    nodes = ast.walk(tree) if inside_functions else tree.body
    found: set[str] = set()
    for node in nodes:
        if isinstance(node, ast.ImportFrom) and node.module:
            found |= {node.module, *(f"{node.module}.{alias.name}" for alias in node.names)}
        elif isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
    return found


@pytest.mark.parametrize("path", FILES, ids=_name)
def test_the_model_knows_neither_planner_nor_plots(path: Path) -> None:
    roots = {name.split(".")[0] for name in _imports(path, inside_functions=True)}
    assert not roots & {"studies", "tests"}
    if _name(path).startswith("model"):
        assert "planner" not in roots
    if not _name(path).startswith("planner.plots"):
        assert "matplotlib" not in roots


@pytest.mark.parametrize(("folder", "others"), [("tests", "studies"), ("studies", "tests")])
def test_tests_and_studies_do_not_import_each_other(folder: str, others: str) -> None:
    for path in ROOT.glob(f"{folder}/**/*.py"):
        roots = {name.split(".")[0] for name in _imports(path, inside_functions=True)}
        assert others not in roots, path


def test_no_imports_run_in_circles() -> None:
    names = {_name(path) for path in FILES}
    graph = {_name(path): _imports(path, inside_functions=True) & names for path in FILES}
    done: set[str] = set()

    def visit(name: str, trail: tuple[str, ...]) -> None:
        assert name not in trail, " -> ".join([*trail, name])
        if name not in done:
            for other in graph[name]:
                if not name.startswith(f"{other}."):
                    visit(other, (*trail, name))
            done.add(name)

    for name in graph:
        visit(name, ())


@pytest.mark.parametrize("path", FILES, ids=_name)
def test_libraries_do_not_print(path: Path) -> None:
    if _name(path) == "planner.cli":
        return
    calls = [node for node in ast.walk(ast.parse(path.read_text())) if isinstance(node, ast.Call)]
    assert not [call for call in calls if getattr(call.func, "id", "") == "print"]

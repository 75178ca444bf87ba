"""The shape of the project: who may import whom."""

import ast
import tomllib
from functools import cache
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
FILES = sorted([*ROOT.glob("model/**/*.py"), *ROOT.glob("planner/**/*.py")])


def _name(path: Path) -> str:
    parts = path.relative_to(ROOT).with_suffix("").parts
    return ".".join(["octoplan", *(parts[:-1] if parts[-1] == "__init__" else parts)])


@cache
def _read(path: Path) -> tuple[set[str], list[int]]:
    """Return the imports of a file, also inside of functions, and the lines that print."""
    found: set[str] = set()
    prints = []
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.ImportFrom) and node.module:
            found |= {node.module, *(f"{node.module}.{alias.name}" for alias in node.names)}
        elif isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
        elif isinstance(node, ast.Call) and getattr(node.func, "id", "") == "print":
            prints.append(node.lineno)
    return found, prints


def _at_module_level(path: Path) -> set[str]:
    """Return imports at module level; hooks import extensions when called."""
    found: set[str] = set()

    def visit(body: list[ast.stmt]) -> None:
        for node in body:
            if isinstance(node, ast.ImportFrom) and node.module:
                found.update({node.module, *(f"{node.module}.{each.name}" for each in node.names)})
            elif isinstance(node, ast.Import):
                found.update(each.name for each in node.names)
            elif isinstance(node, ast.If) and "TYPE_CHECKING" not in ast.unparse(node.test):
                visit(node.body + node.orelse)
            elif isinstance(node, ast.Try | ast.With | ast.ClassDef):
                visit(node.body)

    visit(ast.parse(path.read_text()).body)
    return found


def _roots(path: Path) -> set[str]:
    return {name.split(".")[0] for name in _read(path)[0]}


def test_the_model_knows_neither_planner_nor_plots() -> None:
    for path in FILES:
        roots = _roots(path)
        assert not roots & {"studies", "tests"}, path
        if _name(path).startswith("octoplan.model"):
            names = _read(path)[0]
            assert not any(own.startswith("octoplan.planner") for own in names), path
        if not _name(path).startswith("octoplan.planner.frontends.plots"):
            assert "matplotlib" not in roots, path


@pytest.mark.parametrize(("folder", "others"), [("tests", "studies"), ("studies", "tests")])
def test_tests_and_studies_do_not_import_each_other(folder: str, others: str) -> None:
    for path in ROOT.glob(f"{folder}/**/*.py"):
        assert others not in _roots(path), path


@pytest.mark.parametrize("folder", ["model", "planner", "octoplan", "studies", "tests", "docs"])
def test_imports_name_the_installed_package(folder: str) -> None:
    for path in ROOT.glob(f"{folder}/**/*.py"):
        assert not _roots(path) & {"model", "planner"}, path


def test_every_module_has_a_layer() -> None:
    settings = tomllib.loads((ROOT / "pyproject.toml").read_text())["tool"]["importlinter"]
    layers = " : ".join(settings["contracts"][0]["layers"]).split(" : ")
    places = [path for root in ("model", "planner") for path in (ROOT / root).iterdir()]
    for path in places:
        if path.name != "__init__.py" and (path.suffix == ".py" or [*path.glob("*.py")]):
            assert _name(path) in layers, path


@cache
def _at_import(path: Path) -> frozenset[str]:
    """Return modules that a file imports at module level."""
    found: set[str] = set()
    nodes: list[ast.AST] = list(ast.parse(path.read_text()).body)
    while nodes:
        node = nodes.pop()
        if isinstance(node, ast.ImportFrom) and node.module:
            found |= {node.module, *(f"{node.module}.{alias.name}" for alias in node.names)}
        elif isinstance(node, ast.If) and "TYPE_CHECKING" not in ast.unparse(node.test):
            nodes += [*node.body, *node.orelse]
        elif isinstance(node, ast.Try | ast.With | ast.ClassDef):
            nodes += node.body
    return frozenset(found)


def _closure(start: str) -> set[str]:
    """Modules that are imported with a module, packages aside."""
    paths = {_name(path): path for path in FILES}
    found, left = set[str](), [start]
    while left:
        name = left.pop()
        if name not in found:
            found.add(name)
            left += [other for other in _at_import(paths[name]) if other in paths]
    return found


# Largest numbers of modules that are imported with plan and settle. To be lowered.
@pytest.mark.parametrize(("module", "most"), [("planner.plan", 63), ("model.settle", 39)])
def test_the_core_imports_few_modules(module: str, most: int) -> None:
    assert len(_closure(f"octoplan.{module}")) <= most


def test_no_imports_run_in_circles() -> None:
    names = {_name(path) for path in FILES}
    graph = {_name(path): _at_module_level(path) & names for path in FILES}
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


def test_libraries_do_not_print() -> None:
    for path in FILES:
        prints = _read(path)[1]
        assert not prints or _name(path) == "octoplan.planner.frontends.cli", (path, prints)

"""The house's rules: imports point down, names are unique, faces do nothing, no hosts named."""

from __future__ import annotations

import ast
import importlib
from collections import Counter
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
FLOORS = ("codec", "pipeline", "catalog", "workflows")
SOURCES = sorted(path for floor in FLOORS for path in (ROOT / floor).rglob("*.py"))
NAMES = [path.relative_to(ROOT).as_posix() for path in SOURCES]
ROOMS = (  # of the codec, each importing only from those before it
    *("geometry", "arithmetic", "formats", "figure", "streams"),
    *("patterns", "version1", "blocks", "learned", "version2"),
)
APART = {"blocks", "learned", "version2"}, {"patterns", "version1"}
UPWARD_IN_CODEC = {"codec/figure/conform.py": {"codec.formats.channels"}}
HEAVY = {
    "codec": {"dask", "distributed", "zarr", "typer", "sklearn"},
    "pipeline": {"typer"},
    "catalog": {"typer"},
    "workflows": set(),
}

assert len(SOURCES) > 40


def imported(path: Path) -> set[str]:
    """Return the modules that a source file imports, its own package's as paths below ROOT."""
    package = path.relative_to(ROOT).with_suffix("").parts[:-1]
    found = set()
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.Import):
            found |= {name.name for name in node.names}
        elif isinstance(node, ast.ImportFrom):
            if node.level == 0:
                found.add(node.module or "")
                continue
            base = package[: len(package) - node.level + 1]
            assert len(package) >= node.level - 1, f"{path} imports from outside the package"
            stem = ".".join((*base, *(node.module or "").split("."))).strip(".")
            found |= {stem} if node.module else {f"{stem}.{name.name}" for name in node.names}
    return found


@pytest.mark.parametrize("name", NAMES)
def test_imports_never_point_up(name: str) -> None:
    floor = FLOORS.index(name.split("/")[0])
    for module in imported(ROOT / name):
        top = module.split(".")[0]
        if top in FLOORS:
            assert FLOORS.index(top) <= floor, f"{name} imports {module}"
        assert top not in HEAVY[FLOORS[floor]], f"{name} imports {top}"
        assert top != "motifold", "imports inside the package are relative"
        assert top not in ("tests", "pytest", "hypothesis")


@pytest.mark.parametrize("name", [name for name in NAMES if name.startswith("codec/")])
def test_the_rooms_of_the_codec_stand_in_a_row(name: str) -> None:
    room = name.split("/")[1]
    if room not in ROOMS:
        return
    for module in imported(ROOT / name):
        other = module.split(".")[1] if module.startswith("codec.") else ""
        if other in ROOMS:
            assert ROOMS.index(other) <= ROOMS.index(room), f"{name} imports {module}"
            assert not (room in APART[0] and other in APART[1]), f"{name} imports {module}"


def test_every_folder_of_the_codec_is_a_room() -> None:
    folders = {path.parent.name for path in (ROOT / "codec").glob("*/__init__.py")}
    assert folders == set(ROOMS)


@pytest.mark.parametrize("name", [name for name in NAMES if name.startswith("codec/")])
def test_the_codec_knows_formats_at_its_edge_only(name: str) -> None:
    if name.startswith("codec/formats/"):
        return
    above = {module for module in imported(ROOT / name) if module.startswith("codec.formats")}
    assert above <= UPWARD_IN_CODEC.get(name, set())


def test_no_imports_go_round_in_circles() -> None:
    modules = {name.removesuffix(".py").replace("/", "."): ROOT / name for name in NAMES}
    graph = {
        module: {other for other in imported(path) if other in modules}
        for module, path in modules.items()
        if not module.endswith("__init__")
    }
    done: set[str] = set()

    def visit(module: str, above: tuple[str, ...]) -> None:
        assert module not in above, " -> ".join((*above, module))
        if module not in done:
            for other in graph.get(module, ()):
                visit(other, (*above, module))
            done.add(module)

    for module in graph:
        visit(module, ())


def test_base_names_are_unique() -> None:
    counts = Counter(path.name for path in SOURCES if path.name != "__init__.py")
    assert [name for name, count in counts.items() if count > 1] == []


def test_no_file_is_named_like_what_it_might_import() -> None:
    top = {module.split(".")[0] for path in SOURCES for module in imported(path)} - set(FLOORS)
    assert {path.stem for path in SOURCES} & top == set()


@pytest.mark.parametrize("name", [name for name in NAMES if name.endswith("__init__.py")])
def test_faces_of_folders_only_hand_names_on(name: str) -> None:
    body = ast.parse((ROOT / name).read_text()).body
    assert isinstance(body[0], ast.Expr), "a docstring says what the folder is for"
    for node in body[1:]:
        names = isinstance(node, ast.Assign) and ast.unparse(node.targets[0]) == "__all__"
        assert names or isinstance(node, ast.ImportFrom), ast.unparse(node)


def test_the_package_s_own_face_is_a_docstring() -> None:
    body = ast.parse((ROOT / "__init__.py").read_text()).body
    assert len(body) == 1
    assert isinstance(body[0], ast.Expr)


@pytest.mark.parametrize("name", NAMES)
def test_public_functions_say_what_they_do(name: str) -> None:
    tree = ast.parse((ROOT / name).read_text())
    assert ast.get_docstring(tree), f"{name} has no docstring"
    for node in ast.walk(tree):
        assert not isinstance(node, ast.ExceptHandler) or node.type is not None, "a bare except"


def test_files_are_short() -> None:
    long = {name: len((ROOT / name).read_text().splitlines()) for name in NAMES}
    assert {name: lines for name, lines in long.items() if lines > 330} == {}


@pytest.mark.parametrize("name", NAMES)
def test_every_module_can_be_imported_by_itself(name: str) -> None:
    module = name.removesuffix(".py").removesuffix("/__init__").replace("/", ".")
    assert importlib.import_module(f"motifold.{module}")

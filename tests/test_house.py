"""The house: which folders are packaged, who may import whom, what is public."""

from __future__ import annotations

import ast
import importlib
import pkgutil
import subprocess
import sys
import tomllib
from importlib.metadata import entry_points, requires, version
from pathlib import Path

import pytest

LAYERS = ("data", "models", "ocp", "estimation")
MAY_IMPORT = {"data": {"data"}, "models": {"models"}, "ocp": {"models", "ocp"}, "estimation": {"models", "ocp", "estimation", "data"}}
TOP_LEVEL = {"models", "ocp", "estimation", "tests", "data", "README.md", "pyproject.toml", "Makefile", "CHANGELOG.md", "LICENSE"}
FOR_THE_COMMAND_ONLY = {"typer", "rich", "pydantic", "plotly", "pint"}


def sources() -> list[tuple[str, Path]]:
    """Every source file of the package, where it is installed, with the layer it belongs to."""
    found = []
    for layer in LAYERS:
        folder = Path(str(importlib.import_module(f"backsight.{layer}").__file__)).parent
        found += [(layer, path) for path in sorted(folder.rglob("*.py"))]
    assert len(found) > 20
    return found


def imported(path: Path, layer: str) -> set[str]:
    """Absolute names of the modules that a file imports, relative ones spelt out."""
    names = set()
    root = next(p for p in path.parents if p.name == layer)
    package = ["backsight", layer, *path.parent.relative_to(root).parts]
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            names |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            base = package[: len(package) - node.level + 1] if node.level else []
            prefix = ".".join([*base, *([node.module] if node.module else [])])
            names |= {prefix} | ({f"{prefix}.{alias.name}" for alias in node.names} if prefix == "backsight" else set())
    return names


def every_module() -> list[str]:
    return [
        module.name
        for layer in LAYERS
        for module in pkgutil.walk_packages(importlib.import_module(f"backsight.{layer}").__path__, f"backsight.{layer}.")
        if not module.name.endswith("__main__")
    ]


# ---------------------------------------------------------------- layers


def test_the_layers_import_one_way_only():
    wrong = [
        f"{path}: {name}"
        for layer, path in sources()
        for name in imported(path, layer)
        if name.startswith("backsight.") and name.split(".")[1] not in MAY_IMPORT[layer]
    ]
    assert not wrong


def test_a_diagnosis_goes_through_its_folders_in_order():
    order = ["answer", "evidence", "candidates", "scores", "search", "start", "proof"]
    inside = "backsight.estimation.diagnosis."
    steps = {name.removeprefix(inside).split(".")[0] for name in every_module() if name.startswith(inside)}
    assert steps == {*order, "diagnose"}
    wrong = [
        f"{path}: {name}"
        for layer, path in sources()
        if path.parent.parent.name == "diagnosis"
        for name in imported(path, layer)
        if name.startswith(inside) and order.index(name.removeprefix(inside).split(".")[0]) > order.index(path.parent.name)
    ]
    assert not wrong


def test_no_layer_is_imported_under_its_bare_name():
    wrong = [f"{path}: {name}" for layer, path in sources() for name in imported(path, layer) if name.split(".")[0] in LAYERS]
    assert not wrong
    assert not set(LAYERS) & set(sys.modules)


def test_other_layers_are_named_in_full_and_the_own_one_relatively():
    for layer, path in sources():
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.ImportFrom) and node.level == 0:
                assert not (node.module or "").startswith(f"backsight.{layer}."), f"{path}: write `from .{node.module}`"


def test_models_and_ocp_do_not_need_what_only_the_command_needs():
    code = (
        "import sys, pkgutil, importlib\n"
        "for layer in ('models', 'ocp'):\n"
        "    package = importlib.import_module('backsight.' + layer)\n"
        "    for module in pkgutil.walk_packages(package.__path__, package.__name__ + '.'):\n"
        "        importlib.import_module(module.name)\n"
        f"print(*sorted(m for m in sys.modules if m in {FOR_THE_COMMAND_ONLY!r} or m.startswith('backsight.estimation')))"
    )
    done = subprocess.run([sys.executable, "-W", "ignore", "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.split() == []
    wrong = [
        f"{p}: {n}"
        for layer, p in sources()
        if layer != "estimation"
        for n in imported(p, layer)
        if n.split(".")[0] in FOR_THE_COMMAND_ONLY
    ]
    assert not wrong


def test_help_is_quick_because_nothing_heavy_is_imported_for_it():
    code = (
        "import sys; from backsight.estimation.command.cli import main; main(['--help'])\n"
        "print('loaded:', *sorted({'casadi', 'scipy', 'pandas', 'plotly', 'pint'} & set(sys.modules)))"
    )
    done = subprocess.run([sys.executable, "-W", "ignore", "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.splitlines()[-1].split() == ["loaded:"]


# ---------------------------------------------------------------- names


@pytest.mark.parametrize("layer", LAYERS)
def test_public_names_exist_and_every_module_says_what_it_is(layer):
    package = importlib.import_module(f"backsight.{layer}")
    assert package.__doc__
    for name in getattr(package, "__all__", ()):
        assert getattr(package, name) is not None
    for name in every_module():
        if name.startswith(f"backsight.{layer}."):
            module = importlib.import_module(name)
            assert module.__doc__, f"{name} has no docstring"
            missing = [n for n in getattr(module, "__all__", ()) if not hasattr(module, n)]
            assert not missing, f"{name}.__all__ names {missing}"


def test_the_names_of_estimation_are_the_ones_it_loads_late():
    import backsight.estimation as estimation

    late = [name for names in estimation._HOME.values() for name in names]
    assert sorted(late) == sorted(estimation.__all__)
    with pytest.raises(AttributeError, match="no attribute 'smoooth'"):
        estimation.smoooth  # noqa: B018


def test_a_class_has_one_identity_however_it_is_reached():
    from backsight.models import Dae
    from backsight.models.dae import Dae as same

    assert Dae is same


def test_the_installed_command_is_the_one_of_this_package():
    (command,) = entry_points(group="console_scripts", name="backsight")
    assert command.value == "backsight.estimation.command.cli:main"


def test_every_package_is_marked_as_typed():
    for layer in LAYERS:
        assert (Path(str(importlib.import_module(f"backsight.{layer}").__file__)).parent / "py.typed").is_file()


# ---------------------------------------------------------------- the checkout


def project(checkout: Path) -> dict:
    return tomllib.loads((checkout / "pyproject.toml").read_text(encoding="utf-8"))


def test_the_list_of_packages_is_that_of_the_folders(checkout):
    folders = {
        ".".join(["backsight", *path.parent.relative_to(checkout).parts])
        for layer in LAYERS
        for path in (checkout / layer).rglob("__init__.py")
    }
    assert sorted(project(checkout)["tool"]["setuptools"]["packages"]) == sorted(folders)


def test_the_top_level_holds_what_the_readme_says_and_no_more(checkout):
    listed = subprocess.run(["git", "ls-files", "-co", "--exclude-standard"], cwd=checkout, capture_output=True, text=True, check=False)
    if listed.returncode != 0:
        pytest.skip("no git here")
    top = {line.split("/")[0] for line in listed.stdout.splitlines()}
    assert {name for name in top if not name.startswith(".")} <= TOP_LEVEL | {"requirements.lock"}


def test_every_dependency_is_locked_with_hashes_and_without_an_index(checkout):
    lock = (checkout / "requirements.lock").read_text(encoding="utf-8")
    tables = project(checkout)["project"]
    wanted = [*tables["dependencies"], *(line for extra in tables["optional-dependencies"].values() for line in extra)]
    for requirement in wanted:
        name = requirement.split(">=")[0].split(";")[0].strip()
        assert ">=" in requirement, f"{requirement} has no lower bound"
        assert f"\n{name}==" in f"\n{lock}", f"{name} is not in requirements.lock; run make lock"
    pins = [line for line in lock.splitlines() if "==" in line and not line.startswith((" ", "#"))]
    assert all(line.endswith("\\") for line in pins)
    assert "://" not in lock


def test_the_version_is_written_once(checkout):
    assert project(checkout)["project"]["version"] == version("backsight")
    assert requires("backsight")


def test_what_needs_more_than_a_bare_installation_is_marked_so_that_it_is_run_in_the_checkout():
    """On the wheel it would be skipped, and run nowhere."""
    for path in Path(__file__).resolve().parent.rglob("test_*.py"):
        text = path.read_text(encoding="utf-8")
        assert path == Path(__file__).resolve() or "importorskip(" not in text or "mark.checkout" in text, path

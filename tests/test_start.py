"""The command line and `import sidestep` start without the libraries that only a drive needs."""

import subprocess
import sys

import pytest

import sidestep

HEAVY = ("numba", "numpy", "scipy", "msgspec", "rich", "matplotlib", "mujoco", "fmpy", "can")


def loaded(code: str) -> set[str]:
    """Top-level modules that a process has loaded after `code`."""
    script = f"import sys\ntry:\n    {code}\nexcept SystemExit: pass\nprint('\\n', *sys.modules)"
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True, timeout=60)
    return {name.partition(".")[0] for name in done.stdout.splitlines()[-1].split()}


@pytest.mark.parametrize(
    "arguments",
    ["--help", "run --help", "limits moose --help", "scenarios", "--version", "run", "runn", "can", "run mose"],
)
def test_help_lists_and_usage_errors_load_nothing_heavy(arguments):
    names = loaded(f"from sidestep.validation.cli.main import main; main({arguments.split()!r})")
    assert "argparse" in names
    assert not names & set(HEAVY)


def test_the_package_itself_loads_nothing():
    assert not loaded("import sidestep; sidestep.__version__") & set(HEAVY)
    assert not loaded("from sidestep.plant_models import InputError") & set(HEAVY)


@pytest.mark.parametrize("package", [sidestep, sidestep.plant_models], ids=lambda package: package.__name__)
def test_every_name_is_there(package):
    for name in package.__all__:
        assert getattr(package, name) is not None
        assert name in vars(package) or name == "__version__"  # found once, then an ordinary attribute
    with pytest.raises(AttributeError, match=r"has no attribute 'Trabant'"):
        _ = package.Trabant


def test_functions_are_not_hidden_by_the_modules_they_come_from():
    script = "import sidestep.plant_models.checks.check_plant, sidestep; print(callable(sidestep.check_plant))"
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True, timeout=60)
    assert done.stdout == "True\n"

"""List the packages of the wheel; everything else is in pyproject.toml."""

from setuptools import find_namespace_packages, setup

# The folders model/ and planner/ are installed inside of `octoplan`; see package-dir. Folders of
# templates and C files are packages, too.
INNER = find_namespace_packages(
    include=["model", "model.*", "planner", "planner.*"], exclude=["*.__pycache__"]
)

setup(packages=["octoplan", *(f"octoplan.{name}" for name in INNER)])

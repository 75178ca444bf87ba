"""Sphinx configuration: `sphinx-build -W docs out/docs` builds the documentation."""

import os
import sys
import tempfile
from importlib.metadata import version as _version
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parent / "extensions"))

project = "octoplan"
author = "The octoplan developers"
release = _version("octoplan")
extensions = [
    "sphinx.ext.autodoc",
    "sphinx.ext.doctest",
    "sphinx_copybutton",
    "myst_nb",
    "numpydoc",
    "api_reference",
    "file_reference",
    "mathml",
]
html_math_renderer = "mathml"
html_theme = "furo"
pygments_dark_style = "github-dark"
html_title = f"octoplan {release}"
smartquotes_action = "qe"  # no dashes: options begin with two hyphens
html_copy_source = False
html_show_copyright = False
html_static_path = ["static"]
html_css_files = ["width.css"]
html_theme_options = {"navigation_with_keys": True}
exclude_patterns = ["images/*.py"]
autodoc_typehints = "none"
autodoc_member_order = "bysource"
autodoc_preserve_defaults = True
numpydoc_show_class_members = False
copybutton_prompt_text = r">>> |\.\.\. |\$ "
copybutton_prompt_is_regexp = True
# Notebooks are executed in each build, so that the outputs are current.
nb_execution_mode = "force"
nb_execution_timeout = 300
nb_execution_raise_on_error = True
nb_execution_in_temp = True
nb_output_stderr = "remove"
# Turn off progress lines in notebooks, which would appear only on slow machines.
_ipython = tempfile.TemporaryDirectory()
_startup = Path(_ipython.name, "profile_default", "startup")
_startup.mkdir(parents=True)
_no_progress = "import octoplan.model.support.progress as progress\nprogress.DELAY = 1e6\n"
(_startup / "no_progress.py").write_text(_no_progress)
os.environ["IPYTHONDIR"] = _ipython.name
doctest_global_setup = """
import matplotlib
matplotlib.use("Agg")
"""

"""How Sphinx makes the documentation: `sphinx-build -W docs out/docs`."""

import sys
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
html_title = f"octoplan {release}"
smartquotes_action = "qe"  # not dashes: options begin with two
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
# The notebook is run when the documentation is built, and what it shows is what it says.
nb_execution_mode = "force"
nb_execution_timeout = 300
nb_execution_raise_on_error = True
nb_execution_in_temp = True
# Lines that tell how far a computation is.
nb_output_stderr = "remove"
doctest_global_setup = """
import matplotlib
matplotlib.use("Agg")
"""

"""How Sphinx turns the docstrings into a site: `sphinx-build -W docs out/docs`."""

from importlib.metadata import version as _version

project = "octoplan"
author = "The octoplan developers"
release = _version("octoplan")
extensions = ["sphinx.ext.autodoc", "sphinx.ext.autosummary", "numpydoc"]
html_theme = "alabaster"
html_theme_options = {"description": "Optimal tension allocation for soft arms"}
html_copy_source = False
autodoc_typehints = "none"
autosummary_generate = True
numpydoc_show_class_members = False

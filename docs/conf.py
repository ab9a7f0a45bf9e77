"""Sphinx configuration of these pages; ``make docs`` builds them."""

from __future__ import annotations

import sys
from pathlib import Path

HERE = Path(__file__).resolve().parent
sys.path[:0] = [str(HERE), str(HERE.parent)]

import generated  # noqa: E402

from svv._version import __version__  # noqa: E402

project, author, release = "svv", "the svv authors", __version__
copyright = "2026, the svv authors"
extensions = ["myst_parser", "sphinx.ext.autodoc", "sphinx.ext.napoleon", "sphinx.ext.viewcode"]
myst_heading_anchors = 3
myst_enable_extensions = ["colon_fence"]
html_theme, html_title = "furo", "svv"
html_static_path, html_css_files = ["_static"], ["custom.css"]
exclude_patterns = ["_build"]
default_role = "any"
autodoc_typehints = "none"
nitpicky = False
suppress_warnings = ["myst.header"]
linkcheck_ignore = [r"http://localhost.*"]

generated.write(HERE / "reference")

"""Sphinx configuration of these pages; ``make docs`` builds them."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

HERE = Path(__file__).resolve().parent
sys.path[:0] = [str(HERE), str(HERE.parent)]

import generated  # noqa: E402
import tables  # noqa: E402

from svv._version import __version__  # noqa: E402

project, author, release = "svv", "the svv authors", __version__
copyright = "2026, the svv authors"
extensions = [
    "myst_parser", "sphinx.ext.autodoc", "sphinx.ext.napoleon", "sphinx.ext.viewcode", "sphinx_gallery.gen_gallery",
]  # fmt: skip
sphinx_gallery_conf = {  # the examples are executed in the order of their names; unchanged ones keep their results
    "examples_dirs": "examples",
    "gallery_dirs": "made",
    "filename_pattern": r"\.py",
    "within_subsection_order": "FileNameSortKey",
    "image_scrapers": ("scraped.pictures",),
    "capture_repr": ("_repr_html_",),
    "abort_on_example_error": True,
    "show_memory": False,
    "download_all_examples": False,
    "show_signature": False,
    "min_reported_time": 600,
}
myst_heading_anchors = 3
myst_enable_extensions = ["colon_fence"]
html_theme, html_title = "furo", "svv"
html_static_path, html_css_files = ["_static"], ["custom.css"]
exclude_patterns = ["_build", "examples", "made/sg_execution_times.rst"]
default_role = "any"
autodoc_typehints = "none"
nitpicky = False
suppress_warnings = ["myst.header"]
linkcheck_ignore = [r"http://localhost.*"]

generated.write(HERE / "reference")
tables.write()


def setup(app: Any) -> None:
    """Mark the measurements that are older than their code."""
    app.connect("source-read", tables.mark)

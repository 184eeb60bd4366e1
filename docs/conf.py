"""Sphinx configuration of the guide: `sphinx-build -W -j 2 -b html docs docs/_build/html`."""

import importlib.metadata
import sys
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).parent / "_ext"))

project = "dechirp"
author = "the dechirp authors"
copyright = f"2026, {author}"
version = release = importlib.metadata.version("dechirp")

extensions = [
    "api",
    "command",
    "family",
    "settings",
    "sources",
    "myst_nb",
    "sphinx.ext.autodoc",
    "sphinx.ext.autosummary",
    "sphinx.ext.napoleon",
    "sphinx_copybutton",
    "sphinx_design",
    "sphinx_gallery.gen_gallery",
    "sphinx-mathjax-offline",
]
exclude_patterns = ["gallery", "_build", "_ext", "_templates", "verification/README.md"]
nitpicky = False

# Every block of the guide is run when it is built; one that fails is a warning, an error with -W.
nb_execution_mode = "inline"  # in the order of the page, between its commands
nb_execution_show_tb = True
nb_execution_timeout = 120
nb_execution_in_temp = True
nb_ipywidgets_js = {}  # they would be asked for from elsewhere
nb_merge_streams = True
myst_enable_extensions = ["amsmath", "colon_fence", "deflist", "dollarmath"]
myst_heading_anchors = 3

# Scripts in docs/gallery become pages with what they draw and print: one that fails, no guide.
sphinx_gallery_conf = {
    "examples_dirs": "gallery",
    "gallery_dirs": "gallery_built",
    "subsection_order": [
        f"gallery/{part}"
        for part in ("echo", "detection", "velocity", "directions", "hardware", "objects")
    ],
    "within_subsection_order": "FileNameSortKey",
    "nested_sections": False,
    "filename_pattern": r"/plot_",
    "abort_on_example_error": True,
    "reset_modules": ("gallery_style.reset",),
    "notebook_extensions": [],  # MyST-NB would run them once more
    "capture_repr": (),  # what is printed, and no values besides
    "image_srcset": ["2x"],
    "download_all_examples": False,
    "show_memory": False,
    "show_signature": False,
    "write_computation_times": False,
    "min_reported_time": 1e9,  # it is that of the machine that builds the guide
}

html_theme = "pydata_sphinx_theme"
html_title = "dechirp"
html_static_path = ["_static"]
html_css_files = ["guide.css"]
templates_path = ["_templates"]
html_show_sourcelink = False
html_copy_source = False
html_show_search_summary = False  # they would be fetched, which a page from disk may not
html_context = {"default_mode": "auto"}
html_sidebars = {"**": ["contents"]}
html_theme_options = {
    "navigation_with_keys": False,
    "show_toc_level": 2,
    "navbar_center": [],
    "navbar_persistent": [],
    "navbar_end": ["search-button-field", "theme-switcher"],
    "article_header_start": [],
    "footer_start": ["copyright"],
    "footer_end": [],
    "pygments_light_style": "a11y-high-contrast-light",
    "pygments_dark_style": "a11y-high-contrast-dark",
}

autodoc_typehints = "signature"
autodoc_member_order = "bysource"
autodoc_preserve_defaults = True
autodoc_typehints_format = "short"
default_role = "py:obj"  # `detect` in a docstring leads to dechirp.detect
add_module_names = False
python_maximum_signature_line_length = 130
toc_object_entries = False
napoleon_numpy_docstring = True
napoleon_google_docstring = False
napoleon_use_rtype = False


def setup(app: Any) -> None:
    """Say of the MathJax that is copied beside the pages that it does not mind two readers."""
    app.extensions["sphinx-mathjax-offline"].parallel_read_safe = True

"""Sphinx configuration of the guide: `sphinx-build -W -j 2 -b html docs docs/_build/html`."""

import importlib.metadata
import sys
from functools import partial
from pathlib import Path
from typing import Any

from sphinxcontrib.bibtex.plugin import register_plugin
from sphinxcontrib.bibtex.style.referencing import BracketStyle
from sphinxcontrib.bibtex.style.referencing.author_year import AuthorYearReferenceStyle

sys.path.insert(0, str(Path(__file__).parent / "_ext"))

project = "dechirp"
author = "the dechirp authors"
copyright = f"2026, {author}"
version = release = importlib.metadata.version("dechirp")

extensions = [
    "api",
    "command",
    "family",
    "notebooks",
    "settings",
    "myst_nb",
    "sphinx.ext.autodoc",
    "sphinx.ext.autosummary",
    "sphinx.ext.napoleon",
    "sphinx_copybutton",
    "sphinx_design",
    "sphinx_gallery.gen_gallery",
    "sphinx-mathjax-offline",
    "sphinxcontrib.bibtex",
]
exclude_patterns = [
    *("gallery", "_build", "_ext", "_templates", "verification/README.md", "figures/witnesses.md"),
    "gallery_built/**/*.ipynb",  # downloads; as pages MyST-NB would run the scripts a second time
]
nitpicky = False

# The build runs every block of the guide; a failure is a warning, with -W an error.
nb_execution_mode = "inline"  # in page order, between the commands
nb_execution_show_tb = True
nb_execution_timeout = 300  # s a block: 20 on an idle machine, many times that on a busy one
nb_execution_in_temp = True
nb_ipywidgets_js = {}  # would be downloaded from other sites
nb_merge_streams = True
myst_enable_extensions = ["amsmath", "colon_fence", "deflist", "dollarmath"]
myst_heading_anchors = 3

# {cite}`rohling` becomes (Rohling, 1983), {cite:t}`rohling` becomes Rohling (1983).
_ROUND = BracketStyle(left="(", right=")", sep="; ")
register_plugin(
    "sphinxcontrib.bibtex.style.referencing",
    "round_author_year",
    partial(AuthorYearReferenceStyle, bracket_textual=_ROUND, bracket_parenthetical=_ROUND),
)
bibtex_bibfiles = ["references.bib"]
bibtex_reference_style = "round_author_year"
bibtex_default_style = "plain"  # sorted by author
bibtex_cite_id = "{key}-{bibliography_count}"
suppress_warnings = ["bibtex.duplicate_label"]  # numbers of each list, which guide.css hides

# Scripts in docs/gallery become pages with their figures and output; a failure stops the build.
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
    "notebook_extensions": [".py"],
    "capture_repr": (),  # printed output only, no values
    "image_srcset": ["2x"],
    "download_all_examples": False,
    "show_memory": False,
    "show_signature": False,
    "write_computation_times": False,
    "min_reported_time": 1e9,  # the time depends on the machine of the build
}

html_theme = "pydata_sphinx_theme"
html_title = "dechirp"
html_static_path = ["_static"]
html_css_files = ["guide.css"]
templates_path = ["_templates"]
html_show_sourcelink = False
html_copy_source = False
html_show_search_summary = False  # pages opened from disk cannot fetch them
html_context = {"default_mode": "auto"}
html_sidebars = {"**": ["contents"]}
html_theme_options = {
    "navigation_with_keys": False,
    "show_toc_level": 2,
    "navbar_center": [],
    "navbar_persistent": [],
    "navbar_end": ["search-button-field", "theme-switcher"],
    "article_header_start": [],
    "article_footer_items": ["notebook"],
    "footer_start": ["copyright"],
    "footer_end": [],
    "pygments_light_style": "a11y-high-contrast-light",
    "pygments_dark_style": "a11y-high-contrast-dark",
}

autodoc_typehints = "signature"
autodoc_member_order = "bysource"
autodoc_preserve_defaults = True
autodoc_typehints_format = "short"
default_role = "py:obj"  # `detect` in a docstring links to dechirp.detect
add_module_names = False
python_maximum_signature_line_length = 130
toc_object_entries = False
napoleon_numpy_docstring = True
napoleon_google_docstring = False
napoleon_use_rtype = False


def setup(app: Any) -> None:
    """Declare the MathJax extension safe for parallel reading."""
    app.extensions["sphinx-mathjax-offline"].parallel_read_safe = True

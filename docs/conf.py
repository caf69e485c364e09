"""Configuration of the site. `make docs` builds it into build/docs."""

from __future__ import annotations

import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parent / "_ext"))

import evs

project = "evs"
author = "the evs authors"
project_copyright = "the evs authors, Apache-2.0"
version = release = evs.__version__

extensions = [
    "myst_parser",
    "sphinx.ext.autodoc",
    "sphinx.ext.napoleon",
    "sphinx.ext.viewcode",
    "generated",
    "notebooks",
]
# of the checkout, the pages of evs and of evs-lab
root_doc = "docs/index"
include_patterns = ["docs/**", "lab/docs/**"]
exclude_patterns = ["[!dl]*", "docs/_ext", "lab/docs/measured", "lab/[!d]*"]

myst_enable_extensions = ["colon_fence", "deflist"]
myst_heading_anchors = 4

# docstrings: Google's sections, types from the annotations, fields with the string below them
napoleon_numpy_docstring = False
# keys that a docstring lists stand there alone
napoleon_use_ivar = True
autodoc_typehints = "signature"
python_use_unqualified_type_names = True
python_maximum_signature_line_length = 88
autodoc_member_order = "bysource"
autodoc_default_options = {"members": True}
autodoc_preserve_defaults = True

html_theme = "furo"
html_title = f"evs {release}"
html_static_path: list[str] = []
html_theme_options = {"navigation_with_keys": True}
html_copy_source = False
smartquotes = False
highlight_language = "none"
# a word in single backticks is code, as in the docstrings
default_role = "literal"

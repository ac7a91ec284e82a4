"""The documentation site: the pages of this folder and the reference of the public names."""

import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parent.parent))
sys.path.insert(0, str(Path(__file__).parent))  # mathml

from sphinx.application import Sphinx

from iris_sysid._version import __version__
from validation.gallery import write_gallery

project = "iris-sysid"
author = "The iris-sysid founders"
copyright = author
version = release = __version__
extensions = ["myst_parser", "sphinx.ext.autodoc", "sphinx.ext.napoleon", "mathml"]
html_math_renderer = "mathml"
myst_enable_extensions = ["dollarmath"]
myst_heading_anchors = 3
autodoc_typehints = "description"
autodoc_typehints_description_target = "documented"
autodoc_member_order = "bysource"
napoleon_google_docstring = False
napoleon_use_rtype = False
napoleon_preprocess_types = False
html_theme = "furo"
html_title = "iris-sysid"
exclude_patterns = ["_build"]


def setup(app: Sphinx) -> None:
    """Write the gallery from the registry before the pages are read."""
    app.connect("builder-inited", lambda app: write_gallery(Path(app.srcdir) / "gallery"))

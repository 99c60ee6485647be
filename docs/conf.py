"""The site: `sphinx-build -W --keep-going docs docs/_build/html` (extra `docs`)."""

import os
import sys
from pathlib import Path

import schwung

HERE = Path(__file__).parent
sys.path.insert(0, str(HERE / "_ext"))
# What the tutorials call is the Schwung that is documented, whoever builds.
os.environ["PATH"] = os.pathsep.join([str(Path(sys.executable).parent), os.environ.get("PATH", "")])
os.environ["PYTHONPATH"] = os.pathsep.join([str(HERE / "_ext"), os.environ.get("PYTHONPATH", "")])
os.environ["COLUMNS"] = "100"
os.environ["PYDEVD_DISABLE_FILE_VALIDATION"] = "1"

project = "Schwung"
author = "The Schwung authors"
copyright = "The Schwung authors, Apache-2.0"
version = release = schwung.__version__

extensions = ["myst_nb", "sphinx.ext.autodoc", "sphinx.ext.napoleon", "sphinx_design", "site_parts"]
exclude_patterns = ["_build", "_ext", "**.ipynb_checkpoints"]
html_theme = "pydata_sphinx_theme"
html_title = "Schwung"
html_static_path = ["_static"]
html_css_files = ["site.css"]
html_copy_source = False
html_show_sourcelink = False
html_theme_options = {
    "navbar_align": "left",
    "navbar_persistent": ["search-button"],
    "secondary_sidebar_items": ["page-toc"],
    "footer_start": ["copyright"],
    "footer_end": [],
    "show_toc_level": 2,
    "pygments_light_style": "a11y-high-contrast-light",
    "pygments_dark_style": "a11y-high-contrast-dark",
}
html_math_renderer = "pictures"

myst_enable_extensions = ["dollarmath", "colon_fence", "deflist"]
myst_heading_anchors = 4
nb_execution_mode = "cache"  # what has not changed is not run again
nb_execution_timeout = 120
nb_execution_raise_on_error = True
nb_execution_in_temp = True
nb_merge_streams = True

default_role = "code"
nitpicky = True  # a reference that leads nowhere is a warning, and so an error
autodoc_member_order = "bysource"
autodoc_typehints = "none"  # the signature has them
napoleon_google_docstring = True
napoleon_numpy_docstring = False

"""Sphinx's settings for the site; `make docs` builds it from the pages that GitHub shows, and from the code."""

from __future__ import annotations

import re
from importlib.metadata import version as version_of
from typing import Any, Final

from sphinx.application import Sphinx

LONG_CODE: Final = re.compile(r'(?<=<span class="pre">)[^<]{30,}(?=</span>)')
JOINT: Final = re.compile(r"::|[/_]")

project = "sprl-bench"
author = "The sprl-bench maintainers"
project_copyright = "the sprl-bench maintainers; MIT license"
release = version_of("sprl-bench")

extensions = ["myst_parser", "sphinx.ext.autodoc", "sphinx.ext.napoleon", "sphinx_copybutton"]
source_suffix = {".md": "markdown"}
root_doc = "index"
exclude_patterns = ["**/README.assets", "extra"]

myst_heading_anchors = 4
myst_enable_extensions = ["colon_fence"]

default_role = "literal"  # docstrings are Markdown: `name`
autodoc_member_order = "bysource"
autodoc_typehints = "signature"
autodoc_preserve_defaults = True
add_module_names = False
napoleon_numpy_docstring = False
napoleon_use_ivar = True

html_theme = "furo"
html_title = "sprl-bench"
html_static_path = ["docs/site"]
html_css_files = ["site.css"]
html_js_files = [("site.js", {"defer": "defer"})]
html_extra_path = ["extra"]
html_copy_source = False
html_show_sourcelink = False
html_theme_options = {"navigation_with_keys": True, "top_of_page_buttons": []}


def setup(app: Sphinx) -> None:
    """Correct what Sphinx and the theme write."""
    app.connect("autodoc-process-signature", _name_fields)
    app.connect("autodoc-skip-member", _skip_tuple_fields)
    app.connect("html-page-context", _help_keyboards_and_readers, priority=900)  # after the theme


def _name_fields(_app: Sphinx, _what: str, _name: str, value: Any, *_: Any) -> tuple[str, str] | None:
    """Return the signature of a file's type: its fields without pydantic's checks, which fill half a screen."""
    fields = getattr(value, "model_fields", None)
    return (f"(*, {', '.join(fields)})", "") if isinstance(value, type) and fields else None


def _skip_tuple_fields(_app: Sphinx, _what: str, _name: str, value: Any, *_: Any) -> bool | None:
    """Skip the fields of named tuples, which the signature names: Python calls each an alias for a number."""
    return True if type(value).__name__ == "_tuplegetter" else None


def _help_keyboards_and_readers(_app: Sphinx, _page: str, _template: str, context: dict[str, Any], _tree: Any) -> None:
    """Give headings of the navigation a level, let keys scroll what is wide, and let long code break at its joints."""
    navigation = context.get("furo_navigation_tree", "")
    context["furo_navigation_tree"] = navigation.replace('role="heading"', 'role="heading" aria-level="2"')
    body = context.get("body", "").replace("<pre>", '<pre tabindex="0">')
    body = body.replace('<div class="table-wrapper', '<div tabindex="0" class="table-wrapper')
    context["body"] = LONG_CODE.sub(lambda code: JOINT.sub(r"\g<0><wbr>", code[0]), body)

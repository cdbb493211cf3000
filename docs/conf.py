"""The documentation site:  sphinx-build -n -W -b html docs build/docs"""

import importlib
import inspect
import os
import sys
from pathlib import Path

import typer.main
from docutils import nodes
from docutils.utils.math.latex2mathml import tex2mathml

import rotorfit
import rotorfit.cli.main

sys.path.insert(0, str(Path(__file__).parent))
from page_site import write_page

project = "rotorfit"
author = "rotorfit contributors"
copyright = author
version = release = rotorfit.__version__
exclude_patterns = ["_build"]

extensions = ["myst_parser", "sphinx.ext.autodoc", "sphinx.ext.napoleon"]
myst_enable_extensions = ["dollarmath", "deflist"]
myst_heading_anchors = 3

autodoc_member_order = "bysource"
autodoc_typehints_format = "short"
autodoc_preserve_defaults = True
napoleon_google_docstring = False
napoleon_use_ivar = True
default_role = "literal"  # docstrings write names in single backquotes
python_use_unqualified_type_names = True

nitpicky = True
nitpick_ignore_regex = [
    # Types of the standard library and of what rotorfit is built on: they are not on this site.
    ("py:.*", r"(?!rotorfit).*"),
]

html_theme = "furo"
html_title = "rotorfit"
html_static_path = ["_static"]
html_css_files = ["rotorfit.css"]
html_js_files = ["versions.js", "switcher.js"]  # docs/versions.py fills in the first
html_math_renderer = "mathml"
html_theme_options = {
    "light_css_variables": {
        "color-brand-primary": "#1a5fa3",
        "color-brand-content": "#1a5fa3",
    },
    "dark_css_variables": {
        "color-brand-primary": "#7db4ee",
        "color-brand-content": "#7db4ee",
    },
}


def public_name(app, env, node, contnode):
    """Resolve a name by where it is defined to the public name; leave inner ones as text.

    A name that does not exist stays unresolved, and is then a warning.
    """
    target = node.get("reftarget", "")
    if node.get("refdomain") != "py" or not target.startswith("rotorfit."):
        return None
    thing = existing(target)
    if thing is None:
        return None
    name = target.rpartition(".")[2]
    public = getattr(rotorfit, name, None)
    if getattr(public, "__wrapped__", public) is thing:
        domain = env.get_domain("py")
        return domain.resolve_xref(
            env, node["refdoc"], app.builder, "obj", f"rotorfit.{name}", node, contnode
        )
    return contnode


def existing(target):
    """Return what a dotted name stands for; None where it stands for nothing."""
    module, _, name = target.rpartition(".")
    try:
        return getattr(importlib.import_module(module), name, None)
    except ImportError:
        return None


def without_generated_text(app, what, name, obj, options, lines):
    """Take out the docstring that a dataclass writes for itself: its own signature."""
    if inspect.isclass(obj) and lines and lines[0].startswith(f"{obj.__name__}("):
        lines.clear()


def mathml(translator, node):
    """Write a formula as MathML, which browsers draw themselves: no script, no network."""
    block = isinstance(node, nodes.math_block)
    # Without a font for mathematics, accents fall into the letter: these stand above it.
    body = tex2mathml(node.astext(), as_block=block)
    body = body.replace(' accent="true"', "").replace(">˙<", ">.<")
    translator.body.append(f'<div class="formula">{body}</div>' if block else body)
    raise nodes.SkipNode


def with_help(app, page, source):
    """Put what `rotorfit COMMAND --help` prints into the page of the command line."""
    if page != "commands":
        return
    program = typer.main.get_command(rotorfit.cli.main.app)
    parts = [
        f"## {name}\n\n```text\n{help_of(command, f'rotorfit {name}')}\n```\n"
        for name, command in program.commands.items()
    ]
    source[0] = source[0].replace("<!-- the help of every command -->", "\n".join(parts))


def help_of(command, name):
    return command.get_help(command.context_class(command, info_name=name, terminal_width=80))


def with_page(app, failed):
    """Put the page on which logs are dropped into the site, with the package that it runs."""
    if failed is None and app.builder.format == "html":
        pyodide = os.environ.get("ROTORFIT_PYODIDE")
        write_page(Path(app.outdir) / "app", None if pyodide is None else Path(pyodide))


def setup(app):
    app.connect("build-finished", with_page)
    app.connect("source-read", with_help)
    app.add_html_math_renderer("mathml", (mathml, None), (mathml, None))
    app.connect("missing-reference", public_name)
    app.connect("autodoc-process-docstring", without_generated_text)

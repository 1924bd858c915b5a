"""The documentation: pages from the Markdown files here, notebooks as stored, and a reference from docstrings."""

from __future__ import annotations

import shutil
import sys
from pathlib import Path
from types import ModuleType

import matplotlib as mpl
import matplotlib.pyplot as plt

HERE = Path(__file__).parent
ROOT = HERE.parent
sys.path.insert(0, str(ROOT))

import stewart_pin as stp  # noqa: E402
from tests.public_names import namespaces, public  # noqa: E402

project = "stewart_pin"
version = release = stp.__version__
extensions = ["myst_nb", "sphinx.ext.autodoc", "sphinx.ext.mathjax", "numpydoc"]
html_theme = "furo"
html_title = "stewart_pin"
html_static_path = ["style"]
html_css_files = ["pages.css"]
html_show_copyright = False
myst_enable_extensions = ["dollarmath", "deflist"]
myst_heading_anchors = 3
nb_execution_mode = "off"  # notebooks are shown as they were stored
numpydoc_show_class_members = False
numpydoc_class_members_toctree = False
autodoc_member_order = "bysource"
autodoc_typehints = "none"  # the signature owns the shape, the prose the meaning
suppress_warnings = ["mystnb.unknown_mime_type", "myst.header"]


def title_of(module: ModuleType) -> str:
    """Return the first sentence of what a module says of itself."""
    return (module.__doc__ or module.__name__).strip().splitlines()[0].rstrip(".")


def entry(name: str, value: object) -> str:
    """Return the directive that shows one public name."""
    if isinstance(value, type):
        members = "" if issubclass(value, BaseException) else "   :members:\n"
        return f".. autoclass:: stewart_pin.{name}\n{members}"
    kind = "autofunction" if callable(value) else "autodata"
    return f".. {kind}:: stewart_pin.{name}\n"


def reference_pages() -> dict[str, str]:
    """Return the text of each page of the reference by its name: the top of the package, then each namespace."""
    by_page: dict[str, list[str]] = {"top": []} | {space: [] for space in sorted(namespaces())}
    for name, value in sorted(public().items(), key=lambda item: item[0].lower()):
        by_page[name.split(".")[0] if "." in name else "top"].append(entry(name, value))
    pages = {}
    for page, entries in by_page.items():
        head = "stewart_pin" if page == "top" else page
        about = "The verbs of a first hour" if page == "top" else title_of(namespaces()[page])
        pages[page] = f"{head}\n{'=' * len(head)}\n\n{about}.\n\n" + "\n".join(entries)
    listed = "\n".join(f"   {page}" for page in pages)
    pages["index"] = f"Reference\n=========\n\n.. toctree::\n   :maxdepth: 1\n\n{listed}\n"
    return pages


def write_pictures(folder: Path) -> None:
    """Draw the pictures of the pages with the package itself."""
    mpl.use("Agg")
    for robot in ("stewart", "delta", "five_bar"):
        chain = stp.load(robot)
        axes = stp.viz.plot_chain(chain, chain.q_home)
        axes.figure.savefig(folder / f"{robot}.png", dpi=80, bbox_inches="tight")
        plt.close(axes.figure)


def write_sources(_: object) -> None:
    """Write what is made of the package: reference, pictures, and copies of the notebooks."""
    for name in ("reference", "pictures", "notebooks"):
        shutil.rmtree(HERE / name, ignore_errors=True)
        (HERE / name).mkdir()
    for page, text in reference_pages().items():
        (HERE / "reference" / f"{page}.rst").write_text(text, encoding="utf-8")
    for path in ROOT.glob("notebooks/*.ipynb"):
        shutil.copy(path, HERE / "notebooks")
    write_pictures(HERE / "pictures")


def setup(app: object) -> None:
    """Write the made sources before Sphinx looks for pages."""
    app.connect("builder-inited", write_sources)  # pyright: ignore[reportAttributeAccessIssue]

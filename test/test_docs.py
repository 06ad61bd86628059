"""The documentation: links, paths, names and made pages are as the repository is."""

import ast
import re
import runpy
import xml.etree.ElementTree as ElementTree
from pathlib import Path

import pytest

from tccm_ros.config import parameters

ROOT = Path(__file__).resolve().parents[1]
PAGES = sorted([*ROOT.glob("*.md"), *ROOT.glob("docs/**/*.md"), *ROOT.glob("interfaces/*.md")])
SOURCES = [p for top in ("tccm_ros", "bench", "test", "tools") for p in (ROOT / top).rglob("*.py")]

LINK = re.compile(r"!?\[[^\]]*\]\(([^)\s]+)\)")
PATH = re.compile(r"`((?:tccm_ros|test|bench|tools|config|launch|bags|docs)/[\w./-]*[./][\w-]*)`")
TEST = re.compile(r"`(test_\w+\.py)`")
FUNCTION = re.compile(r"`(test_\w+)`")
COMMAND = re.compile(r"`(?:nice )?python ((?:bench|tools|bags)/\w+\.py)")
TARGET = re.compile(r"`make ([a-z]+)`")
CODE = re.compile(r"<!-- code: ([^\s:]+)(?::(\w+))? -->\n```python\n")
STEP = re.compile(r"(?m)^\| [^|]+ \| `(tccm_ros/[\w/]+\.py)` \| (`[^|]+`) \|$")
SUFFIXES = {"geojson", "html", "json", "mcap", "npz", "pgm", "png", "ply", "scene", "yaml"}
"""What is a file's name, though a group has it too."""

FUNCTIONS = {
    name
    for path in (ROOT / "test").rglob("*.py")
    for name in re.findall(r"(?m)^ *def (test_\w+)", path.read_text())
}
GROUPS = {p.name.partition(".")[0] for p in parameters() if "." in p.name}


def name_of(page):
    return str(page.relative_to(ROOT))


def anchor(heading):
    """Return the id that a heading gets, as Python-Markdown's and GitHub's."""
    plain = re.sub(r"[^\w\s-]", "", heading.replace("`", "")).strip().lower()
    return re.sub(r"\s+", "-", plain)


def anchors(page):
    return {anchor(h) for h in re.findall(r"(?m)^#+ (.+)$", page.read_text())}


@pytest.mark.parametrize("page", PAGES, ids=name_of)
def test_every_link_leads_to_a_file_and_a_heading(page):
    for link in LINK.findall(page.read_text()):
        if link.startswith("http"):
            continue
        path, _, fragment = link.partition("#")
        target = (page.parent / path).resolve() if path else page
        assert target.exists(), f"{link}: no such file"
        assert not fragment or fragment in anchors(target), f"{link}: no such heading"


@pytest.mark.parametrize("page", PAGES, ids=name_of)
def test_every_file_that_a_page_names_is_there(page):
    text = page.read_text()
    for path in (*PATH.findall(text), *COMMAND.findall(text)):
        assert (ROOT / path).exists(), f"{path} is not there"
    for test in TEST.findall(text):
        assert list((ROOT / "test").rglob(test)), f"there is no {test}"
    for function in FUNCTION.findall(text):
        assert function in FUNCTIONS, f"there is no {function}"


@pytest.mark.parametrize("page", PAGES, ids=name_of)
def test_every_parameter_that_a_page_names_is_one(page):
    known = {p.name for p in parameters()}
    for group, name in re.findall(r"`(?:--set )?(\w+)\.(\w+)(?:[=:][^`]*)?`", page.read_text()):
        if group in GROUPS and name not in SUFFIXES:
            assert f"{group}.{name}" in known, f"there is no parameter {group}.{name}"


@pytest.mark.parametrize("page", PAGES, ids=name_of)
def test_every_make_target_that_a_page_names_is_one(page):
    targets = re.findall(r"(?m)^([a-z]+):", (ROOT / "Makefile").read_text())
    assert set(TARGET.findall(page.read_text())) <= set(targets)


@pytest.mark.parametrize("page", PAGES, ids=name_of)
def test_code_in_a_page_can_be_copied_from_its_file(page):
    text = page.read_text()
    assert len(CODE.findall(text)) == text.count("<!-- code")
    assert "--8<--" not in text, "only a site generator would show that"
    for path, section in CODE.findall(text):
        assert (ROOT / path).exists(), f"{path} is not there"
        marks = [f"# [{section}]\n", f"# [/{section}]\n"] if section else []
        assert all(mark in (ROOT / path).read_text() for mark in marks)


def functions_of(module):
    """Return the functions of a module, and its methods with and without their class."""
    tree = ast.parse(module.read_text())
    classes = [node for node in tree.body if isinstance(node, ast.ClassDef)]
    methods = [(c.name, n.name) for c in classes for n in c.body if isinstance(n, ast.FunctionDef)]
    plain = {node.name for node in tree.body if isinstance(node, ast.FunctionDef)}
    return plain | {name for _, name in methods} | {f"{c}.{name}" for c, name in methods}


def test_each_step_of_a_scan_is_a_function_of_its_module():
    """The table of one scan's way from the bag to surfaces.json names functions that exist."""
    steps = STEP.findall((ROOT / "docs" / "design" / "structure.md").read_text())
    assert len(steps) >= 12
    for module, names in steps:
        missing = set(re.findall(r"`([\w.]+)`", names)) - functions_of(ROOT / module)
        assert not missing, f"{module} has no {missing}"


def test_every_page_that_code_names_is_there():
    for source in SOURCES:
        for page in re.findall(r"docs/[\w/]+\.md", source.read_text()):
            assert (ROOT / page).exists(), f"{name_of(source)} names {page}"


def test_pages_that_are_made_are_as_the_code_says():
    made = runpy.run_path(str(ROOT / "tools" / "make_reference.py"))["pages"]()
    stale = [path.name for path, text in made.items() if path.read_text() != text]
    assert not stale, f"{stale}: run make reference"


def test_the_picture_of_the_layers_shows_each_layer():
    layers = runpy.run_path(str(ROOT / "test" / "test_structure.py"))["LAYERS"]
    picture = ElementTree.parse(ROOT / "docs" / "images" / "architecture.svg")
    words = " ".join(text for node in picture.iter() for text in node.itertext())
    missing = [layer for layer in layers if not re.search(rf"\b{layer}\b", words)]
    assert not missing, f"{missing}: run python tools/draw_architecture.py"


def test_every_page_is_reached_from_the_navigation():
    navigation = (ROOT / "mkdocs.yml").read_text()
    pages = {str(p.relative_to(ROOT / "docs")) for p in ROOT.glob("docs/**/*.md")}
    assert pages == set(re.findall(r"[\w/]+\.md", navigation))

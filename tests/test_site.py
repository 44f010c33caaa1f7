"""The documentation site: its navigation, and the pages that programs write."""

from __future__ import annotations

import importlib.util
import re
import sys
from pathlib import Path
from types import ModuleType

import pytest
import tilthex

ROOT = Path(__file__).parent.parent
# The results that nobody has written yet have pages that say so.
RESULTS = "docs/results/"


def loaded(name: str) -> ModuleType:
    spec = importlib.util.spec_from_file_location(name, ROOT / "packaging" / f"{name}.py")
    assert spec and spec.loader
    module = importlib.util.module_from_spec(spec)
    # Its classes look for their module.
    sys.modules[name] = module
    spec.loader.exec_module(module)
    return module


site, troubleshooting = loaded("pages"), loaded("troubleshooting")
NAVIGATED = list(site.entries(site.settings()["nav"]))


def test_every_page_is_in_the_navigation_once():
    assert len(NAVIGATED) == len(set(NAVIGATED))
    made = [site.page_of(notebook) for notebook in site.notebooks()]
    missing = {*site.pages(), *made, *site.unwritten_results()} - set(NAVIGATED)
    assert not missing, "zensical.toml has no entry in `nav` for these pages"


def test_every_entry_of_the_navigation_has_a_source():
    known = {*site.pages(), *site.unwritten_results()}
    gone = [page for page in NAVIGATED if page not in known and not (ROOT / site.source_of(page)).is_file()]
    assert not gone


def headings(text: str) -> set[str]:
    """The anchors of a page's headings, as the site and the repository's host make them."""
    lines = (line for line, outside in site.outside_code(text) if outside and line.startswith("#"))
    plain = (re.sub(r"[^\w\s-]", "", line.lstrip("# ").lower()) for line in lines)
    return {re.sub(r"\s", "-", line.strip()) for line in plain}


@pytest.mark.parametrize("page", [*site.pages(), *site.notebooks()])
def test_every_link_leads_somewhere(page):
    text = (ROOT / page).read_text(encoding="utf-8")
    for target, anchor in re.findall(r"\]\(([^)#\s]*)(?:#([^)\s]+))?\)", text):
        if re.match(r"\w+:", target):
            continue
        path = (ROOT / page).parent.joinpath(target).resolve() if target else ROOT / page
        if path.is_dir():
            path /= "README.md"
        source = path.relative_to(ROOT).as_posix()
        assert path.is_file() or source in site.unwritten_results(), f"{page} links to {target}"
        if anchor:
            assert anchor in headings(path.read_text(encoding="utf-8")), f"{page} links to {target}#{anchor}"


def test_the_api_pages_have_every_public_name():
    shown = re.findall(r"^::: (\S+)$", "\n".join(p.read_text() for p in ROOT.glob("docs/api/*.md")), re.M)
    assert len(shown) == len(set(shown))
    assert not {f"tilthex.{name}" for name in tilthex.__all__} - {"tilthex.__version__"} - set(shown)


def test_troubleshooting_is_what_its_program_writes():
    assert troubleshooting.PAGE.read_text(encoding="utf-8") == troubleshooting.text(), (
        "python packaging/troubleshooting.py writes the page"
    )


def test_every_fault_has_a_symptom():
    named = [name for symptom in troubleshooting.SYMPTOMS for name in symptom.faults]
    assert set(named) == set(troubleshooting.faults()), (
        "give each fault a symptom in SYMPTOMS of packaging/troubleshooting.py"
    )


def test_exit_statuses_are_those_of_the_program():
    source = troubleshooting.FAILURES.read_text(encoding="utf-8")
    given = re.findall(r"Kind::\w+ => (\d+),", source)
    assert [number for number, _ in troubleshooting.statuses()] == [int(number) for number in given]


@pytest.mark.parametrize(
    ("written", "shown"),
    [
        ("1. a\n   b\n   - c\n     d\n2. e\n", "1. a\n    b\n    - c\n        d\n2. e\n"),
        ("1. a\n\n   b\n2. c\n", "1. a\n\n    b\n\n2. c\n"),
        ("text:\n- a\n- b\nand\n", "text:\n\n- a\n- b\nand\n"),
        ("- a\n\n  ```sh\n  x\n    y\n  ```\n", "- a\n\n    ```sh\n    x\n      y\n    ```\n"),
        ("    code\n\n- a\n\n      code\n", "    code\n\n- a\n\n        code\n"),
    ],
)
def test_lists_have_the_indentation_of_the_generator(written, shown):
    assert site.indented(written) == shown


def test_the_gallery_shows_the_videos_under_the_titles_of_their_experiments(tmp_path, monkeypatch):
    made, page = tmp_path / "made", tmp_path / "gallery.md"
    made.mkdir()
    for name in ("sliding-K-y-2.5.gif", "peg-in-hole-soft-wrist.gif"):
        (made / name).write_bytes(b"film")
    page.write_text("# Gallery\n")
    monkeypatch.setattr(site, "VIDEOS", made)
    site._add_videos(page)
    lines = [line for line in page.read_text().splitlines() if line.startswith(("#", "!"))]
    assert lines == [
        "# Gallery",
        "## Peg in hole",
        "![Peg in hole](videos/peg-in-hole-soft-wrist.gif)",
        "## Sliding on a tilted board",
        "![Sliding on a tilted board](videos/sliding-K-y-2.5.gif)",
    ]
    assert (tmp_path / "videos" / "sliding-K-y-2.5.gif").read_bytes() == b"film"

"""The pages refer to what is in the repository, and their lines fit a screen."""

import re
import subprocess
from pathlib import Path

import pytest

ROOT = Path(__file__).parent.parent
PAGES = sorted(
    [*ROOT.glob("*.md"), *ROOT.glob("docs/*.md"), *ROOT.glob("docs/howto/*.md")], key=lambda page: page.name
)
LONGEST = 140
FOLDERS = "crates|python|tests|docs|vehicles|examples|benchmarks|truths|fuzz|packaging"
# What a reader of a how-to page makes.
MADE_BY_READERS = {
    "mine.toml",
    "my-flight.toml",
    "mine.py",
    "my_slide.py",
    "my-slide.toml",
    "crates/tilthex-link/src/mylink/mod.rs",
    "crates/tilthex-link/src/mylink/board.rs",
    "mylink.rs",
}


@pytest.fixture(scope="module")
def files():
    listed = subprocess.run(["git", "ls-files"], cwd=ROOT, capture_output=True, text=True)
    if listed.returncode:
        pytest.skip("no repository here")
    return set(listed.stdout.split())


@pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(ROOT)))
def test_a_page_refers_to_what_is_there(page, files):
    text = page.read_text()
    for target in re.findall(r"\]\(([^)#\s]+)", text):
        if not target.startswith(("http:", "https:")):
            found = (page.parent / target).resolve()
            generated = found.parent == ROOT / "docs" / "results"
            assert found.exists() or generated, f"link to {target}"
    named = re.findall(r"`([\w./-]+\.(?:rs|py|pyi|toml|md|sh|proto))`", text)
    named += re.findall(rf"`((?:{FOLDERS})/[\w./-]*)`", text)
    for name in set(named) - MADE_BY_READERS:
        path = name.rstrip("/")
        known = any(
            file == path or file.endswith("/" + path) or file.startswith(path + "/") for file in files
        )
        assert known, f"no file {name}"


@pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(ROOT)))
def test_lines_fit_a_screen(page):
    for number, line in enumerate(page.read_text().splitlines(), 1):
        # A row of a table is one line.
        assert len(line) <= LONGEST or line.startswith("|"), f"line {number} has {len(line)} characters"

"""Lays out the pages of the documentation site for `make docs`; `zensical.toml` has its navigation.

The pages are the files of `docs/` and those beside it, at the same places as in the
repository, so their links hold in both. Beside them are made, in the folder that `docs_dir` names:

- for each notebook of `examples/` a page with what it prints and draws when it runs;
- for each other file to which a page leads (a source, a vehicle, a schema) a page that shows its text;
- for each page of `benchmarks/results.py` that nobody has written yet, a page that says how to write it.
"""

from __future__ import annotations

import argparse
import importlib
import os
import re
import shutil
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

if sys.version_info >= (3, 11):
    import tomllib
else:
    import tomli as tomllib

ROOT = Path(__file__).resolve().parent.parent
SETTINGS = ROOT / "zensical.toml"
EXECUTED = ROOT / "out" / "executed"
VIDEOS = ROOT / "out" / "gallery"
NOTEBOOK = "# ---\n# jupyter:"
"""The start of a notebook that is stored as a Python script."""
ALLOWED = 300
"""A cell that runs longer ends the build, s."""
LANGUAGES = {
    ".py": "python",
    ".rs": "rust",
    ".toml": "toml",
    ".json": "json",
    ".sh": "bash",
    ".pyi": "python",
}
LINK = re.compile(r"(?<=\]\()([^)#\s]+)")
CRATE = re.compile(r"crates/([\w-]+)/src/lib.rs")
FENCE = re.compile(r"\s*(```+|~~~+)")
ITEM = re.compile(r"(\s*)([-*+]|\d+\.) +(?=\S)")


def settings() -> dict[str, Any]:
    """The table `[project]` of the site's settings."""
    project: dict[str, Any] = tomllib.loads(SETTINGS.read_text(encoding="utf-8"))["project"]
    return project


def entries(nav: list[dict[str, Any]]) -> Iterator[str]:
    """The pages of a navigation, in its order."""
    for entry in nav:
        for value in entry.values():
            if isinstance(value, str):
                yield value
            else:
                yield from entries(value)


def source_of(page: str) -> str:
    """The file of the repository from which a page of the site is made."""
    path = page.removesuffix(".md")
    if (ROOT / f"{path}.py").is_file():
        return f"{path}.py"
    return path if "." in Path(path).name else page


def page_of(source: str) -> str:
    """The page of the site that shows a file of the repository."""
    if source.endswith(".md"):
        return source
    return source.removesuffix(".py") + ".md" if is_notebook(ROOT / source) else f"{source}.md"


def is_notebook(path: Path) -> bool:
    """Whether a file is a notebook, stored as a script."""
    return path.suffix == ".py" and path.read_text(encoding="utf-8").startswith(NOTEBOOK)


def pages() -> list[str]:
    """The Markdown files of the repository that are pages of the site."""
    top = [
        ROOT / name
        for name in ("README.md", "CHANGELOG.md", "CONTRIBUTING.md", "SECURITY.md", "examples/README.md")
    ]
    found = [path for path in top if path.is_file()] + sorted((ROOT / "docs").rglob("*.md"))
    return [path.relative_to(ROOT).as_posix() for path in found]


def notebooks() -> list[str]:
    """The notebooks of `examples/`."""
    found = sorted((ROOT / "examples").glob("*.py"))
    return [path.relative_to(ROOT).as_posix() for path in found if is_notebook(path)]


def unwritten_results() -> dict[str, str]:
    """The pages of results that nobody has written yet, and what they say instead."""
    sys.path.insert(0, str(ROOT))
    known = importlib.import_module("benchmarks.results").PAGES
    made = {}
    for page in known:
        path = f"docs/results/{page.name}.md"
        if not (ROOT / path).exists():
            commands = "\n".join(f"    {command}" for command in page.commands)
            made[path] = (
                f"# {page.title}\n\nThis page has not been written for this version. "
                f"`python -m benchmarks.results {page.name}` writes it, from the output of:\n\n{commands}\n"
            )
    return made


def outside_code(text: str) -> Iterator[tuple[str, bool]]:
    """The lines of a page, each with whether it is outside of fenced code."""
    closing = None
    for line in text.splitlines():
        fence = FENCE.match(line)
        if closing is None and fence:
            closing = fence[1]
            yield line, False
        elif closing is not None:
            if fence and fence[1].startswith(closing):
                closing = None
            yield line, False
        else:
            yield line, True


def led(page: str, text: str, leads: set[str], rust: bool) -> str:
    """A page with its links to files led to the pages that show them; `leads` collects these files.

    With `rust`, a link to a crate's `src/lib.rs` leads to the pages that `cargo doc` makes of the crate.
    """
    folder = ROOT / Path(page).parent

    def lead(match: re.Match[str]) -> str:
        target = match[1]
        if re.match(r"\w+:", target):
            return target
        path = Path(os.path.normpath(folder / target))
        if path.is_dir():
            path /= "README.md"
        if not path.is_file() or path.suffix in (".md", ".png", ".svg", ".gif"):
            return os.path.relpath(path, folder)
        source = path.relative_to(ROOT).as_posix()
        if rust and (crate := CRATE.fullmatch(source)):
            # Each page is a folder of the site, except those that are the index of theirs.
            at = folder if Path(page).stem == "README" else (ROOT / page).with_suffix("")
            up = os.path.relpath(ROOT / "rust" / crate[1].replace("-", "_"), at)
            return f"{up}/index.html"
        if not is_notebook(path):
            leads.add(source)
        return os.path.relpath(ROOT / page_of(source), folder)

    return "\n".join(LINK.sub(lead, line) if outside else line for line, outside in outside_code(text)) + "\n"


def indented(text: str) -> str:
    """A page whose lists have the indentation of four columns that the generator needs.

    In the repository the text of an item is indented as far as its marker (CommonMark).
    """
    columns: list[int] = []
    # For each open list, whether its item has more than one paragraph.
    long: list[bool] = []
    lines: list[str] = []
    was_outside = True
    for line, outside in outside_code(text):
        if not line.strip():
            long = [True] * len(long)
            lines.append("")
            continue
        indentation = len(line) - len(line.lstrip())
        item = ITEM.match(line) if outside else None
        closed: list[bool] = []
        if outside or was_outside:
            while columns and indentation < columns[-1]:
                columns.pop()
                closed.append(long.pop())
        depth, inner = len(columns), columns[-1] if columns else 0
        if item:
            begins = not closed and depth == 0
            if (begins or any(closed)) and lines and lines[-1]:
                lines.append("")
            columns.append(item.end())
            long.append(False)
        lines.append(" " * (4 * depth + max(indentation - inner, 0)) + line.lstrip())
        was_outside = outside
    return "\n".join(lines) + "\n"


def execute(notebook: str, folder: Path) -> None:
    """Runs a notebook and writes its page, with the figures beside it, into a folder.

    Raises:
        SystemExit: A cell fails, or the notebook draws nothing.
    """
    import jupytext
    from nbclient import NotebookClient
    from nbclient.exceptions import CellExecutionError
    from nbconvert import MarkdownExporter

    stem = Path(notebook).stem
    read = jupytext.read(ROOT / notebook)
    with tempfile.TemporaryDirectory() as work:
        try:
            NotebookClient(
                read,
                # Not its note that other programs of this computer could listen.
                extra_arguments=["--IPKernelApp.log_level=40"],
                kernel_name="python3",
                resources={"metadata": {"path": work}},
                timeout=ALLOWED,
                coalesce_streams=True,
            ).execute()
        except CellExecutionError as error:
            sys.exit(f"{notebook} does not run:\n{error}")
    body, resources = MarkdownExporter().from_notebook_node(
        read, resources={"unique_key": stem, "output_files_dir": f"{stem}_files"}
    )
    figures = {name: data for name, data in resources["outputs"].items() if name.endswith(".png")}
    if not figures:
        sys.exit(f"{notebook} draws nothing; expected a figure, as each page of the tutorials has one")
    title, _, rest = body.strip().partition("\n")
    source = f"[{stem}.py]({stem}.py) runs as a script, or with jupytext as a notebook."
    body = f"{title}\n\n{source}\n{rest}"
    for name, data in figures.items():
        body = body.replace(f"![png]({name})", f"![{title.strip('# ')}]({name})")
        path = folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(data)
    (folder / f"{stem}.md").write_text(body + "\n", encoding="utf-8")


def lay_out(stage: Path, keep: bool, rust: bool) -> None:
    """Writes all pages into a folder."""
    shutil.rmtree(stage, ignore_errors=True)
    leads: set[str] = set()
    texts = {page: (ROOT / page).read_text(encoding="utf-8") for page in pages()} | unwritten_results()
    for page, text in texts.items():
        _write(stage / page, led(page, indented(text), leads, rust))
    for page in entries(settings()["nav"]):
        source = source_of(page)
        if not source.endswith(".md") and not is_notebook(ROOT / source):
            leads.add(source)
    for source in sorted(leads):
        text = (ROOT / source).read_text(encoding="utf-8")
        language = LANGUAGES.get(Path(source).suffix, "text")
        _write(stage / page_of(source), f"# {source}\n\n~~~~{language}\n{text.rstrip()}\n~~~~\n")
    shutil.copytree(ROOT / "docs" / "images", stage / "docs" / "images")
    for style in settings()["extra_css"]:
        shutil.copy(ROOT / style, stage / style)
    _add_videos(stage / "docs" / "gallery.md")
    EXECUTED.mkdir(parents=True, exist_ok=True)
    for notebook in notebooks():
        stem = Path(notebook).stem
        if not (keep and (EXECUTED / f"{stem}.md").exists()):
            print(f"{notebook} ...", flush=True)
            shutil.rmtree(EXECUTED / f"{stem}_files", ignore_errors=True)
            execute(notebook, EXECUTED)
        text = (EXECUTED / f"{stem}.md").read_text(encoding="utf-8")
        _write(stage / "examples" / f"{stem}.md", led(f"examples/{stem}.md", indented(text), leads, rust))
        shutil.copytree(EXECUTED / f"{stem}_files", stage / "examples" / f"{stem}_files")
        shutil.copy(ROOT / notebook, stage / "examples")


def _add_videos(page: Path) -> None:
    """Shows the videos that `make gallery` has made, under the titles of their experiments."""
    lines = [page.read_text(encoding="utf-8")]
    for experiment in sorted((ROOT / "python" / "tilthex" / "experiments").glob("*.toml")):
        videos = sorted(VIDEOS.glob(f"{experiment.stem}-*.gif"))
        if videos:
            title = tomllib.loads(experiment.read_text(encoding="utf-8"))["title"]
            lines += [f"## {title}", "", f"`tilthex experiment {experiment.stem} --short --video`", ""]
        for video in videos:
            lines += [f"![{title}](videos/{video.name})", ""]
            (page.parent / "videos").mkdir(exist_ok=True)
            shutil.copy(video, page.parent / "videos")
    _write(page, "\n".join(lines))


def _write(path: Path, text: str) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(text, encoding="utf-8")


def main() -> None:
    """Lays out the site's pages."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--keep", action="store_true", help="take notebooks that ran before as they are")
    parser.add_argument(
        "--rust", action="store_true", help="lead to the pages of `cargo doc`, in rust/ of the site"
    )
    arguments = parser.parse_args()
    lay_out(ROOT / settings()["docs_dir"], arguments.keep, arguments.rust)


if __name__ == "__main__":
    main()

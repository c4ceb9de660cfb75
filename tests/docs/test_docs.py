"""The documentation says what is there: links, citations, the tree, the layers, the index."""

import re
import tomllib
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
DOCS = ROOT / "docs"
RECORDS = sorted((DOCS / "decisions").iterdir())
PAGES = [ROOT / "README.md", ROOT / "CHANGELOG.md", *sorted(DOCS.rglob("*.md"))]
LONGEST_RECORD = 25
WIDEST_LINE = 140


def sources():
    """Every text of the project that may cite a record, tests excepted: they have figures that look like numbers."""
    for folder, kinds in {"src": "py", "native": "[ch]pp", "benchmarks": "py", "examples": "py"}.items():
        yield from sorted((ROOT / folder).rglob(f"*.{kinds}"))
    yield from (ROOT / "CMakeLists.txt", ROOT / "Makefile", ROOT / "pyproject.toml")
    yield from PAGES


def block(language):
    """Lines of the first fenced block of a language in architecture.md."""
    text = (DOCS / "architecture.md").read_text()
    return re.search(rf"^```{language}\n(.*?)^```$", text, re.DOTALL | re.MULTILINE)[1].splitlines()


@pytest.mark.parametrize("record", RECORDS, ids=lambda path: path.stem)
def test_a_record_is_short_and_has_three_parts(record):
    lines = record.read_text().splitlines()
    assert len(lines) <= LONGEST_RECORD
    assert max(map(len, lines)) <= WIDEST_LINE
    assert re.fullmatch(r"\d{4}-[a-z0-9-]+\.md", record.name) and lines[0].startswith("# ")
    parts = [line[2:].partition(".")[0] for line in lines if line.startswith("**")]
    assert parts == ["Context", "Decision", "Consequences"]


def test_record_numbers_are_unique_and_notes_belong_to_records():
    numbers = [record.name[:4] for record in RECORDS]
    assert len(set(numbers)) == len(numbers)
    assert {note.name[:4] for note in (DOCS / "notes").iterdir()} <= set(numbers)


def test_every_cited_record_exists():
    numbers = {record.name[:4] for record in RECORDS}
    cited = {}
    for path in sources():
        text = path.read_text()
        for number in re.findall(r"docs/decisions/(\d{4})|\b(?:[Rr]ecords?|[Dd]ecisions?)\s(\d{4})", text):
            cited.setdefault(number[0] or number[1], path)
    assert cited, "nothing cites a record: the pattern is wrong"
    assert {number: path for number, path in cited.items() if number not in numbers} == {}


def test_nothing_refers_to_what_a_reader_lacks():
    absent = re.compile(r"\.\./shared|/work/|measured\.md|ARCHITECTURE|[Ii]ssue \d|research/")
    found = {str(path): absent.findall(path.read_text()) for path in sources()}
    assert {path: words for path, words in found.items() if words} == {}


@pytest.mark.parametrize("page", PAGES, ids=lambda path: str(path.relative_to(ROOT)))
def test_relative_links_resolve(page):
    text = re.sub(r"```.*?```", "", page.read_text(), flags=re.DOTALL)
    for target in re.findall(r"\]\(([^)\s]+)\)", text):
        if "://" in target:
            continue
        path, _, heading = target.partition("#")
        there = page if not path else page.parent / path
        assert there.exists(), f"{page}: {target}"
        if heading:
            headings = re.findall(r"^#+ (.*)$", there.read_text(), re.MULTILINE)
            assert heading in {re.sub(r"[^\w -]", "", title).lower().replace(" ", "-") for title in headings}, target


def test_the_index_lists_every_page_and_example():
    listed = {(DOCS / target).resolve() for target in re.findall(r"\]\(([^)#]+)", (DOCS / "index.md").read_text())}
    pages = {page.resolve() for page in DOCS.rglob("*.md")} - {DOCS / "index.md"}
    assert (pages | set((ROOT / "examples").glob("*.py"))) - listed == set()
    assert "docs/index.md" in (ROOT / "README.md").read_text()


def test_the_tree_is_that_of_the_folders():
    listed, above = [], []
    for line in block(""):
        indent, name = (len(line) - len(line.lstrip())) // 2, line.split()[0]
        above = [*above[:indent], name]
        listed.append("".join(above))
        assert name == "src/goc/" or len(line.split()) > 3, f"{name}: says nothing"
    files = [path for top in ("native", "src/goc") for path in (ROOT / top).rglob("*") if path.is_file()]
    folders = {f"{path.parent.relative_to(ROOT)}/" for path in files if path.parent.name != "__pycache__"}
    modules = {f"src/goc/{path.name}" for path in (ROOT / "src/goc").glob("*.py") if path.name != "__init__.py"}
    assert set(listed) - (folders | modules) == set(), "in the tree, but not there"
    assert (folders | modules) - set(listed) == set(), "there, but not in the tree"


def test_the_layers_are_those_that_are_enforced():
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())
    enforced = []
    for layer in project["tool"]["importlinter"]["contracts"][0]["layers"]:
        parts = [part.strip() for part in re.split(r"[|:]", layer)]
        enforced.append({part.removeprefix("goc.") for part in parts if not part.startswith("(")})
    assert [{part.strip() for part in line.split("|")} for line in block("layers")] == enforced

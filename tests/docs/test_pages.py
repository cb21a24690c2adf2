"""The documentation tells the truth: what its pages and the README show runs. The guides and extensions have files of their
own, so that they are tested side by side."""

import pytest

from tests.docs.blocks import Block, blocks, commands, missing, mistakes
from tests.docs.pages import RUN, TEXT, follow


@pytest.mark.parametrize("page", [page for page in RUN if not page.startswith(("docs/guides/", "docs/extend/"))])
def test_what_a_page_shows_runs(page, tmp_path):
    follow(page, tmp_path)


@pytest.mark.parametrize("page", TEXT)
def test_every_fence_of_a_page_says_what_it_is(page):
    wrong = [f"{page}:{block.line}: {mistake}" for block in blocks(TEXT[page]) for mistake in mistakes(block)]
    assert wrong == []


PAGE = """a
```python
x = 1
```
```yaml my.yaml
a: 1
```
```python no-run: it never ends
while True: pass
```
```{note}
No block.
```
```console exit 1
$ raybench compare a \\
    b
speed 1.25 times
$ true
```
"""


def test_blocks_are_found_with_their_lines_and_words():
    found = blocks(PAGE)
    assert [(block.language, block.file, block.line, block.runs) for block in found] == [
        ("python", None, 3, True),
        ("yaml", "my.yaml", 6, True),
        ("python", None, 9, False),
        ("console", None, 15, True),
    ]
    assert [mistakes(block) for block in found] == [[]] * 4
    first, second = commands(found[3])
    assert (first.line, first.text, first.output) == (15, "raybench compare a b", ("speed 1.25 times",))
    assert (second.line, second.text, second.output) == (18, "true", ())


@pytest.mark.parametrize(
    "block",
    [
        Block("", (), "x", 1),
        Block("bash", (), "ls", 1),
        Block("python", ("no-run",), "x", 1),
        Block("python", ("no-run:", "reason"), "x", 1),
        Block("python", ("scene",), "x", 1),
        Block("yaml", ("box",), "x", 1),
        Block("text", ("scene",), "x", 1),
        Block("console", (), "output alone", 1),
    ],
)
def test_a_fence_that_says_nothing_or_nonsense_is_refused(block):
    assert len(mistakes(block)) == 1


def test_output_is_compared_but_for_numbers_and_space():
    printed = "engine  numba\n  error 0.0125 after 3.1e-2 s\nwritten: out/a.png\n"
    assert missing(("error 1 after 2 s",), printed) is None
    assert missing(("engine numba", "...", "written: ...a.png"), printed) is None
    assert missing(("error is 1 after 2 s",), printed) == "error is 1 after 2 s"
    assert missing(("error 1 after 2 s", "engine numba"), printed) == "engine numba"

"""What the pages of docs/guides show runs."""

import pytest

from tests.docs.pages import RUN, follow


@pytest.mark.parametrize("page", [page for page in RUN if page.startswith("docs/guides/")])
def test_what_a_page_shows_runs(page, tmp_path):
    follow(page, tmp_path)

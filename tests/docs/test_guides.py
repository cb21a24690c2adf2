"""What the pages of docs/guides show runs."""

import pytest

from tests.docs.pages import RUN, follow
from tests.needs import needs

NEED = {"docs/guides/my_integrator.md": "mitsuba-llvm"}


@pytest.mark.parametrize(
    "page",
    [pytest.param(page, marks=needs(NEED[page]) if page in NEED else ()) for page in RUN if page.startswith("docs/guides/")],
)
def test_what_a_page_shows_runs(page, tmp_path):
    follow(page, tmp_path)

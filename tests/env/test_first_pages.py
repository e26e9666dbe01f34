"""What a newcomer types first: the Python of README.md and of docs/getting-started.md."""

import pytest
from pages import run_page


@pytest.mark.parametrize("page", ["../../README", "../getting-started"])
def test_the_first_pages_run(page, tmp_path):
    assert run_page(page, tmp_path)

"""Does the page on CleanRL work as it is printed?"""

from pages import run_page


def test_blocks_of_the_page_run(tmp_path):
    assert run_page("cleanrl", tmp_path).strip() == "[100 100]"

"""Does the page on Minari work as it is printed?"""

from pages import run_page


def test_blocks_of_the_page_run(tmp_path):
    printed = run_page("minari", tmp_path)
    assert "(101, 4) (100, 1)" in printed

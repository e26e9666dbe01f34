"""Does the page on python-control work as it is printed?"""

from pages import run_page


def test_blocks_of_the_page_run(tmp_path):
    first, last = (
        float(word) for word in run_page("python-control", tmp_path).split() if "e-" in word
    )
    assert last < 0.01 * first

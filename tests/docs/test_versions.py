"""Do package, citation and changelog state one version, and is a difference refused?"""

import sys
from pathlib import Path

ROOT = Path(__file__).parents[2]
sys.path.insert(0, str(ROOT / "docs"))
import one_version  # noqa: E402 - a script of the release workflow


def test_every_file_states_one_version():
    assert one_version.main([]) is None
    assert len(one_version.stated(ROOT)) == 3


def test_a_tag_of_another_version_is_refused():
    (own,) = set(one_version.stated(ROOT).values())
    assert one_version.main([f"v{own}"]) is None
    assert f"the tag v{own}1 {own}1" in one_version.main([f"v{own}1"])

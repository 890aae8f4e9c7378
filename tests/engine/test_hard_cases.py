"""H1 to H14 at three sizes and three offsets (see hard_cases.py, which also prints their table)."""

import hard_cases_of_glass  # noqa: F401  (enters its families)
import pytest
from hard_cases import FAMILIES, HOME, cases


@pytest.mark.parametrize(("name", "kind", "place"), [
    pytest.param(*case, id=f"{case[0].split()[0]}-{case[1]}-{case[2].size:g}-{case[2].offset:g}",
                 marks=() if case[2] == HOME and case[1] != "refracted" else pytest.mark.slow) for case in cases()])
def test_hard_case(name, kind, place):
    wrong = [f for f in FAMILIES[name][0](place, kind) if not f.error <= f.bound]
    assert not wrong

"""A bounded number of `wild_runs`: nothing ends in a traceback, a silent wrong number or a hang."""
import pytest
from wild_runs import COUNTS, HANG, LINE, RIGHT, TRACEBACK, WRONG, Runs


@pytest.mark.parametrize('kind', COUNTS)
def test_legal_but_extreme(kind, models, tmp_path):
    classes, wrong = Runs(tmp_path, models).run(kind, COUNTS[kind])
    assert not wrong, '\n'.join(wrong)
    assert classes[TRACEBACK] == classes[WRONG] == classes[HANG] == 0
    # a driver whose every run is refused, or none, would test nothing
    assert classes[RIGHT] and (kind == 'streams' or classes[LINE])

"""The state diagram and the parameter table in the documentation are those of the code."""
import re
from pathlib import Path

import pytest

from style_servo.parameters import BRIDGE
from style_servo.states import EDGES, Event, State, mermaid

DOCS = Path(__file__).resolve().parents[3] / 'docs'


@pytest.mark.skipif(not DOCS.is_dir(), reason='only in the source tree')
def test_the_documentation_shows_diagram_events_and_parameters_of_the_code():
    text = (DOCS / 'servo.md').read_text()
    assert mermaid() in text
    assert BRIDGE.markdown() in text
    assert all(f'| {event.name.lower()} | {event.value} |' in text for event in Event)


@pytest.mark.skipif(not DOCS.is_dir(), reason='only in the source tree')
def test_every_test_that_the_hazard_list_names_exists():
    section = (DOCS / 'safety.md').read_text().partition('## Hazards')[2].partition('\n## ')[0]
    rows = [line for line in section.splitlines() if line.startswith('| ')][2:]
    assert len(rows) > 20
    for row in rows:
        named = re.findall(r'`([\w/]+\.py)::(\w+)`', row.split('|')[-2])
        assert named, row
        for path, name in named:
            assert f'def {name}(' in (DOCS.parent / path).read_text(), (path, name)


def test_the_messages_numbers_are_those_of_the_states():
    path = DOCS.parent / 'src' / 'style_msgs' / 'msg' / 'BridgeState.msg'
    if not path.exists():
        pytest.skip('only in the source tree')
    for state in State:
        assert f'uint8 {state.name}={int(state)} ' in path.read_text()
    assert {state for state, _ in EDGES} == set(State)

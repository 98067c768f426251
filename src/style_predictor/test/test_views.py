"""Layouts of plotting programs speak of topics and fields that exist."""
import json
import re
from pathlib import Path
from xml.etree import ElementTree

from diagnostic_msgs.msg import DiagnosticArray
from sensor_msgs.msg import JointState

from style_core.phase_style import load_behaviours
from style_msgs.msg import StyleEstimate

CONFIG = Path(__file__).resolve().parents[3] / 'config'
TOPICS = {'/joint_states': JointState, '/predictor/filled': JointState, '/predictor/ahead': JointState,
          '/predictor/estimate': StyleEstimate, '/diagnostics': DiagnosticArray}


def panels(layout):
    return [layout] if isinstance(layout, str) else panels(layout['first']) + panels(layout['second'])


def test_foxglove():
    view = json.loads((CONFIG / 'views' / 'foxglove.json').read_text())
    assert sorted(panels(view['layout'])) == sorted(view['configById'])
    paths = [path['value'] for panel in view['configById'].values() for path in panel.get('paths', ())]
    assert len(paths) > 8
    for path in paths:
        topic, field = re.fullmatch(r'(/[\w/]+)\.(\w+)(?:\[\d+\])?', path).groups()
        assert ('[' in path) == TOPICS[topic].get_fields_and_field_types()[field].startswith('sequence'), path


def test_plotjuggler():
    joints = load_behaviours(CONFIG / 'models' / 'locomotion.npz')[0].joint_names
    curves = [curve.get('name') for curve in ElementTree.parse(CONFIG / 'views' / 'plotjuggler.xml').iter('curve')]
    assert len(curves) > 12
    for curve in curves:
        topic = next(topic for topic in TOPICS if curve.startswith(topic + '/'))
        rest = curve[len(topic) + 1:]
        if TOPICS[topic] is JointState:
            joint, field = rest.rsplit('/', 1)
            assert joint in joints and field == 'position', curve
        else:
            assert rest.split('[')[0] in TOPICS[topic].get_fields_and_field_types(), curve

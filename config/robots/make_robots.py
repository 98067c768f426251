#!/usr/bin/env python3
"""Write the robot descriptions (.urdf) of this folder: simple shapes, for RViz, Foxglove and forward kinematics.

humanoid20.urdf   20 joints, named, limited and turning as those of the ROBOTIS OP3; the shapes and rounded lengths are
                  made here
exosuit6.urdf     hips, knees and ankles of a standing person, sagittal plane
cmu.urdf          the channels of the CMU skeleton, as chains of single joints, from config/skeletons/person.asf
"""
import sys
from pathlib import Path
from xml.sax.saxutils import quoteattr

import numpy as np

FOLDER = Path(__file__).resolve().parent
WIDE = 0.6 * np.pi


def numbers(values):
    return ' '.join(f'{value + 0.0:.5g}' for value in values)


def link(name, shape=None, colour='0.8 0.8 0.85 1'):
    """A link; ``shape`` is (centre, size) of a box."""
    if shape is None:
        return f'  <link name={quoteattr(name)}/>\n'
    centre, size = shape
    return (f'  <link name={quoteattr(name)}>\n    <visual>\n      <origin xyz="{numbers(centre)}" rpy="0 0 0"/>\n'
            f'      <geometry><box size="{numbers(size)}"/></geometry>\n'
            f'      <material name="c{colour.replace(" ", "_").replace(".", "")}"><color rgba="{colour}"/></material>\n'
            f'    </visual>\n  </link>\n')


def joint(name, parent, child, origin, axis, limits, velocity=10.0, effort=100.0):
    """A revolute joint, or a fixed one where ``axis`` is None."""
    kind = 'fixed' if axis is None else 'revolute'
    inside = '' if axis is None else (
        f'    <axis xyz="{numbers(axis)}"/>\n'
        f'    <limit lower="{limits[0]:.5g}" upper="{limits[1]:.5g}" effort="{effort:g}" velocity="{velocity:g}"/>\n')
    return (f'  <joint name={quoteattr(name)} type="{kind}">\n    <parent link={quoteattr(parent)}/>\n'
            f'    <child link={quoteattr(child)}/>\n    <origin xyz="{numbers(origin)}" rpy="0 0 0"/>\n{inside}'
            f'  </joint>\n')


def robot(name, parts):
    return f'<?xml version="1.0"?>\n<robot name="{name}">\n{"".join(parts)}</robot>\n'


def humanoid():
    """Axes of the OP3: at zero it stands straight with the arms out to the sides."""
    parts = [link('body_link', ((0, 0, 0.07), (0.08, 0.10, 0.14)), '0.25 0.3 0.4 1')]

    def add(name, parent, origin, axis, shape):
        child = name + '_link'
        parts.extend([link(child, shape), joint(name, parent, child, origin, axis, (-WIDE, WIDE), 4.5, 4.1)])
        return child
    for side, s in (('l', 1), ('r', -1)):
        at = add(f'{side}_hip_yaw', 'body_link', (0, 0.035 * s, 0), (0, 0, -1), ((0, 0, -0.01), (0.03, 0.03, 0.02)))
        at = add(f'{side}_hip_roll', at, (0, 0, -0.03), (-1, 0, 0), ((0, 0, 0), (0.03, 0.03, 0.03)))
        at = add(f'{side}_hip_pitch', at, (0, 0, 0), (0, s, 0), ((0, 0, -0.055), (0.035, 0.04, 0.09)))
        at = add(f'{side}_knee', at, (0, 0, -0.11), (0, s, 0), ((0, 0, -0.055), (0.03, 0.035, 0.09)))
        at = add(f'{side}_ank_pitch', at, (0, 0, -0.11), (0, -s, 0), ((0, 0, 0), (0.03, 0.03, 0.03)))
        at = add(f'{side}_ank_roll', at, (0, 0, 0), (1, 0, 0), ((0.01, 0, -0.03), (0.12, 0.07, 0.01)))
        parts.extend([link(f'{side}_toe_link'),
                      joint(f'{side}_toe', at, f'{side}_toe_link', (0.07, 0, -0.03), None, ())])
        at = add(f'{side}_sho_pitch', 'body_link', (0, 0.06 * s, 0.11), (0, s, 0),
                 ((0, 0.01 * s, 0), (0.03, 0.02, 0.03)))
        at = add(f'{side}_sho_roll', at, (0, 0.03 * s, 0), (-1, 0, 0), ((0, 0.045 * s, 0), (0.03, 0.08, 0.03)))
        at = add(f'{side}_el', at, (0, 0.09 * s, 0), (1, 0, 0), ((0, 0.05 * s, 0), (0.025, 0.09, 0.025)))
        parts.extend([link(f'{side}_hand_link'),
                      joint(f'{side}_hand', at, f'{side}_hand_link', (0, 0.1 * s, 0), None, ())])
    at = add('head_pan', 'body_link', (0, 0, 0.14), (0, 0, 1), ((0, 0, 0.01), (0.02, 0.02, 0.02)))
    at = add('head_tilt', at, (0, 0, 0.03), (0, -1, 0), ((0.01, 0, 0.035), (0.07, 0.09, 0.07)))
    parts.extend([link('head', None), joint('head_top', at, 'head', (0, 0, 0.07), None, ())])
    return robot('humanoid20', parts)


def exosuit():
    parts = [link('pelvis', ((0, 0, 0.05), (0.2, 0.32, 0.1)), '0.25 0.3 0.4 1')]
    for side, s in (('left', 1), ('right', -1)):
        rows = ((f'{side}_hip', 'pelvis', (0, 0.1 * s, 0), (0, -1, 0), (-0.5, 1.6), 0.42),
                (f'{side}_knee', f'{side}_thigh', (0, 0, -0.42), (0, 1, 0), (0.0, 1.9), 0.42),
                (f'{side}_ankle', f'{side}_shank', (0, 0, -0.42), (0, -1, 0), (-0.8, 0.5), 0.0))
        for (name, parent, origin, axis, limits, length), child in zip(rows, ('thigh', 'shank', 'foot')):
            child = f'{side}_{child}'
            shape = ((0, 0, -0.5 * length), (0.08, 0.08, 0.9 * length)) if length else \
                ((0.06, 0, -0.06), (0.24, 0.09, 0.04))
            motor = (4.0, 4.1) if child.endswith('foot') else (3.0, 10.6)
            parts.extend([link(child, shape), joint(name, parent, child, origin, axis, limits, *motor)])
        parts.extend([link(f'{side}_toe'),
                      joint(f'{side}_tip', f'{side}_foot', f'{side}_toe', (0.18, 0, -0.06), None, ())])
    return robot('exosuit6', parts)


def cmu(skeleton):
    """A skeleton as a chain of single joints for each body, z up."""
    turn = np.array([[0, 0, 1], [1, 0, 0], [0, 1, 0]], dtype=float)
    places, _ = skeleton.rest()
    axes = skeleton.rest_axes()
    names, parts = skeleton.body_names, [link('world')]
    for index, body in enumerate(skeleton.bodies):
        parent = body.parent
        if parent < 0:
            parts.extend([link(names[index]), joint('root_joint', 'world', names[index], (0, 0, 0), None, ())])
            continue
        # the bone begins where its parent ends; its joints sit there
        bone = turn @ (places[index] - places[parent])
        at, origin = names[parent], np.zeros(3)
        if skeleton.bodies[parent].parent >= 0:
            origin = turn @ (places[parent] - places[skeleton.bodies[parent].parent])
        for channel in body.channels:
            if channel.kind != 'r':
                continue
            child = f'{channel.name}_link'
            limits = (-np.pi, np.pi)
            parts.extend([link(child), joint(channel.name, at, child, origin, turn @ axes[channel.name][1], limits)])
            at, origin = child, np.zeros(3)
        size = np.maximum(np.abs(bone), 0.04)
        parts.extend([link(names[index], (0.5 * bone, size)),
                      joint(f'{names[index]}_bone', at, names[index], origin, None, ())])
    return robot('cmu', parts)


def main():
    sys.path.insert(0, str(FOLDER.parents[1] / 'src' / 'style_core'))
    from style_core.skeleton import read_skeleton
    (FOLDER / 'humanoid20.urdf').write_text(humanoid())
    (FOLDER / 'exosuit6.urdf').write_text(exosuit())
    person = FOLDER.parent / 'skeletons' / 'person.asf'
    if person.exists():
        (FOLDER / 'cmu.urdf').write_text(cmu(read_skeleton(person)))


if __name__ == '__main__':
    main()

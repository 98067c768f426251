"""Fragments of real motion for the effort experiments: steps and jumps of several people, five contents."""
import argparse
from functools import cache
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from tqdm import tqdm

from style_core import datasets
from style_core.contacts import foot_contacts
from style_core.effort import EFFORTS, joint_scale
from style_core.effort.pose import PoseSpace, pose_space
from style_core.motion import Motion
from style_core.skeleton import read_skeleton

__all__ = ['CONTENTS', 'EFFORTS', 'Fragment', 'People', 'all_fragments', 'balanced', 'parser', 'people', 'scale_of',
           'skeleton_of']

CONTENTS = ('walk left', 'walk right', 'run left', 'run right', 'jump')
RATE_HZ = 60.0
#: fingers, thumbs and toes are constant or noise; wrists of some subjects too
JOINTS = ('!*fingers*', '!*thumb*', '!*hand*', '!*toes*', '!*wrist*')


def parser(description):
    """Argument parser with the options all experiments have."""
    result = argparse.ArgumentParser(description=description, formatter_class=argparse.RawDescriptionHelpFormatter)
    result.add_argument('--seed', type=int, default=0)
    result.add_argument('--output', default='docs/results/effort', help='folder for the page and the pictures')
    return result


class Fragment(NamedTuple):
    """A unit of motion of one person."""

    motion: Motion
    content: int
    subject: str
    trial: str


@cache
def skeleton_of(subject):
    """Skeleton of a subject; subject 13 has none on file, 16 stands in."""
    subject = '16' if subject == '13' else subject
    return read_skeleton(datasets.mocap_folder() / 'cmu' / subject / f'{subject}.asf')


@cache
def all_fragments():
    """Every step and jump found from foot contacts in the walking, running and jumping trials."""
    found = []
    actions = {'walk': 0, 'slow_walk': 0, 'run': 2}
    for name in [*datasets.trials(action=('walk', 'slow_walk', 'run', 'jump')), '131_07', '131_08']:
        row = next(row for row in datasets.labels() if row.name == name)
        if row.rate_hz < RATE_HZ:
            continue  # the 30 Hz runs: effort needs derivatives
        motion = datasets.trial(name, RATE_HZ)
        feet = foot_contacts(motion, skeleton_of(row.subject))
        if row.action in ('jump', 'styled'):
            cuts = _jumps(motion, feet)
        else:
            cuts = _steps(feet, actions[row.action])
        for number, (start, stop, content) in enumerate(cuts):
            piece = motion.slice(start, stop + 0.5 / RATE_HZ).select(*JOINTS)
            found.append(Fragment(piece.replace(name=f'{name}.{number}', times=piece.times - piece.times[0]),
                                  content, row.subject, name))
    return tuple(found)


def _steps(feet, base):
    strikes = sorted([(t, 0) for t in feet['left'].heel_strikes] + [(t, 1) for t in feet['right'].heel_strikes])
    for (start, side), (stop, other) in pairwise(strikes):
        if side != other and 0.2 < stop - start < 1.2:
            yield start, stop, base + side


def _jumps(motion, feet):
    offs, lands = feet['left'].toe_offs, feet['left'].heel_strikes
    for off in offs:
        landing = lands[lands > off]
        if len(landing) and np.abs(feet['right'].toe_offs - off).min(initial=9.0) < 0.1 and landing[0] - off < 0.8:
            start, stop = off - 0.7, landing[0] + 0.4
            if start >= motion.times[0] and stop <= motion.times[-1]:
                yield start, stop, 4
                return  # the main jump only


def balanced(fragments, each=12, seed=0, per_trial=2):
    """``each`` fragments a content, spread over subjects as evenly as they allow."""
    generator = np.random.default_rng(seed)
    chosen = []
    for content in range(len(CONTENTS)):
        pool = [f for f in fragments if f.content == content]
        pool = [pool[k] for k in generator.permutation(len(pool))]
        by_subject = {}
        for fragment in pool:
            queue = by_subject.setdefault(fragment.subject, [])
            if sum(other.trial == fragment.trial for other in queue) < per_trial:
                queue.append(fragment)
        picked = []
        while len(picked) < each and any(by_subject.values()):
            for subject in sorted(by_subject):
                if by_subject[subject] and len(picked) < each:
                    picked.append(by_subject[subject].pop(0))
        chosen += picked
    return chosen


def scale_of(fragments):
    """Weights of the joints, shape (D,), see `joint_scale`."""
    return joint_scale([f.motion for f in fragments if f.subject != '13'], skeleton_of(fragments[0].subject))


class People(NamedTuple):
    """One person after the other held out: all fragments, weights of joints, pose space, random numbers."""

    everything: tuple
    scale: np.ndarray
    space: PoseSpace
    generator: np.random.Generator

    def held_out(self, seed):
        """Subject, fragments of a library without them, their own fragments; a bar shows how far it is."""
        for subject in tqdm(sorted({f.subject for f in self.everything}), desc='subjects', disable=None):
            yield (subject, balanced([f for f in self.everything if f.subject != subject], seed=seed),
                   [f for f in self.everything if f.subject == subject])


def people(seed):
    """Set-up of the experiments with people that the library has never seen."""
    everything = all_fragments()
    return People(everything, scale_of(balanced(everything, seed=seed)), pose_space([one.motion for one in everything]),
                  np.random.default_rng(seed))

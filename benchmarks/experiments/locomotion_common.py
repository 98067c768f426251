"""What the locomotion experiments share: recordings, labels, foot contacts, the single-cycle and functional
baselines."""
import argparse
import os
from pathlib import Path

for _name in ('OMP_NUM_THREADS', 'OPENBLAS_NUM_THREADS'):      # set before numpy: the experiments use processes
    os.environ.setdefault(_name, '1')

import matplotlib  # noqa: E402

matplotlib.use('Agg')

import numpy as np  # noqa: E402

from style_core import datasets  # noqa: E402
from style_core.alignment import cycle_shift, fit_cycle, harmonic_design, period  # noqa: E402
from style_core.contacts import foot_contacts  # noqa: E402
from style_core.skeleton import read_skeleton  # noqa: E402

SUBJECTS = ('07', '08', '09', '35')
#: left out: constant or noise
CHANNELS = ('!*fingers*', '!*thumb*')
RESULTS = Path(__file__).resolve().parents[2] / 'docs' / 'results' / 'locomotion'


def parser(description):
    """Argument parser with the options all experiments have."""
    result = argparse.ArgumentParser(description=description, formatter_class=argparse.RawDescriptionHelpFormatter)
    result.add_argument('--seed', type=int, default=0)
    result.add_argument('--out', type=Path, default=RESULTS, help='folder for the page and the pictures')
    return result


def names():
    """Trials of subjects 07, 08, 09 and 35 that are present."""
    return [name for subject in SUBJECTS for name in datasets.trials(subject=subject)]


def recording(name, rate_hz=None):
    """A trial's root and body channels."""
    return datasets.trial(name, rate_hz).select(*CHANNELS)


def actions(trials):
    """Labels of trials: walk, slow_walk, run."""
    label = {row.name: row.action for row in datasets.labels()}
    return [label[name] for name in trials]


def heel_strikes(name):
    """Heel strikes of a trial by foot: {'left': times_s, 'right': times_s}."""
    subject = name.split('_')[0]
    skeleton = read_skeleton(datasets.mocap_folder() / 'cmu' / subject / f'{subject}.asf')
    found = foot_contacts(datasets.trial(name, 60.0), skeleton)
    return {foot: contact.heel_strikes for foot, contact in found.items()}


def linear_phases(recordings, rate_hz, harmonics=6):
    """Functional-analysis style alignment: each recording's period by autocorrelation gives a linear phase, a Fourier
    cycle is fitted to it, and cycles are shifted onto their mean by cross-correlation (after Ormoneit et al. 2005).

    Parameters
    ----------
    recordings : sequence of ndarray, shape (T, F)
        Scaled so that features count alike.

    Returns
    -------
    phases : list of ndarray, shape (T,)
    cycles : ndarray, shape (K, 100, F)
    """
    grid = harmonic_design(np.arange(100) * 2 * np.pi / 100, harmonics)[0]
    phases = [2 * np.pi * np.arange(len(x)) / (rate_hz * period(x, rate_hz)) for x in recordings]
    cycles = [grid @ fit_cycle(x, phase, harmonics) for x, phase in zip(recordings, phases)]
    reference = cycles[0]
    for _ in range(5):
        for k, x in enumerate(recordings):
            phases[k] = phases[k] - cycle_shift(reference, cycles[k])
            cycles[k] = grid @ fit_cycle(x, phases[k], harmonics)
        reference = np.mean(cycles, axis=0)
    return phases, np.array(cycles)


def circular_spread(phases):
    """Circular standard deviation of phases (rad), in % of a cycle."""
    length = min(1.0, abs(np.mean(np.exp(1j * np.asarray(phases)))))
    return 100 * np.sqrt(-2 * np.log(max(length, 1e-300))) / (2 * np.pi)


def purity(groups, labels):
    """Share of recordings that carry the most common label of their group (footnote 4 of the paper)."""
    groups, labels = np.asarray(groups), np.asarray(labels)
    return sum(np.unique(labels[groups == g], return_counts=True)[1].max() for g in np.unique(groups)) / len(labels)

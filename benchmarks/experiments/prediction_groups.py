"""Table 10: motion that no model knows: the shipped models on everything people do.

Every recording of labels.csv that the model was not trained on, by label. The short-range dynamics beside the model
(style_core.unknown) are learned anew without the person who is predicted.
"""

from functools import cache
from pathlib import Path

import numpy as np
from prediction_common import ROOT, page, parallel, parser

from style_core import datasets
from style_core.evaluation import coverage, error_deg2, paper_horizons, rms_deg, roll_out
from style_core.model_file import read_header
from style_core.predictor import Status
from style_core.predictor_file import read_predictor
from style_core.unknown import OpenPredictor, ShortRange, learn_short_range, read_short_range

MODELS = ('locomotion', 'everyday')
#: Of the bands.
LEVEL = 0.9


def model_path(name):
    """File of a shipped model."""
    return ROOT / 'config' / 'models' / f'{name}.npz'


def subjects():
    """Everyone with recordings of their own rate and skeleton."""
    return sorted({row.subject for row in usable()})


def usable():
    """Rows of labels.csv that can be predicted at 60 Hz."""
    return [row for row in datasets.labels() if row.rate_hz >= 60 and row.file.startswith('cmu/')]


@cache
def dynamics_without(subject):
    """Short-range dynamics learned on everyone else."""
    moments = learn_short_range(
        (datasets.trial(row.name).select(*datasets.BODY).positions for row in usable() if row.subject != subject),
        read_short_range().usual).moments
    return ShortRange(moments, read_short_range().usual)


def scores(subject, model):
    """Per trial of ``subject``: what table 10 is made of."""
    path = model_path(model)
    trained = {Path(one['name']).stem for one in read_header(path)['training']}
    alone = read_predictor(path, without=('unknown',))
    together = OpenPredictor(alone.predictor, next(iter(alone.rhythmic)), dynamics_without(subject))
    horizons = paper_horizons()
    found = {}
    for row in usable():
        if row.subject != subject or row.name in trained:
            continue
        motion = datasets.trial(row.name).select(*datasets.BODY)
        if motion.n_frames <= len(horizons) + 1:
            continue
        one, two = (roll_out(predictor, motion, horizons) for predictor in (alone.predictor, together))
        still = np.broadcast_to(motion.positions[:, None], two.mean.shape)
        held = by_status(two)
        found[row.name] = {
            'action': row.action, 'error': [error_deg2(said, two.actual) for said in (still, one.mean, two.mean)],
            'first': [float(rms_deg(said, two.actual)[0]) for said in (still, one.mean, two.mean)],
            'band': [float(np.mean(coverage(run.mean, run.std, run.actual, LEVEL))) for run in (one, two)],
            'held': held, 'changes': float(np.mean(two.status[1:] != two.status[:-1])) * 60}
    return found


def by_status(rollout):
    """Of every status: number of instants, and share of what happened that the band held there."""
    inside = {}
    for status in Status:
        here = rollout.status == status
        share = coverage(rollout.mean[here], rollout.std[here], rollout.actual[here], LEVEL) if here.any() else np.nan
        known = here.any() and np.isfinite(share).any()
        inside[status.name] = int(here.sum()), float(np.nanmean(share)) if known else np.nan
    return inside


def main(argv=None):
    arguments = parser(__doc__).parse_args(argv)
    files = [datasets.trial_path(row.name) for row in usable()]
    report = page('10_groups', 'Table 10: motion that no model knows', files)
    jobs = [(subject, model) for model in MODELS for subject in subjects()]
    results = parallel(scores, jobs, arguments.workers, 'Table 10')
    report.text('E in degrees squared over the next 25 frames at 60 Hz, 50 channels, mean over the trials of a label. '
                'Ratio: of the whole to the better of model alone and holding still, over those means. Nothing was '
                'in the training of the model; the short-range dynamics have not seen the person.')
    for model in MODELS:
        trials = {}
        for (_, name), found in zip(jobs, results):
            if name == model:
                trials.update(found)
        report.table(model, COLUMNS, [group_row(action, trials) for action in actions(trials)],
                     f'{model}.npz, with and without what is known of motion that no model knows')
        report.table(f'{model}_status', ['status', '% of the time', 'in the 90 % band, %'], status_rows(trials),
                     f'{model}.npz: bands by status')
    print(report.write(arguments.output))


COLUMNS = ('label', 'trials', 'holding still', 'model alone', 'with unknown', 'ratio',
           'trials over holding still, alone', 'with unknown', 'one frame ahead, rms degrees: still', 'alone',
           'with unknown', '90 % band holds, alone, %', 'with unknown, %', 'UNKNOWN, %', 'changes of status a second')


def actions(trials):
    """Labels present, in the order of labels.csv."""
    present = {one['action'] for one in trials.values()}
    return [action for action in dict.fromkeys(row.action for row in datasets.labels()) if action in present]


def group_row(action, trials):
    """One row of the table."""
    group = [one for one in trials.values() if one['action'] == action]
    still, alone, whole = np.mean([one['error'] for one in group], axis=0)
    frames = sum(count for one in group for count, _ in one['held'].values())
    return [action, len(group), still, alone, whole, whole / min(still, alone),
            *(sum(one['error'][k] > one['error'][0] for one in group) for k in (1, 2)),
            *np.sqrt(np.mean(np.square([one['first'] for one in group]), axis=0)),
            *(100 * np.mean([one['band'] for one in group], axis=0)),
            100 * sum(one['held']['UNKNOWN'][0] for one in group) / frames, np.mean([one['changes'] for one in group])]


def status_rows(trials):
    """Bands by status, over all trials."""
    total = sum(count for one in trials.values() for count, _ in one['held'].values())
    rows = []
    for status in Status:
        held = np.array([one['held'][status.name] for one in trials.values()])
        counted = held[(held[:, 0] > 0) & np.isfinite(held[:, 1])]
        rows.append([status.name, 100 * held[:, 0].sum() / total,
                     100 * np.average(counted[:, 1], weights=counted[:, 0]) if len(counted) else float('nan')])
    return rows


if __name__ == '__main__':
    main()

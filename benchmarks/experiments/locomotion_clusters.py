"""Purity of the styles found without labels, for 2 to 10 styles and many seeds (figure 2 of Pan and Torresani 2009).

The locomotion model on all channels and on 50 principal components; K-means on the cycles of a single latent cycle
(K-CPM) and on the cycles of the functional-analysis alignment (K-FAM); a Gaussian mixture on the latter; a mixture
of linear dynamical systems. Labels, used for scoring only: the database's own (walk, slow walk, run), and person
with label.
"""
from locomotion_common import actions, linear_phases, names, parser, purity, recording  # isort: skip

import json
from concurrent.futures import ProcessPoolExecutor, as_completed
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
from linear_dynamics import cluster
from sklearn.cluster import KMeans
from sklearn.decomposition import PCA
from sklearn.mixture import GaussianMixture
from tqdm import tqdm

from style_core.alignment import fit_cycle, harmonic_design
from style_core.datasets import trial_path
from style_core.locomotion import em, kernels
from style_core.locomotion.learn import cycle_sizes, features_of, fit, standard
from style_core.report import Report

#: a run still has eleven frames a cycle; the groups are those found at 30 and 60 Hz, at a quarter of the cost
RATE_HZ = 15.0
BEST = 'locomotion model, best bound of 5'
METHODS = (
    BEST,
    'locomotion model',
    'locomotion model, 50 components',
    "locomotion model, the paper's start",
    'K-CPM',
    'K-FAM',
    'Gaussian mixture',
    'linear dynamics',
)


def prepare():
    """Everything that does not depend on the seed or the number of styles but is cheap to hand to a process."""
    features, recordings, rate = features_of([recording(name) for name in names()], RATE_HZ)
    centre, scale = standard(recordings, features)
    scaled = [(x - centre) / scale for x in recordings]
    rotation = PCA(50).fit(np.concatenate([x - centre for x in recordings]))
    parts = [rotation.transform(x - centre) for x in recordings]
    spread = np.concatenate(parts).std()
    parts = [x / spread for x in parts]
    _, cycles = linear_phases(scaled, rate)
    return {'scaled': scaled, 'limit': (scale / features.floors)**2, 'parts': parts,
            'parts_limit': np.full(50, (spread / np.radians(0.5))**2), 'sizes': cycle_sizes(scaled, rate),
            'fam': cycles.reshape(len(cycles), -1), 'dynamics': [x[:, :10] for x in parts]}


def single_cycle_features(data, seed):
    """Each recording's own cycle by the alignment to one latent cycle: Fourier cycles over the Viterbi path's phase."""
    sizes, scaled = data['sizes'], data['scaled']
    one = fit(scaled, sizes, 1, seed, precision_max=data['limit'])
    grid = harmonic_design(np.arange(100) * 2 * np.pi / 100, 6)[0]
    cycles = []
    for k, x in enumerate(scaled):
        scores = em.emission(
            x, None, one.parameters.precision, one.posterior.cycles.mean, one.posterior.cycles.variance, np.ones(1)
        )
        path = np.empty(len(x), np.int64)
        kernels.viterbi(scores, np.log(one.parameters.jumps[k]), path)
        cycles.append(grid @ fit_cycle(x, 2 * np.pi * path / sizes.n_positions, 6))
    return np.array(cycles).reshape(len(cycles), -1)


def run_seed(seed, counts, data, wanted):
    """Groups found by some of the methods for one seed: {(method, count): labels}."""
    found = {}
    single = single_cycle_features(data, seed) if METHODS[4] in wanted else None
    short = PCA(10, random_state=seed).fit_transform(data['fam'])
    for count in counts:
        def model(key, limit, start='cycles', count=count):
            result = fit(data[key], data['sizes'], count, seed, precision_max=data[limit], start=start)
            return result.posterior.labels.argmax(axis=1), result.bounds[-1]

        if METHODS[1] in wanted:
            found[METHODS[1], count], found['bound', count] = model('scaled', 'limit')
        if METHODS[2] in wanted:
            found[METHODS[2], count], _ = model('parts', 'parts_limit')
        if METHODS[3] in wanted:
            found[METHODS[3], count], _ = model('scaled', 'limit', 'noise')
        if METHODS[4] in wanted:
            found[METHODS[4], count] = KMeans(count, n_init=1, random_state=seed).fit_predict(single)
        if METHODS[5] in wanted:
            found[METHODS[5], count] = KMeans(count, n_init=1, random_state=seed).fit_predict(data['fam'])
        if METHODS[6] in wanted:
            found[METHODS[6], count] = GaussianMixture(count, covariance_type='diag', reg_covar=1e-2, n_init=1,
                                                       random_state=seed).fit_predict(short)
        if METHODS[7] in wanted:
            found[METHODS[7], count] = cluster(data['dynamics'], count, seed)
    return found


def main():
    """Run all seeds, write table and picture."""
    options = parser(__doc__)
    options.add_argument('--seeds', type=int, default=50)
    options.add_argument(
        '--few', type=int, default=50, help="seeds for the two slow comparisons (the paper's start, linear dynamics)"
    )
    options.add_argument('--jobs', type=int, default=2)
    options.add_argument('--resume', type=Path, help='file that keeps what is finished, to go on after an interruption')
    args = options.parse_args()
    trials = names()
    label = actions(trials)
    person = [f'{name[:2]} {action}' for name, action in zip(trials, label)]
    counts = list(range(2, 11))
    data = prepare()
    wanted = [args.seed + s for s in range(args.seeds)]
    done = {seed: {} for seed in wanted}
    if args.resume and args.resume.exists():
        for line in args.resume.read_text().splitlines():
            seed, found = json.loads(line)
            done.setdefault(seed, {}).update({tuple(key): groups for key, groups in found})
    missing = {
        seed: [name for name in METHODS[1:] if (name, counts[0]) not in done[seed]
               and (k < args.few or name not in (METHODS[3], METHODS[7]))]
        for k, seed in enumerate(wanted)
    }
    with ProcessPoolExecutor(args.jobs) as pool:
        tasks = {pool.submit(run_seed, seed, counts, data, methods): seed
                 for seed, methods in missing.items() if methods}
        for task in tqdm(as_completed(tasks), total=len(tasks), desc='seeds', disable=None):
            found = {key: np.asarray(groups).tolist() for key, groups in task.result().items()}
            done[tasks[task]].update(found)
            if args.resume:
                line = json.dumps([tasks[task], [[list(key), groups] for key, groups in found.items()]])
                with open(args.resume, 'a') as stream:
                    stream.write(line + '\n')
    results = {}
    for seed in wanted:
        for key, groups in done[seed].items():
            results.setdefault(key, []).append(
                groups if key[0] == 'bound' else (purity(groups, label), purity(groups, person))
            )
    for count in counts:    # what `learn` does: of five starts the one with the highest bound
        fives = np.array(results['bound', count])[:args.seeds // 5 * 5].reshape(-1, 5).argmax(axis=1)
        results[BEST, count] = [results[METHODS[1], count][5 * k + best] for k, best in enumerate(fives)]
    report = Report(
        'clusters',
        'Styles found without labels',
        f'python benchmarks/experiments/locomotion_clusters.py --seeds {args.seeds} --few {args.few}',
        args.seed,
        [trial_path(name) for name in trials],
    )
    report.text(
        f'{len(trials)} recordings of subjects 07, 08, 09 and 35 at {RATE_HZ:g} Hz, '
        f'{data["scaled"][0].shape[1]} channels; '
        f'{args.seeds} seeds. Mean purity +- standard deviation over runs, their number in brackets; "best '
        'bound of 5" takes the '
        'start with the highest bound of each five seeds, as training does. The largest label alone gives '
        f'{max(label.count(v) for v in set(label)) / len(label):.3f} (label) and '
        f'{max(person.count(v) for v in set(person)) / len(person):.3f} (person and label).'
    )
    figure, axes = plt.subplots(1, 2, figsize=(13, 5), sharey=False)
    for which, (title, axis) in enumerate(zip(('walk, slow walk, run', 'person and label'), axes)):
        rows = []
        for method in [name for name in METHODS if results.get((name, counts[0]))]:
            values = [np.array(results[method, count])[:, which] for count in counts]
            rows.append([f'{method} ({len(values[0])})'] + [f'{v.mean():.3f} +- {v.std():.3f}' for v in values])
            axis.errorbar(
                np.array(counts) + 0.05 * METHODS.index(method),
                [v.mean() for v in values],
                [v.std() for v in values],
                label=method,
                capsize=2,
                lw=1.8 if method.startswith('loco') else 1,
            )
        report.table(title, ['method', *(f'C = {count}' for count in counts)], rows, f'Purity by {title}')
        axis.set_title(f'purity by {title}')
        axis.set_xlabel('number of styles C')
        axis.grid(alpha=0.3)
    axes[1].legend(fontsize=8)
    figure.tight_layout()
    report.figure(figure, 'purity', 'Mean purity over seeds; bars: standard deviation.')
    print(report.write(args.out))


if __name__ == '__main__':
    main()

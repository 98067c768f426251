#!/usr/bin/env python3
"""Segmentation of concatenated motions of people whom the library has never seen.

For every subject: a library of everyone else's fragments, sequences of this subject's fragments joined end to end,
one-stage dynamic programming, and the share of frames and of fragments that got the right content.
"""
import matplotlib
import numpy as np

matplotlib.use('Agg')
import matplotlib.pyplot as plt
from effort_data import CONTENTS, parser, people

from style_core import datasets
from style_core.effort.joins import join
from style_core.effort.segmentation import segment
from style_core.report import Report

COMMAND = 'python benchmarks/experiments/effort_segmentation.py'


def main():
    options = parser(__doc__)
    options.add_argument('--sequences', type=int, default=20, help='sequences a subject (default 20)')
    options.add_argument('--length', type=int, default=8, help='fragments a sequence (default 8)')
    args = options.parse_args()

    held = people(args.seed)
    everything, scale, space, generator = held
    rows, confusion, example = [], np.zeros((len(CONTENTS), len(CONTENTS))), None
    for subject, library, own in held.held_out(args.seed):
        sequences = [space.encode(f.motion).joints * scale for f in library]
        contents = np.array([f.content for f in library])
        frames_right = frames_all = exact = 0
        for _ in range(args.sequences):
            chosen = [own[k] for k in generator.integers(len(own), size=args.length)]
            joined = join([space.encode(f.motion) for f in chosen], 60.0).joints * scale
            truth = np.concatenate([np.full(f.motion.n_frames, f.content) for f in chosen])
            segments, _ = segment(joined, sequences)
            guess = np.concatenate([np.full(s.stop - s.start, contents[s.fragment]) for s in segments])
            frames_right += int(np.sum(guess == truth))
            frames_all += len(truth)
            exact += [contents[s.fragment] for s in segments] == [f.content for f in chosen]
            np.add.at(confusion, (truth, guess), 1)
            example = (truth, guess, subject)
        rows.append([subject, len(own), args.sequences, 100 * frames_right / frames_all, 100 * exact / args.sequences])

    trials = sorted({f.trial for f in everything})
    report = Report('segmentation', 'Segmentation of people never seen', COMMAND, args.seed,
                    [datasets.trial_path(name) for name in trials])
    report.text(f'{args.length} random fragments of one person a sequence, joined end to end; the library holds 12 '
                'fragments a content of all other people. The content sequence is right when it has the same contents '
                'in the same order and number.')
    report.table('by subject', ['subject', 'own fragments', 'sequences', 'frames right (%)',
                                'whole sequence right (%)'], rows, 'Accuracy by subject')
    share = 100 * confusion / confusion.sum(axis=1, keepdims=True)
    report.table('confusion', ['true content', *CONTENTS], [[name, *row] for name, row in zip(CONTENTS, share)],
                 'Share of frames (%) of each true content by found content')
    figure, axis = plt.subplots(figsize=(10, 2.4))
    truth, guess, subject = example
    seconds = np.arange(len(truth)) / 60
    axis.step(seconds, truth, 'k', where='post', label='true')
    axis.step(seconds, guess + 0.08, where='post', label='found')
    axis.set_yticks(range(len(CONTENTS)), CONTENTS)
    axis.set_xlabel('s')
    axis.legend(loc='upper right', fontsize=8)
    report.figure(figure, 'example', f'A sequence of subject {subject}')
    print(report.write(args.output).read_text())


if __name__ == '__main__':
    main()

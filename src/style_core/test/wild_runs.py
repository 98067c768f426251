"""Runs of commands and predictors on legal but extreme input, drawn by a seed, each put into one of five classes.

    python3 src/style_core/test/wild_runs.py --factor 10 -o table.md       ten times as many, with a table

The kinds are data, names, options, expressions, damaged models and on-line streams. Everything runs in this process;
what takes longer than its limit is interrupted and called a hang. ``test_wild_runs.py`` runs a bounded number.
"""
import argparse
import contextlib
import io
import json
import resource
import signal
import sys
import tempfile
import time
import warnings
from collections import Counter
from pathlib import Path

import numpy as np

from style_core.cli import main
from style_core.errors import MotionError
from style_core.formats import read_motion
from style_core.motion import Motion

RIGHT, LINE, TRACEBACK, WRONG, HANG = CLASSES = ('right', 'one clear line', 'traceback', 'silent wrong number', 'hang')
#: runs of each kind with factor 1; processor time one may take, s; angles that no body and no model has, rad
COUNTS = {'data': 50, 'names': 25, 'options': 60, 'expressions': 60, 'damaged models': 90, 'streams': 30}
LIMIT_S, FARTHEST = 30, 100.0
#: memory of this process, so that what asks for too much fails here as it would on a small computer
MEMORY = 6 * 2**30


class _Hang(BaseException):
    pass


@contextlib.contextmanager
def _limit():
    def end(*_):
        raise _Hang

    # processor time, as others may be busy; and ten times as much by the clock, for what only waits
    timers = ((signal.SIGPROF, signal.ITIMER_PROF, LIMIT_S), (signal.SIGALRM, signal.ITIMER_REAL, 10 * LIMIT_S))
    before = [signal.signal(number, end) for number, _, _ in timers]
    for _, timer, seconds in timers:
        signal.setitimer(timer, seconds)
    try:
        yield
    finally:
        for (number, timer, _), handler in zip(timers, before):
            signal.setitimer(timer, 0)
            signal.signal(number, handler)


def command(words, outputs=()):
    """Class of a run of ``motion-style``, and what it said."""
    out, err = io.StringIO(), io.StringIO()
    words = [str(word) for word in words]
    for path in outputs:
        if Path(path).is_file():
            Path(path).unlink()
    with _limit(), contextlib.redirect_stdout(out), contextlib.redirect_stderr(err), warnings.catch_warnings():
        warnings.simplefilter('ignore')
        try:
            status = main(words)
        except SystemExit as end:
            status = end.code
        except _Hang:
            return HANG, ' '.join(words)[:300]
        except BaseException as error:
            return TRACEBACK, f'{" ".join(words)[:300]}: {type(error).__name__} {str(error)[:200]}'
    said = err.getvalue().strip().splitlines()
    told = f'{" ".join(words)[:300]}: {(said or [""])[-1][:200]}'
    if status:
        clear = said and 'motion-style' in said[-1] and (len(said) == 1 or said[0].startswith('usage:')
                                                         or all(line.startswith('motion-style') for line in said))
        return (LINE if clear and status in (1, 2) else TRACEBACK), told
    # what is only shown may well hold no number, or be called so
    printed = '' if words[0] == 'info' and '--json' not in words else out.getvalue()
    return (WRONG if _unsound(printed, outputs) else RIGHT), told


def _unsound(printed, outputs):
    """Whether a run that claims success printed or wrote what is no number or no angle."""
    if printed.startswith('{'):
        try:
            json.loads(printed, parse_constant=lambda word: (_ for _ in ()).throw(ValueError(word)))
        except ValueError:
            return True
    if any(word.strip('().,;:%') in ('nan', 'inf', '-inf') for word in printed.split()):
        return True
    for path in outputs:
        if Path(path).suffix in ('.csv', '.npz') and Path(path).is_file():
            try:
                motion = read_motion(path)
            except MotionError:
                return True
            angles = motion.positions[:, np.array(motion.units) == 'rad']
            if not np.isfinite(angles).all() or np.abs(angles).max(initial=0.0) > FARTHEST:
                return True
    return False


class Runs:
    """Draws and makes the runs of every kind.

    Parameters
    ----------
    folder : pathlib.Path
        For files.
    models : dict of str to path-like
        As `made_models.make_models` returns them.
    seed : int
    """

    def __init__(self, folder, models, seed=0):
        self.folder, self.models, self.seed = Path(folder), {kind: Path(path) for kind, path in models.items()}, seed

    def run(self, kind, count):
        """Classes of ``count`` runs of a kind, and what the runs that went wrong said."""
        classes, wrong = Counter(), []
        for index in range(count):
            rng = np.random.default_rng([self.seed, list(COUNTS).index(kind), index])
            found, told = getattr(self, '_' + kind.replace(' ', '_'))(rng)
            classes[found] += 1
            if found in (TRACEBACK, WRONG, HANG):
                wrong.append(f'{kind} {index}: {found}: {told}')
        return classes, wrong

    # --- data -------------------------------------------------------------------------------------------------------

    def _recording(self, rng, names):
        frames = int(rng.choice([1, 2, 3, 9, 40, 120]))
        shape = (frames, len(names))
        times = np.arange(frames) / rng.choice([0.5, 10.0, 60.0, 120.0, 1e4])
        course = np.sin(2 * np.pi * times[:, None] + np.arange(len(names)))
        y = {'still': np.full(shape, 0.3), 'zero': np.zeros(shape), 'noise': rng.standard_normal(shape),
             'step': np.where(np.arange(frames)[:, None] < frames // 2, 0.0, 1.0) + np.zeros(shape),
             'ramp': np.linspace(0, 20, frames)[:, None] + np.zeros(shape), 'gait': course,
             'tiny': 1e-300 * course, 'wound': 1e3 * course, 'huge': 1e300 * course,
             'spike': np.where(rng.random(shape) < 0.01, 1e6, course),
             'holes': np.where(rng.random(shape) < 0.5, np.nan, course), 'nothing': np.full(shape, np.nan)}
        what = str(rng.choice(list(y)))
        values = y[what].copy()
        if rng.random() < 0.3:
            values[:, 0] = np.nan
        if rng.random() < 0.3:
            times = np.cumsum(rng.exponential(0.02, frames)) - 5.0
        if rng.random() < 0.2:
            times = times + 1e6
        return what, Motion(names, values, times, name=what)

    def _data(self, rng):
        kind = str(rng.choice(['phase-style', 'locomotion', 'style-machine', 'effort']))
        model = self.models[kind]
        names = read_motion(model.with_name(f'{kind}.csv')).joint_names
        what, motion = self._recording(rng, names)
        file, out = self.folder / 'data.npz', self.folder / 'data_out.csv'
        np.savez(file, joint_names=np.array(names), positions=motion.positions, times=motion.times)
        if rng.random() < 0.12:
            return self._training(rng, names)
        if kind == 'effort':
            return command(['effort', file, '--library', model, '--flow', '1', '-o', out], [out])
        # holes of a recording stay holes, so only outputs that a model made are looked at
        converted = self.folder / f'data{rng.choice([".csv", ".amc", ".bvh", ".mcap"])}'
        choices = [(['info', file], []), (['convert', file, converted], []),
                   (['convert', file, converted, '--rate', '50'], []), (['predict', model, file, '-o', out], [out]),
                   (['predict', model, file, '-o', out, '--ahead', '0.1'], [out]),
                   (['evaluate', model, file, '--horizon', '2', '--json'], []), (['evaluate', model, file], [])]
        choices.append((['analyze', model, file, '--json'], []))
        if kind == 'phase-style':
            choices += [(['analyze', model, file, '--batch', '--json'], []),
                        (['fill', model, file, '-o', out, '--method', 'paper'], [out])]
        if kind != 'style-machine':
            choices.append((['fill', model, file, '-o', out], [] if what in ('wound', 'huge', 'spike') else [out]))
        words, outputs = choices[int(rng.integers(len(choices)))]
        if what in ('wound', 'huge', 'spike'):      # what such a recording shows is no angle of a body to begin with
            outputs = []
        return command(words, outputs)

    def _training(self, rng, names):
        files = []
        for k in range(3):
            motion = self._recording(rng, names)[1]
            files.append(self.folder / f'p{k}_1.npz')
            np.savez(files[-1], joint_names=np.array(names), positions=motion.positions, times=motion.times)
        kind = str(rng.choice(['phase-style', 'locomotion', 'style-machine', 'effort']))
        more = {'locomotion': ['--styles', '2', '--restarts', '1', '--iterations', '3'],
                'style-machine': ['--states', '6', '--anneal', '4']}.get(kind, [])
        out = self.folder / 'trained.npz'
        found, told = command(['train', kind, *files, '-o', out, *more])
        if found == RIGHT:      # what was written must be readable
            again, told = command(['info', out])
            found = RIGHT if again == RIGHT else WRONG
        return found, told

    # --- names, options, expressions --------------------------------------------------------------------------------

    def _names(self, rng):
        odd = ['Hüfte', 'a b', 'a,b', 'a;b', 'a"b', "a'b", '', ' ', '\n', 'a\tb', '#a', 'a [deg]', 'a*', '!a', '[a]',
               'x' * 300, '足', '\u202e',
               'time', 'nan', '../a', '{a}', '%s', 'a.rx', 'root.tx', '🦿', '=a', '-o', 'a\\']
        chosen = list(dict.fromkeys(str(name) for name in rng.choice(odd, 3)))
        file = self.folder / 'names.npz'
        np.savez(file, joint_names=np.array(chosen), positions=np.cumsum(rng.random((20, len(chosen))), axis=0) / 20,
                 times=np.arange(20) / 60)
        if rng.random() < 0.4:
            name = str(rng.choice([name for name in odd if name.strip() and len(name) < 200 and '/' not in name]))
            file = file.rename(self.folder / f'{name}.npz') if '\n' not in name else file
        out = self.folder / f'names_out{rng.choice([".csv", ".npz", ".bvh", ".amc", ".mcap"])}'
        words = [['info', file], ['info', file, '--json'], ['convert', file, out],
                 ['convert', file, out, '--select', chosen[0]], ['evaluate', self.models['locomotion'], file]]
        found, told = command(words[int(rng.integers(len(words)))])
        if found == RIGHT and out.suffix == '.csv' and out.is_file():
            back = read_motion(out)
            found = RIGHT if set(back.joint_names) <= set(chosen) else WRONG
            out.unlink()
        return found, told

    def _options(self, rng):
        kind = str(rng.choice(['phase-style', 'locomotion', 'style-machine']))
        model, out = self.models[kind], self.folder / 'options_out.csv'
        file = model.with_name(f'{kind}.csv')
        value = str(rng.choice(['0', '-1', '1', '1e-12', '1e9', '1e12', '1e300', 'nan', 'inf', 'x', '', '0.5', '3',
                                '1_0', '٣']))
        cases = [(['predict', model, file, '-o', out, f'{option}={value}'], [out])
                 for option in ('--rate', '--seconds', '--at', '--ahead', '--mask', '--method', '--without')]
        cases += [(['evaluate', model, file, '--json', f'{option}={value}'], []) for option in ('--horizon', '--mask')]
        cases += [(['convert', file, out, f'{option}={value}'], []) for option in
                  ('--rate', '--start', '--stop', '--select', '--storage')]
        cases += [(['train', 'locomotion', file, '-o', self.folder / 'o.npz', f'{option}={value}'], []) for option in
                  ('--rate', '--styles', '--iterations', '--seed')]
        if kind == 'style-machine':
            cases += [(['synthesize', model, f'--random-walk={value}', '-o', out], [out]),
                      (['synthesize', model, '--random-walk', '2', f'--rate={value}', '-o', out], [out])]
        if kind == 'locomotion':
            cases += [(['synthesize', model, '--blend', '0', f'{option}={value}', '-o', out], [out])
                      for option in ('--duration', '--rate', '--phase')]
        return command(*cases[int(rng.integers(len(cases)))])

    def _expressions(self, rng):
        out = self.folder / 'expression.csv'
        machine = rng.random() < 0.6
        styles = ['walk', 'run', 'generic', '[0.1]', '[1, -1]'] if machine else ['0', 'style0']
        if rng.random() < 0.4:      # well formed, of any size
            sizes = [0.3, 0.7, 1, 1.5, -0.5, 1e3, 1e300]
            pieces = [f'{rng.choice(sizes)}*{rng.choice(styles)}' for _ in range(rng.integers(1, 3))]
            return self._synthesis(machine, '+'.join(pieces), out)
        atoms = [*styles, 'absent', '1', '0.5', '-2', '1e6', '1e300', '0', '5000', '.', 'é']
        parts = [str(rng.choice(atoms))]
        for _ in range(int(rng.integers(0, 5))):
            parts += [str(rng.choice(['*', '+', '-', '/', ' ', ':', '::', '(', ')', ';', '@'])), str(rng.choice(atoms))]
        text = ''.join(parts)
        if rng.random() < 0.1:
            text = str(rng.choice(['(' * 2000, '-' * 5000])) + text
        return self._synthesis(machine, text, out)

    def _synthesis(self, machine, text, out):
        words = ['synthesize', self.models['style-machine'], '--random-walk', '1', f'--style={text}'] if machine else \
            ['synthesize', self.models['locomotion'], '--duration', '1', f'--blend={text}']
        return command([*words, '-o', out], [out])

    # --- damaged models ---------------------------------------------------------------------------------------------

    def _damaged_models(self, rng):
        kind = str(rng.choice(list(self.models)))
        path, file = self.models[kind], self.folder / 'damaged.npz'
        with np.load(path) as archive:
            header = json.loads(str(archive['header_json'][()]))
            arrays = {name: archive[name] for name in archive.files if name != 'header_json'}
        if rng.random() < 0.5:      # as a tool would that knows of checksums, or a file from before there were any
            header.pop('sha256', None)
        name = str(rng.choice(list(arrays)))
        array = arrays[name]
        edits = ['lost', 'cut', 'empty', 'wild', 'nan', 'turned', 'text', 'bytes', 'joints', 'entry', 'gone', 'deep']
        edit = str(rng.choice(edits))
        if edit == 'lost':
            del arrays[name]
        elif edit == 'joints':
            names = list(header['joint_names'])
            header['joint_names'] = names[::-1] if rng.random() < 0.5 else ['renamed', *names[1:]]
        elif edit in ('entry', 'gone'):
            key = str(rng.choice([key for key in header if key != 'sha256']))
            if edit == 'gone':
                del header[key]
            else:
                header[key] = [None, -1, 0, 'x', [], {}, [1], 1e308, True][int(rng.integers(9))]
        elif edit == 'deep' and isinstance(header.get('behaviours'), list):
            inner = header['behaviours'][0]
            inner[str(rng.choice(list(inner)))] = [None, -1, 'x', [], 1e308][int(rng.integers(5))]
        elif edit != 'bytes':
            array = array.copy()
            if edit == 'wild' and array.size and array.dtype.kind == 'f':
                array.flat[int(rng.integers(array.size))] = rng.choice([-1e300, 1e300, -1.0, 1e9])
            elif edit == 'nan' and array.size and array.dtype.kind == 'f':
                array.flat[int(rng.integers(array.size))] = np.nan
            arrays[name] = {'cut': array[:-1] if array.ndim else array, 'empty': np.zeros(0), 'turned': array.T[::-1]
                            if array.ndim else array, 'text': array.astype(str)}.get(edit, array)
        np.savez(file, header_json=np.array(json.dumps(header)), **arrays)
        if edit == 'bytes':
            data = bytearray(path.read_bytes())
            for place in rng.integers(0, len(data), 3):
                data[place] ^= 0xff
            file.write_bytes(data)
        recording, out = path.with_name(f'{kind}.csv'), self.folder / 'damaged_out.csv'
        if kind == 'effort':
            return command(['effort', recording, '--library', file, '--flow', '1', '-o', out], [out])
        return command(['predict', file, recording, '--at', '0.5', '--seconds', '0.1', '-o', out], [out])

    # --- streams ----------------------------------------------------------------------------------------------------

    def _streams(self, rng):
        from style_core.predictor_file import read_predictor
        kind = str(rng.choice(['phase-style', 'locomotion', 'style-machine']))
        predictor = read_predictor(self.models[kind]).predictor
        motion = read_motion(self.models[kind].with_name(f'{kind}.csv')).joints(list(predictor.joint_names))
        motion = motion.resample(60)
        told, now = f'{kind}, seed {rng.bit_generator.state["state"]["state"] % 10**6}', 0.0
        with _limit(), warnings.catch_warnings():
            warnings.simplefilter('ignore')
            try:
                for frame in range(120):
                    y = motion.positions[frame % motion.n_frames].copy()
                    mask = None
                    if frame < 100:     # then one second to come back
                        y, mask, now = self._disturbed(rng, y, now)
                        if frame < 60 and rng.random() < 0.01:
                            predictor.reset()
                    else:
                        now += 1 / 60
                    try:
                        found = predictor.update(now, y, mask)
                    except ValueError:
                        if np.isfinite(y).all():
                            return TRACEBACK, f'{told}: a sound observation was refused'
                        continue
                    horizons = np.array([0.0, 0.1, rng.choice([0.5, 10.0, 1e4])])
                    ahead = predictor.predict(horizons)
                    if not all(np.isfinite(a).all() for a in (found.mean, found.std, ahead.mean, ahead.std)):
                        return WRONG, f'{told}: not finite at frame {frame}'
                    if not ((found.std > 0).all() and (ahead.std > 0).all()):
                        return WRONG, f'{told}: no band at frame {frame}'
            except _Hang:
                return HANG, told
            except Exception as error:
                return TRACEBACK, f'{told}: {type(error).__name__} {error}'
        off = np.degrees(np.abs(found.mean - y)).max()
        return (RIGHT, told) if off < 30 else (WRONG, f'{told}: {off:.0f} degrees off a second after it ended')

    @staticmethod
    def _disturbed(rng, y, now):
        now += float(rng.choice([1e-3, 1 / 60, 1 / 60, 1 / 60, 0.3, 3.0], p=[0.05, 0.3, 0.3, 0.3, 0.04, 0.01]))
        draw = rng.random()
        if draw < 0.1:
            y[rng.integers(len(y))] = rng.choice([3.0, 99.0, 9999.0, 1e5, 1e200, 1e308]) * rng.choice([-1, 1])
        elif draw < 0.13:
            y[:] = rng.choice([3.0, 99.0, 1e5, 1e308])
        elif draw < 0.15:
            y[rng.integers(len(y))] = np.inf
        elif draw < 0.3:
            y[rng.random(len(y)) < 0.5] = np.nan
        return y, (rng.random(len(y)) < 0.7 if rng.random() < 0.2 else None), now


def run_all(folder, models, factor=1.0, seed=0, progress=None):
    """Classes of all kinds: (dict of kind to Counter, list of what went wrong)."""
    runs, classes, wrong = Runs(folder, models, seed), {}, []
    for kind, count in COUNTS.items():
        begin = time.perf_counter()
        classes[kind], more = runs.run(kind, max(1, round(count * factor)))
        wrong += more
        if progress is not None:
            progress(f'{kind}: {dict(classes[kind])}, {time.perf_counter() - begin:.0f} s')
    return classes, wrong


def table(classes):
    """Markdown rows of the classes by kind."""
    lines = ['| runs of | number | ' + ' | '.join(CLASSES) + ' |', '| --- |' + ' --- |' * (1 + len(CLASSES))]
    total = sum(classes.values(), Counter())
    for kind, counts in [*classes.items(), ('all', total)]:
        lines.append(f'| {kind} | {sum(counts.values())} | ' + ' | '.join(str(counts[one]) for one in CLASSES) + ' |')
    return '\n'.join(lines)


def _main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument('--factor', type=float, default=1.0, help='times as many runs (default: 1)')
    parser.add_argument('--seed', type=int, default=0)
    parser.add_argument('-o', '--output', help='write the table here')
    args = parser.parse_args()
    from made_models import make_models
    resource.setrlimit(resource.RLIMIT_AS, (MEMORY, resource.getrlimit(resource.RLIMIT_AS)[1]))
    with tempfile.TemporaryDirectory() as folder:
        (Path(folder) / 'models').mkdir()
        with contextlib.redirect_stdout(io.StringIO()):
            models = make_models(Path(folder) / 'models')
        classes, wrong = run_all(folder, models, args.factor, args.seed, print)
    for line in wrong:
        print(line)
    print(table(classes))
    if args.output:
        Path(args.output).write_text(table(classes) + '\n', encoding='utf-8')
    return int(bool(wrong))


if __name__ == '__main__':
    sys.exit(_main())

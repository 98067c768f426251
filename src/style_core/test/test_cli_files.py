"""Files from the user's side: nothing is lost, nothing lies about, and what cannot be written is one line."""
import os
import resource
import signal
import stat
import subprocess
import sys

import numpy as np
import pytest

from style_core.cli import main, registry
from style_core.formats import read_motion, write_motion, written_suffixes
from style_core.motion import Motion

RUN = [sys.executable, '-c', 'import sys; from style_core.cli import main; sys.exit(main())']


@pytest.fixture
def walk(tmp_path, gait):
    path = tmp_path / 'walk.csv'
    write_motion(gait, path)
    return path


def refused(capsys, words, status, *said):
    """The command ends with this status and one line that says this."""
    assert main([str(word) for word in words]) == status
    complaint = capsys.readouterr().err
    assert complaint.count('\n') == 1 and all(word in complaint for word in said), complaint


def test_an_output_that_is_an_input_is_refused_whatever_its_name(walk, tmp_path, capsys):
    before = walk.read_bytes()
    (tmp_path / 'link.csv').symlink_to(walk)
    os.link(walk, tmp_path / 'hard.csv')
    (tmp_path / 'sub').mkdir()
    for name in (walk, tmp_path / 'sub' / '..' / 'walk.csv', tmp_path / 'link.csv', tmp_path / 'hard.csv'):
        refused(capsys, ['convert', walk, name, '--rate', '10'], 2, f'{name} is read as well', '--force')
    assert walk.read_bytes() == before
    assert main(['convert', str(walk), str(walk), '--rate', '10', '--force']) == 0
    assert read_motion(walk).rate_hz == 10


def test_every_command_that_writes_refuses_its_inputs(models, tmp_path, capsys):
    """By the registry: a model, a recording and an output, which is the recording or the model."""
    folder = models['phase-style'].parent
    runs = {'predict': ['{model}', '{file}', '-o', '{file}'], 'fill': ['{model}', '{file}', '-o', '{file}'],
            'analyze': ['{model}', '{file}', '--picture', '{picture}', '-o', '{file}']}
    for command, words in runs.items():
        for kind in registry.KIND_COMMANDS[command]:
            if (command, kind) == ('analyze', 'style-machine'):
                continue
            file = tmp_path / f'{kind}.csv'
            file.write_bytes((folder / f'{kind}.csv').read_bytes())
            filled = [word.format(model=models[kind], file=file, picture=tmp_path / 'p.png') for word in words]
            refused(capsys, [command, *filled], 2, 'is read as well')
    for kind in registry.TRAINERS:
        model = tmp_path / 'model.npz'
        model.write_bytes(models['effort'].read_bytes())
        refused(capsys, ['train', kind, model, '-o', model], 2, 'is read as well')
    refused(capsys, ['predict', models['locomotion'], folder / 'locomotion.csv', '-o', tmp_path / 'a.csv', '--std',
                     tmp_path / 'a.csv'], 2, 'is written twice')


@pytest.mark.parametrize('name', ['x', '-', 'x.bag', 'x.txt'])
def test_a_forgotten_suffix_makes_no_bag(walk, tmp_path, monkeypatch, capsys, name):
    monkeypatch.chdir(tmp_path)
    for command in (['convert', walk, name], ['blend', walk, walk, '--alpha', '0.5', '-o', name]):
        if name == '-' and command[0] == 'convert':
            continue        # argparse itself takes it for a positional
        refused(capsys, command, 2, name, 'suffix' if '.' not in name else 'must end in')
    assert sorted(path.name for path in tmp_path.iterdir()) == ['walk.csv']


def test_a_bag_is_written_where_it_is_asked_for(walk, tmp_path):
    assert main(['convert', str(walk), str(tmp_path / 'bag'), '--storage', 'sqlite3']) == 0
    assert read_motion(tmp_path / 'bag').n_frames == read_motion(walk).n_frames


def test_places_where_nothing_can_be_written_are_named_before_any_work(walk, tmp_path, capsys):
    (tmp_path / 'folder.csv').mkdir()
    refused(capsys, ['convert', walk, tmp_path / 'absent' / 'x.csv'], 2, 'absent does not exist')
    refused(capsys, ['convert', walk, tmp_path / 'folder.csv'], 2, 'is a folder')
    refused(capsys, ['train', 'locomotion', walk, '-o', tmp_path / 'x.csv'], 2, 'model file must end in .npz')


@pytest.mark.parametrize('suffix', sorted(set(written_suffixes()) - {'.db3', '.amc', '.bvh'}))
def test_a_full_disk_is_one_line_and_the_old_file_stays(suffix, tmp_path):
    """A limit on the size of files stands in for a full disk."""
    big = Motion([f'j{k}' for k in range(40)], np.random.default_rng(0).random((4000, 40)), np.arange(4000) / 100)
    write_motion(big, tmp_path / 'big.npz')
    out = tmp_path / f'out{suffix}'
    if suffix:
        out.write_text('old')

    def limit():
        signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
        resource.setrlimit(resource.RLIMIT_FSIZE, (200_000, 200_000))
    done = subprocess.run([*RUN, 'convert', tmp_path / 'big.npz', out, *([] if suffix else ['--storage', 'sqlite3'])],
                          capture_output=True, text=True, preexec_fn=limit)
    assert done.returncode == 1 and done.stderr.count('\n') == 1 and f'{out} cannot be written' in done.stderr
    assert sorted(path.name for path in tmp_path.iterdir()) == sorted(['big.npz', *([out.name] if suffix else [])])
    assert not suffix or out.read_text() == 'old'


def test_sigterm_leaves_nothing_half_written(tmp_path):
    code = ('import sys, time; from style_core.cli import main\n'
            'import style_core.formats.csv as table\n'
            'def write(motion, path):\n'
            '    with table.replacing(path) as stream:\n'
            '        stream.write("half"); stream.flush(); print("writing", flush=True); time.sleep(60)\n'
            'table.write = write; sys.exit(main())')
    write_motion(Motion(['a'], np.zeros((9, 1)), np.arange(9) / 10), tmp_path / 'a.npz')
    (tmp_path / 'b.csv').write_text('old')
    with subprocess.Popen([sys.executable, '-c', code, 'convert', tmp_path / 'a.npz', tmp_path / 'b.csv'],
                          stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as process:
        assert process.stdout.readline() == 'writing\n'
        assert [path for path in tmp_path.iterdir() if path.suffix == '.part']
        process.terminate()
        _, complaint = process.communicate(timeout=30)
    assert (process.returncode, complaint) == (143, 'motion-style convert: terminated\n')
    assert {path.name for path in tmp_path.iterdir()} == {'a.npz', 'b.csv'}
    assert (tmp_path / 'b.csv').read_text() == 'old'


@pytest.mark.parametrize('words', [['info', '{file}'], ['info', '{file}', '--json'], ['--help'], ['convert', '--help']])
@pytest.mark.parametrize('how', ['closed', 'gone', 'full'])
def test_an_output_nobody_reads_ends_quietly(walk, how, words):
    words, helps = [word.format(file=walk) for word in words], '--help' in words
    if how == 'closed':
        done = subprocess.run(['sh', '-c', '"$@" >&-', 'sh', *RUN, *words], capture_output=True, text=True)
        assert done.returncode in (0, 1)
    elif how == 'full':
        with open('/dev/full', 'w') as full:
            done = subprocess.run([*RUN, *words], stdout=full, stderr=subprocess.PIPE, text=True)
        assert helps or (done.returncode == 1 and 'No space left' in done.stderr)     # argparse keeps it to itself
    else:
        read, write = os.pipe()
        os.close(read)
        done = subprocess.run([*RUN, *words], stdout=write, stderr=subprocess.PIPE, text=True)
        os.close(write)
        assert (helps or done.returncode == 141) and not done.stderr
    assert 'Traceback' not in done.stderr and 'Exception ignored' not in done.stderr
    assert helps or done.stderr.count('\n') <= 1


def test_tables_are_utf8_and_private_whatever_the_locale(walk, tmp_path, gait):
    names = ['Hüfte', 'колено', '足首', *gait.joint_names[3:]]
    write_motion(gait.replace(joint_names=names), tmp_path / 'umlaut.npz')
    environment = {**os.environ, 'LC_ALL': 'C', 'PYTHONUTF8': '0', 'PYTHONCOERCECLOCALE': '0'}
    done = subprocess.run([*RUN, 'convert', tmp_path / 'umlaut.npz', tmp_path / 'out.csv'], env=environment,
                          capture_output=True, preexec_fn=lambda: os.umask(0o077))
    assert done.returncode == 0, done.stderr
    assert (tmp_path / 'out.csv').read_text(encoding='utf-8').startswith('time,Hüfte,колено,足首')
    assert stat.S_IMODE((tmp_path / 'out.csv').stat().st_mode) == 0o600
    shown = subprocess.run([*RUN, 'info', tmp_path / 'out.csv'], env=environment, capture_output=True)
    assert shown.returncode == 0 and b'H\\xfcfte' in shown.stdout and not shown.stderr


def test_training_leaves_no_pattern_for_joints_that_are_not_there(tmp_path, capsys):
    """Defaults name fingers and thumbs; a body without them is the rule, not an error."""
    from test_effort_cli import made
    files = []
    for content in (0, 1):
        for manner in range(5):
            motion = made(f'{"swing" if content else "kick"}{manner}', content, manner)
            write_motion(motion, tmp_path / f'{motion.name}.csv')
            files.append(str(tmp_path / f'{motion.name}.csv'))
    assert main(['train', 'effort', *files, '--interpolations', '24', '-o', str(tmp_path / 'lib.npz')]) == 0

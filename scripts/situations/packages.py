"""style_core as a package from an index would be: sdist and wheel in clean environments of every Python it supports."""
import subprocess
import tarfile
from functools import cache

from situations.stage import Skipped, accepted, checkout, commands_without, last_line, refused, run, scratch, situation

#: none of us wrote these
JUDGES = ('twine', 'check-wheel-contents', 'validate-pyproject')
PIP = ('-m', 'pip', '--disable-pip-version-check', '--quiet')


def python_of(version):
    """A CPython of that version."""
    found = run(['bash', '-c', f'. scripts/common.sh; need_python {version} static-is-fine; echo "$PYTHON"'],
                cwd=checkout())
    if found.returncode:
        raise Skipped(f'no CPython {version}')
    return last_line(found)


def environment(version, *packages):
    """A clean virtual environment with these packages; returns its folder of commands."""
    folder = scratch() / 'venv'
    subprocess.run([python_of(version), '-m', 'venv', folder], check=True)
    accepted(run([folder / 'bin/python', *PIP, 'install', '--upgrade', 'pip', *packages], cwd=folder))
    return folder / 'bin'


@cache
def built():
    """Folder with the sdist and the wheel that ``python -m build`` makes of a fresh checkout."""
    bin_folder, output = environment('3.12', 'build', *JUDGES), scratch() / 'dist'
    source = checkout() / 'src/style_core'
    accepted(run([bin_folder / 'python', '-m', 'build', '-o', output, source], cwd=source))
    return bin_folder, output, source


@situation('python -m build, and what independent tools say of it')
def build_and_judges():
    bin_folder, output, source = built()
    said = [last_line(accepted(run([bin_folder / 'twine', 'check', '--strict', *output.iterdir()], cwd=output))),
            last_line(accepted(run([bin_folder / 'check-wheel-contents', *output.glob('*.whl')], cwd=output))),
            last_line(accepted(run([bin_folder / 'validate-pyproject', source / 'pyproject.toml'], cwd=output)))]
    return 'twine, check-wheel-contents, validate-pyproject: ' + '; '.join(line.split(': ')[-1] for line in said)


def _installs(version):
    """The sdist installs, its dependencies agree, and the command works on a recording."""
    _, output, _ = built()
    bin_folder, folder = environment(version), scratch()
    accepted(run([bin_folder / 'python', *PIP, 'install', *output.glob('*.tar.gz')], cwd=folder))
    agree = last_line(accepted(run([bin_folder / 'pip', 'check'], cwd=folder)))
    walk = folder / 'walk.csv'
    walk.write_text('time,left_knee,right_knee\n' + ''.join(f'{i / 60},{i % 60 / 60},{(i + 30) % 60 / 60}\n'
                                                            for i in range(240)))
    shown = accepted(run([bin_folder / 'motion-style', 'info', walk], cwd=folder)).stdout
    assert 'left_knee' in shown or '2' in shown, shown
    program = ('import importlib, pkgutil, style_core\n'
               'names = [m.name for m in pkgutil.walk_packages(style_core.__path__, "style_core.")]\n'
               'for name in names: importlib.import_module(name)\n'
               'print(len(names))')
    modules = last_line(accepted(run([bin_folder / 'python', '-c', program], cwd=folder)))
    return f'{modules} modules import, motion-style info works, pip check: {agree}'


@situation('the sdist in a clean environment of CPython 3.10')
def sdist_on_310():
    return _installs('3.10')


@situation('the sdist in a clean environment of CPython 3.11')
def sdist_on_311():
    return _installs('3.11')


@situation('the sdist in a clean environment of CPython 3.12')
def sdist_on_312():
    return _installs('3.12')


@situation('the sdist in a clean environment of CPython 3.13')
def sdist_on_313():
    return _installs('3.13')


@situation('pip install without a compiler')
def package_without_compiler():
    bin_folder = environment('3.12')
    return refused(run([bin_folder / 'pip', 'install', '--no-deps', checkout() / 'src/style_core'], cwd=bin_folder,
                       PATH=commands_without('gcc', 'cc', 'g++', 'c++', 'clang')),
                   'style_core needs a C compiler').strip()


@situation('a build from sources without kernels')
def package_without_kernels():
    source = checkout() / 'src/style_core'
    for kernel in source.rglob('*.pyx'):
        kernel.unlink()
    bin_folder = environment('3.12')
    return refused(run([bin_folder / 'pip', 'install', '--no-deps', source], cwd=bin_folder),
                   'holds no .pyx file').strip()


@situation('colcon with the setuptools of Ubuntu 22.04 (59.6): is the metadata read?')
def setuptools_59():
    bin_folder = environment('3.10', 'setuptools==59.6.0', 'wheel', 'Cython>=3,<4')
    source = checkout() / 'src/style_core'
    accepted(run([bin_folder / 'python', 'setup.py', '--quiet', 'egg_info'], cwd=source))
    metadata = source.joinpath('style_core.egg-info/PKG-INFO').read_text()
    assert 'Version: 0.' in metadata and 'numpy' in source.joinpath('style_core.egg-info/requires.txt').read_text()
    assert 'motion-style' in source.joinpath('style_core.egg-info/entry_points.txt').read_text()
    return 'name, version, requirements and the command are'


@situation('the licence and the headers of the kernels are in the sdist')
def sdist_holds():
    _, output, source = built()
    sdist, = output.glob('*.tar.gz')
    with tarfile.open(sdist) as archive:
        names = {name.partition('/')[2] for name in archive.getnames()}
    wanted = {str(path.relative_to(source)) for pattern in ('*.pyx', '*.pxd', '*.h')
              for path in source.joinpath('style_core').rglob(pattern)}
    missing = ({'LICENSE', 'README.md', 'style_core/py.typed', 'package.xml'} | wanted) - names
    assert not missing, missing
    return f'{len(wanted)} sources of kernels, licence, readme, py.typed'

